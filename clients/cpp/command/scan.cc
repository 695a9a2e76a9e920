// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/scan.h"

#include <charconv>
#include <cmath>
#include <cstring>
#include <numbers>

#include "clients/cpp/command/subcommands.h"
#include "kdray/error.h"

namespace kdray::client {
namespace {

double Radians(double degrees) { return degrees * (std::numbers::pi / 180); }

}  // namespace

std::vector<Ray> Scanner::Rays() const {
  const double up_length = Length(up);
  if (!(up_length > 0)) throw UsageError("--up must not be zero");
  const Vector3 u = (1 / up_length) * up;
  const Vector3 level = forward - Dot(forward, u) * u;
  if (!(Length(level) > 1e-9 * Length(forward))) {
    throw UsageError("the view must not be along --up");
  }
  const Vector3 f = (1 / Length(level)) * level;
  const Vector3 r = Cross(f, u);
  std::vector<Ray> rays;
  rays.reserve(elevations_deg.size() * steps);
  for (const double elevation_deg : elevations_deg) {
    const double e = Radians(elevation_deg);
    for (std::uint64_t i = 0; i < steps; ++i) {
      const double share = (static_cast<double>(i) + 0.5) / static_cast<double>(steps) - 0.5;
      const double a = share * Radians(h_fov_deg);
      rays.push_back({eye, std::cos(e) * (std::cos(a) * f + std::sin(a) * r) + std::sin(e) * u});
    }
  }
  return rays;
}

std::vector<double> ParseElevations(const std::string& text) {
  std::vector<double> elevations;
  for (const std::string& word : SplitAtCommas(text)) {
    double degrees = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), degrees);
    if (error != std::errc() || end != word.data() + word.size() || !(std::abs(degrees) <= 90)) {
      throw UsageError("--elevations takes degrees from -90 to 90 with commas between them, not '" +
                       word + "'");
    }
    elevations.push_back(degrees);
  }
  return elevations;
}

void AppendFinite(std::string_view rows, std::string& points) {
  constexpr std::size_t kRowBytes = 3 * sizeof(double);
  for (; rows.size() >= kRowBytes; rows.remove_prefix(kRowBytes)) {
    Vector3 point;
    std::memcpy(point.data(), rows.data(), kRowBytes);
    if (std::isfinite(point[0]) && std::isfinite(point[1]) && std::isfinite(point[2])) {
      points.append(rows.substr(0, kRowBytes));
    }
  }
}

std::string PlyPointCloudHeader(std::uint64_t points) {
  return "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(points) +
         "\nproperty double x\nproperty double y\nproperty double z\nend_header\n";
}

}  // namespace kdray::client
