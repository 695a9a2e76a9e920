// SPDX-License-Identifier: Apache-2.0
// What the benchmarks run on: meshes, rays and Embree over the same numbers.
#pragma once

#include <embree3/rtcore.h>

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::bench {

/// A camera and a lamp.
struct BenchView {
  core::Vec3d eye, target, up, lamp;
  double half_width = 0.45;  ///< of the picture, at distance 1
};

/// A mesh whose vertices are floats, as Embree's are.
struct BenchMesh {
  std::string name;
  core::MeshData data;
  std::optional<BenchView> view;  ///< for rooms; other meshes are seen from outside as a whole
};

/// "bunny_69k", "igea_268k", "classroom_111k" of the mesh collection; "scan_1m" and "scan_4m",
/// generated: FoldedSphere of 1,104,500 and 4,418,000 triangles; "classroom_inside" and
/// "classroom_outside", the classroom with a camera and a lamp inside, and as classroom_111k;
/// "office", generated: OfficeFloor from inside a room. Ends the program with a message when there
/// is no such mesh, or the collection is not there.
BenchMesh LoadBenchMesh(const std::string& name);

/// A sphere of 20 * frequency^2 triangles, displaced by waves of several lengths so that it has
/// folds and hollows as scans have, about 1 in size. The same on every machine except for the last
/// bits of sin.
core::MeshData FoldedSphere(int frequency);

/// That of the mesh; without one, the usual camera looks from the front, a little from above, and
/// sees the whole mesh. `mesh` is made of `bench`.
BenchView ViewOf(const core::TriangleMesh& mesh, const BenchMesh& bench);

/// Rays of one class, single precision.
struct BenchRays {
  std::string name;
  bool any = false;  ///< whether they ask for any hit
  std::vector<core::RayF> rays;
};

/// Six classes, deterministic: primary rays of a picture of 2 side x 2 side pixels in tiles of 8 x
/// 8; from the hits of one of side x side pixels diffuse rays (cosine about the normal) and shadow
/// rays (to a light above the mesh; any hit), each in the order of the pixels and shuffled; rays
/// through two random points of the bounds. `mesh` is made of `bench`.
std::vector<BenchRays> MakeRayClasses(const core::TriangleMesh& mesh, const BenchMesh& bench,
                                      int side);

/// Embree asks that denormals are flushed to zero; our own code refuses to run so. Only around
/// calls of Embree.
class FlushDenormals {
 public:
  FlushDenormals();
  ~FlushDenormals();
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  unsigned before_;
};

/// One Embree scene over a mesh; it keeps its own copy of the numbers.
class EmbreeScene {
 public:
  EmbreeScene(const core::MeshData& data, RTCBuildQuality quality, bool robust, int threads);
  ~EmbreeScene();
  EmbreeScene(const EmbreeScene&) = delete;
  EmbreeScene& operator=(const EmbreeScene&) = delete;

  RTCScene scene() const { return scene_; }
  double build_seconds() const { return build_seconds_; }
  std::size_t bytes() const {
    return bytes_;
  }  ///< that Embree holds after the build, vertices left out

 private:
  RTCDevice device_;
  RTCScene scene_;
  double build_seconds_ = 0;
  std::size_t bytes_ = 0;
};

/// Whether two distances along a ray, infinite for a miss, are a mismatch: hit and miss, or apart
/// by more than 1e-3 of `theirs`.
bool IsMismatch(double ours, double theirs);

/// Median, smallest and largest.
struct Spread {
  double median = 0, low = 0, high = 0;
};
Spread SpreadOf(std::vector<double> values);

/// The processor's name, the number of its cores and the load, for a report's head.
std::string MachineLine();

}  // namespace kdray::bench
