// SPDX-License-Identifier: Apache-2.0
// Sends a batch of rows in parts, so its progress can be seen and it may be larger than the server
// takes at once, and joins the answers.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "clients/cpp/command/answer_facts.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/progress_bar.h"
#include "kdray/client.h"
#include "kdray/npy.h"
#include "kdray/payload.h"

namespace kdray::client {

/// A .npy array of rows, checked before it is sent; or JSON, which only the server checks.
struct Rows {
  Payload bytes;
  std::optional<NpyHeader> header = {};  ///< nullopt for JSON
  std::uint64_t count = 0;               ///< 0 for JSON
  std::uint64_t row_bytes = 0;           ///< 0 for JSON

  /// Whether rows lie one after another in the file, so parts of it are arrays too.
  bool CanBeSplit() const;

  /// Rows [first, first + count) as a .npy array of two dimensions. @pre CanBeSplit().
  Payload Part(std::uint64_t first, std::uint64_t count) const;
};

/// What a query wants.
struct RowForm {
  const char* noun;                    ///< "rays": in errors, and the name in JSON
  std::vector<std::uint64_t> columns;  ///< numbers of a row
};

/// Throws LocalFileError, which names the file, if it is neither an array of such rows nor JSON.
Rows ReadRows(const Payload& bytes, const RowForm& form);

/// Whether RunBatch sends these in parts; otherwise they travel as they are.
bool IsSplit(const Rows& rows);

/// "100,000 rays"; empty for JSON, whose rows the command does not count.
std::string RowsText(const Rows& rows, const char* noun);

struct BatchQuery {
  std::string path;           ///< "rays/closest"
  Parameters options;         ///< of the query
  bool wants_json = false;    ///< the answer; a batch is then sent as a whole
  bool numbers_rows = false;  ///< the answer's elements begin with the number of their row
};

/// Asks for every row and writes the joined answer, as one request with all rows would give it.
/// Parts take the server less than a second. Updates `bar` with the rows done if the batch is
/// split, else with the bytes sent. Throws as Client and OutputFile do.
AnswerFacts RunBatch(Client& client, const std::string& id, const BatchQuery& query,
                     const Rows& rows, OutputFile& file, ProgressBar& bar);

/// The same for visibility: `from` and `to` have three columns and the same type of numbers.
AnswerFacts RunVisibility(Client& client, const std::string& id, const Parameters& options,
                          const Rows& from, const Rows& to, OutputFile& file, ProgressBar& bar);

}  // namespace kdray::client
