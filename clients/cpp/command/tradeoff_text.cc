#include "clients/cpp/command/tradeoff_text.h"

#include <vector>

#include "clients/cpp/command/text.h"

namespace kdray::client {
namespace {

const Json& At(const Json& object, const char* name) {
  static const Json nothing;
  const auto field = object.is_object() ? object.find(name) : object.end();
  return field == object.end() ? nothing : *field;
}

std::string Number(const Json& value, double scale = 1, int digits = 3) {
  return value.is_number() ? NumberText(value.get<double>() * scale, digits) : std::string();
}

std::string Text(const Json& value) { return value.is_string() ? value.get<std::string>() : ""; }

std::string Count(const Json& value) {
  return value.is_number_unsigned() ? CountText(value.get<std::uint64_t>()) : std::string();
}

/// "0.0013", or "< 5e-05" for a zero with its bound; "-" if it is absent.
std::string Rate(const Json& rate) {
  if (!rate.is_object()) return "-";
  const std::string bound = Number(At(rate, "below"));
  return bound.empty() ? Number(At(rate, "rate")) : "< " + bound;
}

}  // namespace

std::string TradeoffText(const Json& tradeoff) {
  std::vector<std::vector<std::string>> rows = {{"BUILD", "PRECISION", "BUILD MS", "SIZE", "STEPS",
                                                 "SAH", "RANDOM M/S", "AIMED M/S", "LEAKS", "WRONG",
                                                 "MISSED", "EXTRA", "T ERROR 99.9%", "MAX"}};
  const Json& results = At(tradeoff, "results");
  for (const Json& row : results.is_array() ? results : Json::array()) {
    const Json& bytes = At(row, "bytes");
    rows.push_back({Text(At(row, "build")), Text(At(row, "precision")), Number(At(row, "build_ms")),
                    bytes.is_number() ? ByteText(bytes.get<double>()) : std::string(),
                    Number(At(At(row, "random"), "nodes_per_ray")), Number(At(row, "sah_cost")),
                    Number(At(At(row, "random"), "rays_per_s"), 1e-6),
                    Number(At(At(row, "aimed"), "rays_per_s"), 1e-6), Rate(At(row, "leaks")),
                    Rate(At(row, "wrong_triangles")), Rate(At(row, "missed_hits")),
                    Rate(At(row, "extra_hits")), Number(At(At(row, "t_error"), "p999")),
                    Number(At(At(row, "t_error"), "max"))});
  }
  const Json& mesh = At(tradeoff, "mesh");
  const Json& conditions = At(tradeoff, "conditions");
  return Table(rows, "llrrrrrrrrrrrr") + Count(At(mesh, "triangles")) + " triangles, " +
         (At(mesh, "closed") == Json(true) ? "closed" : "not closed") + "; " +
         Count(At(conditions, "threads")) + " threads, load " +
         Number(At(conditions, "load_average")) + ", other work beside " +
         Count(At(conditions, "disturbed_runs")) + " of " + Count(At(conditions, "runs")) +
         " runs; measured " + Text(At(tradeoff, "measured_at")) + "\n";
}

}  // namespace kdray::client
