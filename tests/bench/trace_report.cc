// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/trace_report.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace kdray::bench {
namespace {

// For fast and watertight.
struct Ratios {
  double fast = 0, watertight = 0;
};

Ratios ToEmbree(const TraceRow& row) {
  return {row.ours[0].median / row.embree[row.plain].median,
          row.ours[1].median / row.embree[row.robust].median};
}

Ratios RowsToRows(const TraceRow& row) { return {*row.rows_fast, *row.rows_watertight}; }

Ratios ToOther(const TraceRow& row) {
  constexpr std::size_t kOther = TraceRow::kPrecisions;
  return {row.ours[0].median / row.ours[kOther].median,
          row.ours[1].median / row.ours[kOther + 1].median};
}

double GeometricMean(const std::vector<double>& values) {
  double logs = 0;
  for (const double value : values) logs += std::log(value);
  return std::exp(logs / static_cast<double>(values.size()));
}

template <class RatiosOf>
void PrintRatios(const std::string& what, const std::vector<TraceRow>& rows,
                 const RatiosOf& ratios_of) {
  std::vector<double> fast, watertight;
  for (const TraceRow& row : rows) {
    const Ratios ratios = ratios_of(row);
    fast.push_back(ratios.fast);
    watertight.push_back(ratios.watertight);
  }
  std::printf("| %s | %.2f | %.2f | %.2f | %.2f |\n", what.c_str(), GeometricMean(fast),
              *std::min_element(fast.begin(), fast.end()), GeometricMean(watertight),
              *std::min_element(watertight.begin(), watertight.end()));
}

std::string RatioText(const std::optional<double>& ratio) {
  if (!ratio) return "–";
  char text[32];
  std::snprintf(text, sizeof text, "%.2f", *ratio);
  return text;
}

}  // namespace

TraceCsv::TraceCsv(const std::string& file) {
  if (file.empty()) return;
  csv_ = std::fopen(file.c_str(), "w");
  if (csv_ == nullptr) {
    std::fprintf(stderr, "cannot write %s\n", file.c_str());
    std::exit(2);
  }
  std::fprintf(csv_, "mesh,class,threads,mode,mrays_median,mrays_low,mrays_high,miss,distance\n");
}

TraceCsv::~TraceCsv() {
  if (csv_ != nullptr) std::fclose(csv_);
}

void TraceCsv::Row(const std::string& mesh, const std::string& rays, int threads,
                   const std::string& mode, const Spread& mrays, const Mismatches* mismatches) {
  if (csv_ == nullptr) return;
  std::fprintf(csv_, "%s,\"%s\",%d,%s,%.3f,%.3f,%.3f,", mesh.c_str(), rays.c_str(), threads,
               mode.c_str(), mrays.median, mrays.low, mrays.high);
  if (mismatches != nullptr) {
    std::fprintf(csv_, "%zu,%zu\n", mismatches->hit_or_miss, mismatches->distance);
  } else {
    std::fprintf(csv_, ",\n");
  }
  std::fflush(csv_);
}

std::size_t TraceRow::Best(std::size_t first, std::size_t last) const {
  std::size_t found = first;
  for (std::size_t m = first; m < last; ++m) {
    if (embree[m].median > embree[found].median) found = m;
  }
  return found;
}

void PrintTableHead(const std::string& other) {
  std::printf(
      "| rays | best Embree | Mrays/s | fast | ratio | rows to rows | best Embree ROBUST | Mrays/s "
      "| watertight | ratio | rows to rows | double | exact |%s mismatches a million: fast, "
      "watertight, double, exact |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|%s---|\n",
      other.empty() ? "" : (" " + other + ": fast, watertight |").c_str(),
      other.empty() ? "" : "---|");
}

void PrintRow(const TraceRow& row, const std::string& plain, const std::string& robust,
              const std::vector<Mismatches>& mismatches, double millions) {
  constexpr std::size_t kPrecisions = TraceRow::kPrecisions;
  const Ratios ratios = ToEmbree(row);
  std::printf("| %s | %s | %.1f | %.1f | **%.2f** | %s | %s | %.1f | %.1f | **%.2f** | %s |",
              row.name.c_str(), plain.c_str(), row.embree[row.plain].median, row.ours[0].median,
              ratios.fast, RatioText(row.rows_fast).c_str(), robust.c_str(),
              row.embree[row.robust].median, row.ours[1].median, ratios.watertight,
              RatioText(row.rows_watertight).c_str());
  std::printf(" %.1f | %.1f |", row.ours[2].median, row.ours[3].median);
  if (row.ours.size() > kPrecisions) {
    std::printf(" %.1f, %.1f |", row.ours[kPrecisions].median, row.ours[kPrecisions + 1].median);
  }
  for (std::size_t m = 0; m < std::min(mismatches.size(), kPrecisions); ++m) {
    std::printf("%s %.0f + %.0f", m == 0 ? "" : ",",
                static_cast<double>(mismatches[m].hit_or_miss) / millions,
                static_cast<double>(mismatches[m].distance) / millions);
  }
  std::printf("%s |\n", mismatches.empty() ? " –" : "");
  std::fflush(stdout);
}

void PrintSummary(const std::vector<TraceRow>& rows, const std::vector<std::string>& builds) {
  std::printf(
      "\n| over the classes of rays | fast: geometric mean | least | watertight: geometric mean | "
      "least |\n|---|---|---|---|---|\n");
  PrintRatios(builds[0] + " to Embree", rows, ToEmbree);
  PrintRatios("the same from rows to rows", rows, RowsToRows);
  if (builds.size() > 1) PrintRatios(builds[0] + " to " + builds[1], rows, ToOther);
  std::printf("\n");
  std::fflush(stdout);
}

}  // namespace kdray::bench
