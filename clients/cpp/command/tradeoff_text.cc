// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/tradeoff_text.h"

#include <vector>

#include "clients/cpp/command/text.h"

namespace kdray::client {
namespace {

std::string Number(const Document& value, double scale = 1, int digits = 3) {
  const auto number = value.Number();
  return number ? NumberText(*number * scale, digits) : std::string();
}

std::string Text(const Document& value) { return value.Text().value_or(""); }

std::string Count(const Document& value) {
  const auto count = value.Count();
  return count ? CountText(*count) : std::string();
}

std::string Bytes(const Document& value) {
  const auto bytes = value.Number();
  return bytes ? ByteText(*bytes) : std::string();
}

std::string Duration(const Document& value) {
  const auto milliseconds = value.Number();
  return milliseconds ? DurationText(*milliseconds) : std::string();
}

/// "0.0013", or "< 5e-05" for a zero with its bound; "-" if it is absent.
std::string Rate(const Document& rate) {
  if (!rate.IsObject()) return "-";
  const std::string bound = Number(rate["below"]);
  return bound.empty() ? Number(rate["rate"]) : "< " + bound;
}

}  // namespace

std::string TradeoffConditions(const Document& tradeoff) {
  const Document mesh = tradeoff["mesh"];
  const Document conditions = tradeoff["conditions"];
  return Count(mesh["triangles"]) + " triangles, " +
         (mesh["closed"].Flag() == true ? "closed" : "not closed") + "; " +
         Count(conditions["threads"]) + " threads, load " + Number(conditions["load_average"]) +
         ", other work beside " + Count(conditions["disturbed_runs"]) + " of " +
         Count(conditions["runs"]) + " runs; measured " + Text(tradeoff["measured_at"]);
}

std::string TradeoffText(const Document& tradeoff, std::size_t width) {
  std::vector<std::vector<std::string>> rows = {{"BUILD", "PRECISION", "BUILD TIME", "SIZE",
                                                 "STEPS", "SAH", "RANDOM M/S", "AIMED M/S", "LEAKS",
                                                 "WRONG", "MISSED", "EXTRA", "T 99.9%", "T MAX"}};
  for (const Document& row : tradeoff["results"].Items()) {
    rows.push_back({Text(row["build"]), Text(row["precision"]), Duration(row["build_ms"]),
                    Bytes(row["bytes"]), Number(row["random"]["nodes_per_ray"]),
                    Number(row["sah_cost"]), Number(row["random"]["rays_per_s"], 1e-6),
                    Number(row["aimed"]["rays_per_s"], 1e-6), Rate(row["leaks"]),
                    Rate(row["wrong_triangles"]), Rate(row["missed_hits"]), Rate(row["extra_hits"]),
                    Number(row["t_error"]["p999"]), Number(row["t_error"]["max"])});
  }
  return FittedTable(rows, "llrrrrrrrrrrrr", width, 2) + TradeoffConditions(tradeoff) + "\n";
}

}  // namespace kdray::client
