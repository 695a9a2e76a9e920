// SPDX-License-Identifier: Apache-2.0
// Three numbers along x, y, z, and the arithmetic on them. Every operation is the plain IEEE one,
// in the order written.
#pragma once

#include <algorithm>
#include <cmath>

namespace kdray::core {

template <class T>
struct Vec3 {
  T x{}, y{}, z{};

  T& operator[](int axis) { return axis == 0 ? x : axis == 1 ? y : z; }
  const T& operator[](int axis) const { return axis == 0 ? x : axis == 1 ? y : z; }

  template <class U>
  explicit operator Vec3<U>() const {
    return {static_cast<U>(x), static_cast<U>(y), static_cast<U>(z)};
  }
  friend bool operator==(const Vec3&, const Vec3&) = default;
};

using Vec3f = Vec3<float>;
using Vec3d = Vec3<double>;

template <class T>
Vec3<T> operator+(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class T>
Vec3<T> operator-(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class T>
Vec3<T> operator-(const Vec3<T>& a) {
  return {-a.x, -a.y, -a.z};
}
template <class T>
Vec3<T> operator*(const Vec3<T>& a, T s) {
  return {a.x * s, a.y * s, a.z * s};
}
template <class T>
Vec3<T> operator*(T s, const Vec3<T>& a) {
  return a * s;
}

template <class T>
T Dot(const Vec3<T>& a, const Vec3<T>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T>
Vec3<T> Cross(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class T>
T Length(const Vec3<T>& a) {
  return std::sqrt(Dot(a, a));
}
/// a / |a|; not finite for a zero vector.
template <class T>
Vec3<T> Normalized(const Vec3<T>& a) {
  return a * (T(1) / Length(a));
}
/// The same for every finite nonzero a, also where squares of the components would leave the range
/// of T.
template <class T>
Vec3<T> NormalizedAtAnyScale(const Vec3<T>& a);

template <class T>
Vec3<T> Min(const Vec3<T>& a, const Vec3<T>& b) {
  return {std::min(a.x, b.x), std::min(a.y, b.y), std::min(a.z, b.z)};
}
template <class T>
Vec3<T> Max(const Vec3<T>& a, const Vec3<T>& b) {
  return {std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)};
}
/// Largest |component|.
template <class T>
T MaxAbs(const Vec3<T>& a) {
  return std::max({std::abs(a.x), std::abs(a.y), std::abs(a.z)});
}
template <class T>
Vec3<T> NormalizedAtAnyScale(const Vec3<T>& a) {
  const T scale = MaxAbs(a);
  return Normalized(Vec3<T>{a.x / scale, a.y / scale, a.z / scale});
}
template <class T>
bool IsFinite(const Vec3<T>& a) {
  return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z);
}

}  // namespace kdray::core
