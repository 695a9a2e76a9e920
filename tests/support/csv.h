// SPDX-License-Identifier: Apache-2.0
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
/// std::runtime_error if the file cannot be read, or the number of a row's fields differs from the
/// header's.
std::vector<CsvRow> ReadCsv(const std::filesystem::path& path);

}  // namespace kdray::test
