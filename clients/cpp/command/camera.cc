// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/camera.h"

#include <charconv>
#include <cmath>
#include <numbers>

#include "kdray/error.h"

namespace kdray::client {

Vector3 ParseVector(const std::string& text, const char* option) {
  Vector3 vector{};
  const char* next = text.data();
  const char* const end = text.data() + text.size();
  bool ok = true;
  for (std::size_t i = 0; ok && i < 3; ++i) {
    if (i > 0) ok = next != end && *next++ == ',';
    while (ok && next != end && *next == ' ') ++next;
    const auto [rest, error] = std::from_chars(next, end, vector[i]);
    ok = ok && error == std::errc() && std::isfinite(vector[i]);
    next = rest;
  }
  if (!ok || next != end) {
    throw UsageError(std::string(option) + " takes three numbers with commas between them, as " +
                     "0,1.5,-2, not '" + text + "'");
  }
  return vector;
}

std::string VectorParameter(const Vector3& v) {
  std::string text;
  for (const double number : v) {
    std::array<char, 32> digits;
    const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), number);
    text += (text.empty() ? "" : ",") + std::string(digits.data(), end);
  }
  return text;
}

Vector3 operator+(const Vector3& a, const Vector3& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
Vector3 operator-(const Vector3& a, const Vector3& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
Vector3 operator*(double factor, const Vector3& v) {
  return {factor * v[0], factor * v[1], factor * v[2]};
}
double Dot(const Vector3& a, const Vector3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vector3 Cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double Length(const Vector3& v) { return std::hypot(v[0], v[1], v[2]); }

Framing Framing::Of(const Document& description) {
  const Document bounds = description["mesh"]["bounds"];
  const auto min = bounds["min"].Numbers(), max = bounds["max"].Numbers();
  if (min.size() != 3 || max.size() != 3) {
    throw UsageError("the description of this tree has no bounds; give --eye and --target");
  }
  Framing framing;
  Vector3 half;
  for (std::size_t i = 0; i < 3; ++i) {
    framing.center[i] = min[i] / 2 + max[i] / 2;
    half[i] = max[i] / 2 - min[i] / 2;
  }
  framing.radius = Length(half) > 0 ? Length(half) : 1;
  return framing;
}

std::optional<Vector3> TowardViewer(const Vector3& up, const std::string& view) {
  // The smallest rotation that takes y to `up`, applied to +z: the front of the server's views
  // (core/render/framing.h).
  const double one_plus_y = 1 + up[1];
  const Vector3 front = one_plus_y > 1e-9 ? Vector3{-up[0] * up[2] / one_plus_y, -up[2],
                                                    1 - up[2] * up[2] / one_plus_y}
                                          : Vector3{0, 0, -1};
  const Vector3 right = Cross(up, front);
  if (view == "front") return front;
  if (view == "back") return -1.0 * front;
  if (view == "left") return -1.0 * right;
  if (view == "right") return right;
  if (view == "iso") return (1 / std::sqrt(3.0)) * (front + right + up);
  if (!view.empty()) return std::nullopt;
  const double azimuth = std::numbers::pi / 6, elevation = std::numbers::pi / 9;
  return std::cos(elevation) * (std::cos(azimuth) * front + std::sin(azimuth) * right) +
         std::sin(elevation) * up;
}

Vector3 Turned(const Vector3& v, const Vector3& axis, double angle) {
  // Rodrigues' formula.
  const double c = std::cos(angle), s = std::sin(angle);
  return c * v + s * Cross(axis, v) + (1 - c) * Dot(axis, v) * axis;
}

}  // namespace kdray::client
