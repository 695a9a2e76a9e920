// Tables of test cases in CSV files.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace kdray::test {

/// One row by column name.
using CsvRow = std::map<std::string, std::string>;

/// The rows below the header line. Fields may be quoted ("" is a quote inside). Throws
/// std::runtime_error when the file cannot be read or a row has another number of fields than the
/// header.
std::vector<CsvRow> ReadCsv(const std::filesystem::path& path);

}  // namespace kdray::test
