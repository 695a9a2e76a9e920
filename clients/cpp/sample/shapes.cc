// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/sample/shapes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "clients/cpp/sample/mesh_builder.h"

namespace kdray::client {
namespace {

Point Normalized(const Point& p) {
  const double length = std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
  return {p[0] / length, p[1] / length, p[2] / length};
}

// A number in [0, 1) for a lattice point: integer arithmetic only, so it is the same on every
// machine. The constants are those of the finaliser of MurmurHash3 (Austin Appleby).
double LatticeValue(std::uint32_t x, std::uint32_t z, std::uint32_t seed) {
  std::uint32_t h = seed * 0x9e3779b9u + x * 0x85ebca6bu + z * 0xc2b2ae35u;
  h ^= h >> 16;
  h *= 0x85ebca6bu;
  h ^= h >> 13;
  h *= 0xc2b2ae35u;
  h ^= h >> 16;
  return h * 0x1p-32;
}

// Value noise: lattice values joined by a curve whose slope is zero at the lattice points, so that
// the ground has no creases along the lattice.
double ValueNoise(double x, double z, std::uint32_t seed) {
  const double x0 = std::floor(x);
  const double z0 = std::floor(z);
  const auto ease = [](double t) { return t * t * (3 - 2 * t); };
  const double u = ease(x - x0);
  const double v = ease(z - z0);
  const auto ix = static_cast<std::uint32_t>(x0);
  const auto iz = static_cast<std::uint32_t>(z0);
  const double near = std::lerp(LatticeValue(ix, iz, seed), LatticeValue(ix + 1, iz, seed), u);
  const double far =
      std::lerp(LatticeValue(ix, iz + 1, seed), LatticeValue(ix + 1, iz + 1, seed), u);
  return std::lerp(near, far, v);
}

double TerrainHeight(double x, double z, std::uint32_t seed) {
  double height = 0;
  double amplitude = 0.5;
  double frequency = 3;
  for (std::uint32_t octave = 0; octave < 6; ++octave) {
    height += amplitude * ValueNoise(x * frequency, z * frequency, seed + octave);
    amplitude /= 2;
    frequency *= 2;
  }
  return height * height;  // squaring flattens the valleys and leaves the peaks
}

}  // namespace

SampleMesh MakeSphere(const SampleOptions& options) {
  constexpr double kPhi = std::numbers::phi;
  static constexpr Point kCorners[12] = {
      {-1, kPhi, 0},  {1, kPhi, 0},  {-1, -kPhi, 0}, {1, -kPhi, 0}, {0, -1, kPhi},  {0, 1, kPhi},
      {0, -1, -kPhi}, {0, 1, -kPhi}, {kPhi, 0, -1},  {kPhi, 0, 1},  {-kPhi, 0, -1}, {-kPhi, 0, 1}};
  static constexpr Face kFaces[20] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                                      {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                                      {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                                      {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  const int n = options.detail;
  MeshBuilder builder;
  for (const Face& face : kFaces) {
    // Integer weights i, j, n-i-j and a sum that does not depend on the order of its terms: an
    // edge's points come out equal, bit for bit, from both faces that share it.
    const auto at = [&](int i, int j) {
      const double w[3] = {static_cast<double>(n - i - j), static_cast<double>(i),
                           static_cast<double>(j)};
      Point p{};
      for (int axis = 0; axis < 3; ++axis) {
        double terms[3];
        for (int corner = 0; corner < 3; ++corner)
          terms[corner] = w[corner] * kCorners[face[corner]][axis];
        std::sort(terms, terms + 3);
        p[axis] = terms[0] + terms[1] + terms[2];
      }
      return Normalized(p);
    };
    for (int i = 0; i < n; ++i) {
      for (int j = 0; i + j < n; ++j) {
        builder.AddTriangle(at(i, j), at(i + 1, j), at(i, j + 1));
        if (i + j + 1 < n) builder.AddTriangle(at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
      }
    }
  }
  return std::move(builder).Take();
}

SampleMesh MakeCube(const SampleOptions& options) {
  const int n = options.detail;
  const auto coordinate = [n](int i) { return static_cast<double>(2 * i - n) / n; };
  MeshBuilder builder;
  for (int axis = 0; axis < 3; ++axis) {
    for (const int side : {-1, 1}) {
      // On the positive side (u, v, axis) is right-handed, so u then v turns counter-clockwise.
      const int u = side > 0 ? (axis + 1) % 3 : (axis + 2) % 3;
      const int v = side > 0 ? (axis + 2) % 3 : (axis + 1) % 3;
      const auto at = [&](int i, int j) {
        Point p{};
        p[axis] = side;
        p[u] = coordinate(i);
        p[v] = coordinate(j);
        return p;
      };
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j)
          builder.AddQuad(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
    }
  }
  return std::move(builder).Take();
}

SampleMesh MakeTorus(const SampleOptions& options) {
  constexpr double kTau = 2 * std::numbers::pi;
  constexpr double kTubeRadius = 0.4;
  // Below three steps a ring has no inside.
  const int around_tube = std::max(options.detail, 3);
  const int around_axis = 2 * around_tube;
  const auto at = [&](int i, int j) -> Point {
    const double a = kTau * (i % around_axis) / around_axis;
    const double b = kTau * (j % around_tube) / around_tube;
    const double radius = 1 + kTubeRadius * std::cos(b);
    return {radius * std::cos(a), kTubeRadius * std::sin(b), -radius * std::sin(a)};
  };
  MeshBuilder builder;
  for (int i = 0; i < around_axis; ++i)
    for (int j = 0; j < around_tube; ++j)
      builder.AddQuad(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
  return std::move(builder).Take();
}

SampleMesh MakeTerrain(const SampleOptions& options) {
  const int n = options.detail;
  SampleMesh mesh;
  for (int j = 0; j <= n; ++j) {
    for (int i = 0; i <= n; ++i) {
      const double x = static_cast<double>(i) / n;
      const double z = static_cast<double>(j) / n;
      mesh.vertices.push_back({2 * x - 1, TerrainHeight(x, z, options.seed), 2 * z - 1});
    }
  }
  const auto at = [n](int i, int j) { return static_cast<std::uint32_t>(j * (n + 1) + i); };
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      mesh.triangles.push_back({at(i, j), at(i, j + 1), at(i + 1, j + 1)});
      mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i + 1, j)});
    }
  }
  return mesh;
}

}  // namespace kdray::client
