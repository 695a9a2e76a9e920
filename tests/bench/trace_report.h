// SPDX-License-Identifier: Apache-2.0
// What the benchmark of rays reports: CSV rows, and tables in Markdown on standard output.
#pragma once

#include <cstddef>
#include <cstdio>
#include <optional>
#include <string>
#include <vector>

#include "core/intersect/precision.h"
#include "tests/bench/scenes.h"

namespace kdray::bench {

/// Rays on which kdray and Embree differ.
struct Mismatches {
  std::size_t hit_or_miss = 0, distance = 0;
};

/// The CSV file; every method has no effect if its name is empty. Ends the program if it cannot be
/// written.
class TraceCsv {
 public:
  explicit TraceCsv(const std::string& file);
  ~TraceCsv();
  TraceCsv(const TraceCsv&) = delete;
  TraceCsv& operator=(const TraceCsv&) = delete;

  void Row(const std::string& mesh, const std::string& rays, int threads, const std::string& mode,
           const Spread& mrays, const Mismatches* mismatches);

 private:
  std::FILE* csv_ = nullptr;
};

/// A class of rays on one mesh, in million rays a second.
struct TraceRow {
  static constexpr std::size_t kPrecisions = core::kAllPrecisions.size();

  std::string name;
  std::vector<Spread> embree;
  std::vector<Spread> ours;           ///< by Precision; then fast and watertight of the other build
  std::size_t plain = 0, robust = 0;  ///< the best modes of Embree without and with ROBUST
  /// kdray to the best mode of Embree, both from rows to rows.
  std::optional<double> rows_fast, rows_watertight;

  /// The largest median of embree[first] to embree[last - 1].
  std::size_t Best(std::size_t first, std::size_t last) const;
};

/// The head of a mesh's table. `other`: the build beside the one that is measured; may be empty.
void PrintTableHead(const std::string& other);
/// plain, robust: the names of the row's best modes. mismatches: by Precision; may be empty.
void PrintRow(const TraceRow& row, const std::string& plain, const std::string& robust,
              const std::vector<Mismatches>& mismatches, double millions);
/// Geometric means and least ratios over the classes. `builds`: the measured one, then the other if
/// there is one.
void PrintSummary(const std::vector<TraceRow>& rows, const std::vector<std::string>& builds);

}  // namespace kdray::bench
