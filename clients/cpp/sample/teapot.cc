// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/sample/teapot.h"

#include "clients/cpp/sample/mesh_builder.h"

namespace kdray::client {
namespace {

// Newell's own axes in this table: x from handle to spout, z up, and y >= 0 the half that is drawn;
// the other half is its mirror image.

// A point of the turned profile: radius and height; and how far the two inner control points of a
// quarter turn stand off, (radius, reach) and (reach, radius). 0.56 radius approximates a circle.
struct ProfilePoint {
  double radius;
  double z;
  double reach;
};

constexpr ProfilePoint On(double radius, double z) { return {radius, z, 0.56 * radius}; }

// From the top of the knob down to the middle of the bottom.
constexpr ProfilePoint kTurned[6][4] = {
    {On(0, 3.15), {0.8, 3.15, 0.45}, On(0, 2.85), On(0.2, 2.7)},             // knob
    {On(0.2, 2.7), On(0.4, 2.55), On(1.3, 2.55), On(1.3, 2.4)},              // lid
    {On(1.4, 2.4), On(1.3375, 2.53125), On(1.4375, 2.53125), On(1.5, 2.4)},  // rim
    {On(1.5, 2.4), On(1.75, 1.875), On(2, 1.35), On(2, 0.9)},                // upper body
    {On(2, 0.9), On(2, 0.45), On(1.5, 0.225), On(1.5, 0.15)},                // lower body
    {On(1.5, 0.15), On(1.5, 0.075), On(1.425, 0), On(0, 0)}};                // bottom
constexpr int kLid = 1;  // the piece after which the gap to the rim opens

// A half tube: row by row along it, each row half way around.
using HalfTube = Point[7][4];

constexpr HalfTube kHandle = {
    {{-1.6, 0, 2.025}, {-1.6, 0.3, 2.025}, {-1.5, 0.3, 2.25}, {-1.5, 0, 2.25}},
    {{-2.3, 0, 2.025}, {-2.3, 0.3, 2.025}, {-2.5, 0.3, 2.25}, {-2.5, 0, 2.25}},
    {{-2.7, 0, 2.025}, {-2.7, 0.3, 2.025}, {-3, 0.3, 2.25}, {-3, 0, 2.25}},
    {{-2.7, 0, 1.8}, {-2.7, 0.3, 1.8}, {-3, 0.3, 1.8}, {-3, 0, 1.8}},
    {{-2.7, 0, 1.575}, {-2.7, 0.3, 1.575}, {-3, 0.3, 1.35}, {-3, 0, 1.35}},
    {{-2.5, 0, 1.125}, {-2.5, 0.3, 1.125}, {-2.65, 0.3, 0.9375}, {-2.65, 0, 0.9375}},
    {{-2, 0, 0.9}, {-2, 0.3, 0.9}, {-1.9, 0.3, 0.6}, {-1.9, 0, 0.6}}};

constexpr HalfTube kSpout = {
    {{1.7, 0, 1.425}, {1.7, 0.66, 1.425}, {1.7, 0.66, 0.6}, {1.7, 0, 0.6}},
    {{2.6, 0, 1.425}, {2.6, 0.66, 1.425}, {3.1, 0.66, 0.825}, {3.1, 0, 0.825}},
    {{2.3, 0, 2.1}, {2.3, 0.25, 2.1}, {2.4, 0.25, 2.025}, {2.4, 0, 2.025}},
    {{2.7, 0, 2.4}, {2.7, 0.25, 2.4}, {3.3, 0.25, 2.4}, {3.3, 0, 2.4}},
    {{2.8, 0, 2.475}, {2.8, 0.25, 2.475}, {3.525, 0.25, 2.49375}, {3.525, 0, 2.49375}},
    {{2.9, 0, 2.475}, {2.9, 0.15, 2.475}, {3.45, 0.15, 2.5125}, {3.45, 0, 2.5125}},
    {{2.8, 0, 2.4}, {2.8, 0.15, 2.4}, {3.2, 0.15, 2.4}, {3.2, 0, 2.4}}};

// Cubic Bernstein weights. At t = 0 and t = 1 they are exactly 0 and 1, so patches that share a
// border agree on it bit for bit.
std::array<double, 4> Weights(double t) {
  const double s = 1 - t;
  return {s * s * s, 3 * s * s * t, 3 * s * t * t, t * t * t};
}

// From Newell's axes to y up.
Point Upright(double x, double y, double z) { return {x, z, -y}; }

// One point of the turned body: `p` on the profile, `u` in [0, 1] within a quarter turn.
Point TurnedPoint(const ProfilePoint& p, int quarter, double u) {
  const auto w = Weights(u);
  const double a = p.radius * (w[0] + w[1]) + p.reach * w[2];
  const double b = p.reach * w[1] + p.radius * (w[2] + w[3]);
  switch (quarter) {
    case 0:
      return Upright(a, b, p.z);
    case 1:
      return Upright(-b, a, p.z);
    case 2:
      return Upright(-a, -b, p.z);
    default:
      return Upright(b, -a, p.z);
  }
}

ProfilePoint ProfileAt(const ProfilePoint (&curve)[4], double v) {
  const auto w = Weights(v);
  ProfilePoint p{};
  for (int i = 0; i < 4; ++i) {
    p.radius += w[i] * curve[i].radius;
    p.z += w[i] * curve[i].z;
    p.reach += w[i] * curve[i].reach;
  }
  return p;
}

// The strip between two heights of the profile, all the way around.
void AddRing(const ProfilePoint& upper, const ProfilePoint& lower, int detail,
             MeshBuilder& builder) {
  for (int quarter = 0; quarter < 4; ++quarter) {
    for (int i = 0; i < detail; ++i) {
      const double u0 = static_cast<double>(i) / detail;
      const double u1 = static_cast<double>(i + 1) / detail;
      builder.AddQuad(TurnedPoint(upper, quarter, u0), TurnedPoint(lower, quarter, u0),
                      TurnedPoint(lower, quarter, u1), TurnedPoint(upper, quarter, u1));
    }
  }
}

void AddPot(int detail, MeshBuilder& builder) {
  for (int piece = 0; piece < 6; ++piece) {
    for (int j = 0; j < detail; ++j) {
      AddRing(ProfileAt(kTurned[piece], static_cast<double>(j) / detail),
              ProfileAt(kTurned[piece], static_cast<double>(j + 1) / detail), detail, builder);
    }
    if (piece == kLid) AddRing(kTurned[kLid][3], kTurned[kLid + 1][0], detail, builder);
  }
}

Point TubePoint(const HalfTube& tube, int patch, double u, double v) {
  const auto along = Weights(v);
  const auto around = Weights(u);
  Point p{};
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column)
      for (int axis = 0; axis < 3; ++axis)
        p[axis] += along[row] * around[column] * tube[3 * patch + row][column][axis];
  return p;
}

// Both halves of a tube and a flat cap on each end.
void AddTube(const HalfTube& tube, int detail, MeshBuilder& builder) {
  const auto at = [&](int i, int j, int side) {
    const int patch = j < detail ? 0 : 1;
    const Point p = TubePoint(tube, patch, static_cast<double>(i) / detail,
                              static_cast<double>(j - patch * detail) / detail);
    return Upright(p[0], side * p[1], p[2]);
  };
  const auto add = [&](bool flip, const Point& a, const Point& b, const Point& c, const Point& d) {
    flip ? builder.AddQuad(d, c, b, a) : builder.AddQuad(a, b, c, d);
  };
  for (int i = 0; i < detail; ++i) {
    for (int j = 0; j < 2 * detail; ++j) {
      for (const int side : {1, -1})
        add(side < 0, at(i, j, side), at(i, j + 1, side), at(i + 1, j + 1, side),
            at(i + 1, j, side));
    }
    for (const int end : {0, 2 * detail})
      add(end == 0, at(i, end, 1), at(i, end, -1), at(i + 1, end, -1), at(i + 1, end, 1));
  }
}

}  // namespace

SampleMesh MakeTeapot(const SampleOptions& options) {
  // Each part has its own table of vertices: where they run into each other they stay apart.
  SampleMesh teapot;
  const auto append = [&](MeshBuilder&& builder) {
    const SampleMesh part = std::move(builder).Take();
    const auto first = static_cast<std::uint32_t>(teapot.vertices.size());
    teapot.vertices.insert(teapot.vertices.end(), part.vertices.begin(), part.vertices.end());
    for (const Face& face : part.triangles)
      teapot.triangles.push_back({first + face[0], first + face[1], first + face[2]});
  };
  MeshBuilder pot;
  AddPot(options.detail, pot);
  append(std::move(pot));
  for (const auto* tube : {&kHandle, &kSpout}) {
    MeshBuilder builder;
    AddTube(*tube, options.detail, builder);
    append(std::move(builder));
  }
  return teapot;
}

}  // namespace kdray::client
