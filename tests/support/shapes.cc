// SPDX-License-Identifier: Apache-2.0
#include "tests/support/shapes.h"

#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <utility>

#include "tests/support/seed.h"

namespace kdray::test {

using core::MeshData;
using core::TriangleIndices;
using core::Vec3d;

namespace {

std::uint32_t AddVertex(MeshData* mesh, const Vec3d& p) {
  mesh->vertices.push_back(p);
  return static_cast<std::uint32_t>(mesh->vertices.size() - 1);
}

void AddTriangle(MeshData* mesh, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  const std::uint32_t first = AddVertex(mesh, a);
  AddVertex(mesh, b);
  AddVertex(mesh, c);
  mesh->triangles.push_back({first, first + 1, first + 2});
}

// Uniform in [low, high). std::uniform_real_distribution may differ between libraries.
double Uniform(std::mt19937_64& engine, double low, double high) {
  return low + (high - low) * std::ldexp(static_cast<double>(engine() >> 11), -53);
}

Vec3d UniformVec(std::mt19937_64& engine, double low, double high) {
  const double x = Uniform(engine, low, high);
  const double y = Uniform(engine, low, high);
  const double z = Uniform(engine, low, high);
  return {x, y, z};
}

// A sphere-like surface: radius(theta, phi) around `center`.
template <class Radius>
MeshData RingedSurface(const Vec3d& center, int rings, int segments, const Radius& radius) {
  MeshData mesh;
  const auto point = [&](double theta, double phi) {
    const double r = radius(theta, phi);
    return center + Vec3d{r * std::sin(theta) * std::cos(phi), r * std::sin(theta) * std::sin(phi),
                          r * std::cos(theta)};
  };
  constexpr double kPi = std::numbers::pi;
  const std::uint32_t top = AddVertex(&mesh, point(0, 0));
  for (int ring = 1; ring < rings; ++ring) {
    for (int segment = 0; segment < segments; ++segment) {
      AddVertex(&mesh, point(kPi * ring / rings, 2 * kPi * segment / segments));
    }
  }
  const std::uint32_t bottom = AddVertex(&mesh, point(kPi, 0));

  const auto at = [&](int ring, int segment) {
    return static_cast<std::uint32_t>(1 + (ring - 1) * segments + segment % segments);
  };
  for (int s = 0; s < segments; ++s) mesh.triangles.push_back({top, at(1, s), at(1, s + 1)});
  for (int ring = 1; ring + 1 < rings; ++ring) {
    for (int s = 0; s < segments; ++s) {
      mesh.triangles.push_back({at(ring, s), at(ring + 1, s), at(ring + 1, s + 1)});
      mesh.triangles.push_back({at(ring, s), at(ring + 1, s + 1), at(ring, s + 1)});
    }
  }
  for (int s = 0; s < segments; ++s) {
    mesh.triangles.push_back({at(rings - 1, s), bottom, at(rings - 1, s + 1)});
  }
  return mesh;
}

}  // namespace

MeshData RoundToFloat(MeshData mesh) {
  for (Vec3d& p : mesh.vertices) p = Vec3d(core::Vec3f(p));
  mesh.single_precision = true;
  return mesh;
}

MeshData Join(MeshData a, const MeshData& b) {
  const std::uint32_t shift = static_cast<std::uint32_t>(a.vertices.size());
  a.vertices.insert(a.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const TriangleIndices& t : b.triangles) {
    a.triangles.push_back({t[0] + shift, t[1] + shift, t[2] + shift});
  }
  a.single_precision = a.single_precision && b.single_precision;
  return a;
}

MeshData UvSphere(const Vec3d& center, double radius, int rings, int segments) {
  return RingedSurface(center, rings, segments, [&](double, double) { return radius; });
}

MeshData BumpySphere(const Vec3d& center, double radius, int rings, int segments,
                     double amplitude) {
  return RingedSurface(center, rings, segments, [&](double theta, double phi) {
    // sin^2 keeps the poles one point whatever phi is.
    const double s = std::sin(theta);
    return radius * (1 + amplitude * s * s * std::cos(5 * phi) * std::cos(4 * theta));
  });
}

MeshData IcoSphere(const Vec3d& center, double radius, int subdivisions) {
  const double g = std::numbers::phi;
  std::vector<Vec3d> directions = {{-1, g, 0}, {1, g, 0}, {-1, -g, 0}, {1, -g, 0},
                                   {0, -1, g}, {0, 1, g}, {0, -1, -g}, {0, 1, -g},
                                   {g, 0, -1}, {g, 0, 1}, {-g, 0, -1}, {-g, 0, 1}};
  std::vector<TriangleIndices> triangles = {
      {0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
      {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
      {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  for (int level = 0; level < subdivisions; ++level) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [place, is_new] = middles.try_emplace(
          {std::min(a, b), std::max(a, b)}, static_cast<std::uint32_t>(directions.size()));
      if (is_new) {
        directions.push_back(core::Normalized(directions[a]) + core::Normalized(directions[b]));
      }
      return place->second;
    };
    std::vector<TriangleIndices> finer;
    for (const auto& [a, b, c] : triangles) {
      const std::uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
    triangles = std::move(finer);
  }
  MeshData mesh;
  for (const Vec3d& d : directions) AddVertex(&mesh, center + core::Normalized(d) * radius);
  mesh.triangles = std::move(triangles);
  return mesh;
}

MeshData Cube(const Vec3d& center, double half_edge) {
  MeshData mesh;
  for (int corner = 0; corner < 8; ++corner) {
    AddVertex(&mesh, center + half_edge * Vec3d{corner & 1 ? 1.0 : -1.0, corner & 2 ? 1.0 : -1.0,
                                                corner & 4 ? 1.0 : -1.0});
  }
  constexpr std::array<std::array<std::uint32_t, 4>, 6> kFaces = {
      {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}}};
  for (const auto& [a, b, c, d] : kFaces) {
    mesh.triangles.push_back({a, b, c});
    mesh.triangles.push_back({a, c, d});
  }
  return mesh;
}

MeshData Grid(int cells, int axis, double height) {
  MeshData mesh;
  for (int j = 0; j <= cells; ++j) {
    for (int i = 0; i <= cells; ++i) {
      Vec3d p;
      p[axis] = height;
      p[(axis + 1) % 3] = static_cast<double>(i) / cells;
      p[(axis + 2) % 3] = static_cast<double>(j) / cells;
      AddVertex(&mesh, p);
    }
  }
  for (int j = 0; j < cells; ++j) {
    for (int i = 0; i < cells; ++i) {
      const std::uint32_t a = static_cast<std::uint32_t>(j * (cells + 1) + i);
      const std::uint32_t up = static_cast<std::uint32_t>(cells + 1);
      mesh.triangles.push_back({a, a + 1, a + 1 + up});
      mesh.triangles.push_back({a, a + 1 + up, a + up});
    }
  }
  return mesh;
}

MeshData Soup(std::size_t count, double size, std::uint64_t stream) {
  MeshData mesh;
  std::mt19937_64 engine = RandomEngine(stream);
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3d place = UniformVec(engine, 0, 1);
    const Vec3d a = place + UniformVec(engine, -size, size);
    const Vec3d b = place + UniformVec(engine, -size, size);
    const Vec3d c = place + UniformVec(engine, -size, size);
    AddTriangle(&mesh, a, b, c);
  }
  return mesh;
}

MeshData Coincident(std::size_t count) {
  MeshData mesh;
  AddTriangle(&mesh, {0.1, 0.2, 0.3}, {0.9, 0.4, 0.5}, {0.3, 0.8, 0.7});
  mesh.triangles.resize(count, mesh.triangles.front());
  return mesh;
}

MeshData Straddling(std::size_t count, std::uint64_t stream) {
  MeshData mesh;
  std::mt19937_64 engine = RandomEngine(stream);
  for (std::size_t i = 0; i < count; ++i) {
    // Two corners in opposite octants, so the triangle crosses each coordinate plane.
    const Vec3d a = UniformVec(engine, 0.5, 1);
    const Vec3d b = -UniformVec(engine, 0.5, 1);
    AddTriangle(&mesh, a, b, UniformVec(engine, -1, 1));
  }
  return mesh;
}

MeshData Comb(std::size_t teeth) {
  MeshData mesh;
  for (std::size_t i = 0; i < teeth; ++i) {
    const double x = static_cast<double>(i) / static_cast<double>(teeth);
    const double width = 0.4 / static_cast<double>(teeth);
    // A blade with a narrow triangular section, one end closed.
    const Vec3d a{x, 0, 0}, b{x + width, 0, 0}, c{x, 0, 0.01}, tip{x, 1, 0};
    AddTriangle(&mesh, a, b, tip);
    AddTriangle(&mesh, b, c, tip);
    AddTriangle(&mesh, c, a, tip);
    AddTriangle(&mesh, a, c, b);
  }
  return mesh;
}

MeshData Spiral(std::size_t count, int turns) {
  MeshData mesh;
  const std::size_t steps = count / 2;
  for (std::size_t i = 0; i <= steps; ++i) {
    const double s = static_cast<double>(i) / static_cast<double>(steps);
    const double angle = 2 * std::numbers::pi * turns * s;
    const double r = 0.01 + 0.99 * s;
    AddVertex(&mesh, {r * std::cos(angle), r * std::sin(angle), 0});
    AddVertex(&mesh, {r * std::cos(angle), r * std::sin(angle), 0.5});
  }
  for (std::size_t i = 0; i < steps; ++i) {
    const std::uint32_t a = static_cast<std::uint32_t>(2 * i);
    mesh.triangles.push_back({a, a + 2, a + 1});
    mesh.triangles.push_back({a + 1, a + 2, a + 3});
  }
  return mesh;
}

MeshData Staircase(std::size_t count) {
  MeshData mesh;
  for (std::size_t i = 0; i < count; ++i) {
    const double step = 1 / static_cast<double>(count);
    const double low = (static_cast<double>(i) + 0.25) * step;
    const double high = low + 0.5 * step;
    AddTriangle(&mesh, {low, low, high}, {high, low, low}, {low, high, low});
  }
  return mesh;
}

MeshData Nest(int levels) {
  MeshData mesh;
  for (int level = 0; level < levels; ++level) {
    mesh = Join(std::move(mesh), Cube({0, 0, 0}, std::ldexp(1.0, level - levels)));
  }
  return mesh;
}

}  // namespace kdray::test
