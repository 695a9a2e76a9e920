// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/interior.h"

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>

#include "core/geometry/vec3.h"

namespace kdray::bench {
namespace {

using core::MeshData;
using core::Vec3d;
using core::Vec3f;

constexpr double kLength = 40, kWidth = 24, kHeight = 3;

/// Adds shapes to a mesh, turned about the vertical and moved.
class Shapes {
 public:
  explicit Shapes(MeshData* data) : data_(*data) {}

  void Place(const Vec3d& at, double angle) {
    at_ = at;
    cos_ = std::cos(angle);
    sin_ = std::sin(angle);
  }

  void Box(const Vec3d& low, const Vec3d& high) {
    const std::uint32_t first = Next();
    for (unsigned i = 0; i < 8; ++i) {
      Vertex({(i & 1) != 0 ? high.x : low.x, (i & 2) != 0 ? high.y : low.y,
              (i & 4) != 0 ? high.z : low.z});
    }
    constexpr std::uint32_t kFaces[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                            {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    for (const auto& f : kFaces) Quad(first + f[0], first + f[1], first + f[2], first + f[3]);
  }

  void Tube(const Vec3d& from, const Vec3d& to, double radius, std::uint32_t sides) {
    const Vec3d along = core::Normalized(to - from);
    const Vec3d other = std::fabs(along.y) < 0.9 ? Vec3d{0, 1, 0} : Vec3d{1, 0, 0};
    const Vec3d x = core::Normalized(core::Cross(along, other)), y = core::Cross(along, x);
    const std::uint32_t first = Next();
    for (std::uint32_t i = 0; i < sides; ++i) {
      const double angle = 2 * std::numbers::pi * i / sides;
      const Vec3d out = (x * std::cos(angle) + y * std::sin(angle)) * radius;
      Vertex(from + out);
      Vertex(to + out);
    }
    for (std::uint32_t i = 0; i < sides; ++i) {
      const std::uint32_t a = first + 2 * i, b = first + 2 * ((i + 1) % sides);
      Quad(a, b, b + 1, a + 1);
    }
  }

  void Ball(const Vec3d& center, double radius, std::uint32_t rings) {
    const std::uint32_t sides = 2 * rings, first = Next();
    for (std::uint32_t r = 0; r <= rings; ++r) {
      const double down = std::numbers::pi * r / rings;
      for (std::uint32_t i = 0; i < sides; ++i) {
        const double around = 2 * std::numbers::pi * i / sides;
        Vertex(center + Vec3d{std::sin(down) * std::cos(around), std::cos(down),
                              std::sin(down) * std::sin(around)} *
                            radius);
      }
    }
    for (std::uint32_t r = 0; r < rings; ++r) {
      for (std::uint32_t i = 0; i < sides; ++i) {
        const std::uint32_t a = first + r * sides + i, b = first + r * sides + (i + 1) % sides;
        Quad(a, b, b + sides, a + sides);
      }
    }
  }

 private:
  std::uint32_t Next() const { return static_cast<std::uint32_t>(data_.vertices.size()); }
  void Vertex(const Vec3d& p) {
    const Vec3d turned{p.x * cos_ - p.z * sin_, p.y, p.x * sin_ + p.z * cos_};
    data_.vertices.push_back(Vec3d(Vec3f(turned + at_)));
  }
  void Quad(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
    data_.triangles.push_back({a, b, c});
    data_.triangles.push_back({a, c, d});
  }

  MeshData& data_;
  Vec3d at_{0, 0, 0};
  double cos_ = 1, sin_ = 0;
};

void AddShell(Shapes* shapes) {
  shapes->Place({0, 0, 0}, 0);
  shapes->Box({0, -0.2, 0}, {kLength, 0, kWidth});
  shapes->Box({0, kHeight, 0}, {kLength, kHeight + 0.2, kWidth});
  for (const double x : {0.0, kLength - 0.2}) {
    shapes->Box({x, 0, 0}, {x + 0.2, kHeight, kWidth});
  }
  // The long sides have a parapet and a lintel, between them windows with blinds.
  for (const double z : {0.0, kWidth - 0.2}) {
    shapes->Box({0, 0, z}, {kLength, 0.9, z + 0.2});
    shapes->Box({0, 2.4, z}, {kLength, kHeight, z + 0.2});
    for (int slat = 0; slat < 60; ++slat) {
      const double y = 0.92 + 0.0245 * slat;
      for (int window = 0; window < 10; ++window) {
        shapes->Place({4.0 * window + 2, y, z + 0.1}, 0.002 * window);
        shapes->Box({-1.9, 0, -0.02}, {1.9, 0.001, 0.02});
      }
    }
    shapes->Place({0, 0, 0}, 0);
  }
  // Walls between the rooms, with a door each, along a corridor in the middle.
  for (const double z : {10.5, 13.3}) {
    for (int room = 0; room < 5; ++room) {
      const double x = 8.0 * room;
      shapes->Box({x, 0, z}, {x + 3.4, kHeight, z + 0.2});
      shapes->Box({x + 4.6, 0, z}, {x + 8, kHeight, z + 0.2});
      shapes->Box({x + 3.4, 2.1, z}, {x + 4.6, kHeight, z + 0.2});
    }
  }
  for (int wall = 1; wall < 5; ++wall) {
    shapes->Box({8.0 * wall - 0.1, 0, 0}, {8.0 * wall + 0.1, kHeight, 10.5});
    shapes->Box({8.0 * wall - 0.1, 0, 13.5}, {8.0 * wall + 0.1, kHeight, kWidth});
    for (const double z : {10.4, 13.6}) {
      shapes->Tube({8.0 * wall, 0, z}, {8.0 * wall, kHeight, z}, 0.25, 96);
    }
  }
  for (int pipe = 0; pipe < 24; ++pipe) {
    const double y = kHeight - 0.08 - 0.05 * (pipe % 3), z = 1.0 * pipe + 0.5;
    shapes->Tube({0.2, y, z}, {kLength - 0.2, y - 0.02, z + 0.3}, 0.02, 16);
  }
}

void AddDesk(Shapes* shapes) {
  shapes->Box({-0.8, 0.71, -0.4}, {0.8, 0.74, 0.4});
  for (const double x : {-0.75, 0.75}) {
    for (const double z : {-0.35, 0.35}) shapes->Tube({x, 0, z}, {x, 0.71, z}, 0.02, 24);
  }
  shapes->Box({-0.3, 0.9, -0.25}, {0.3, 1.25, -0.23});
  shapes->Tube({0, 0.74, -0.24}, {0, 0.9, -0.24}, 0.02, 24);
  for (int row = 0; row < 5; ++row) {
    for (int key = 0; key < 15; ++key) {
      const double x = -0.2 + 0.02 * key, z = 0.02 * row;
      shapes->Box({x, 0.75, z}, {x + 0.017, 0.757, z + 0.017});
    }
  }
  shapes->Ball({0.6, 0.98, -0.2}, 0.09, 24);
  shapes->Tube({0.6, 0.74, -0.2}, {0.6, 0.9, -0.2}, 0.01, 24);
  shapes->Box({-0.25, 0.42, 0.6}, {0.25, 0.46, 1.05});
  shapes->Box({-0.25, 0.5, 1.05}, {0.25, 0.95, 1.08});
  for (int leg = 0; leg < 5; ++leg) {
    const double angle = 2 * std::numbers::pi * leg / 5;
    shapes->Tube({0, 0.1, 0.82}, {0.28 * std::cos(angle), 0.03, 0.82 + 0.28 * std::sin(angle)},
                 0.015, 16);
    shapes->Ball({0.28 * std::cos(angle), 0.03, 0.82 + 0.28 * std::sin(angle)}, 0.03, 6);
  }
  shapes->Tube({0, 0.1, 0.82}, {0, 0.42, 0.82}, 0.03, 24);
}

}  // namespace

MeshData OfficeFloor() {
  MeshData data;
  data.single_precision = true;
  Shapes shapes(&data);
  AddShell(&shapes);
  std::mt19937_64 engine(1977);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * 0x1p-53 * static_cast<double>(engine() >> 11);
  };
  for (int room = 0; room < 10; ++room) {
    const double x = 8.0 * (room % 5), z = room < 5 ? 0.6 : 13.9;
    for (int desk = 0; desk < 6; ++desk) {
      shapes.Place({x + 2 + 2 * (desk % 3) + uniform(-0.1, 0.1), 0,
                    z + 2.2 + 4.6 * (desk / 3) + uniform(-0.3, 0.3)},
                   uniform(0, 2 * std::numbers::pi));
      AddDesk(&shapes);
    }
    // A shelf with books.
    shapes.Place({x + 7.5, 0, z + 1.5}, 0);
    for (int board = 0; board < 5; ++board) {
      shapes.Box({0, 0.4 * board, 0}, {0.3, 0.4 * board + 0.02, 6});
      for (int book = 0; book < 150; ++book) {
        const double at = 0.04 * book, height = uniform(0.2, 0.34);
        shapes.Box({0.02, 0.4 * board + 0.02, at},
                   {uniform(0.15, 0.25), 0.4 * board + 0.02 + height, at + uniform(0.01, 0.038)});
      }
    }
    shapes.Place({x + 4, kHeight - 0.35, z + 4.5}, 0);
    shapes.Ball({0, 0, 0}, 0.18, 48);
  }
  return data;
}

}  // namespace kdray::bench
