// SPDX-License-Identifier: Apache-2.0
// From the hits of samples to their values: light, normals, occlusion. Secondary rays are traced in
// batches.
#pragma once

#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/geometry/vec3.h"
#include "core/render/color.h"
#include "core/render/light.h"
#include "core/render/renderer.h"
#include "core/render/tile_scratch.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"

namespace kdray::core {

/// Immutable, so safe from many threads at once, each with its own scratch. The scene must outlive
/// it.
class Shader {
 public:
  Shader(const Scene& scene, const RenderSpec& spec, const TraceOptions& trace_options);

  /// Fills scratch->values with a value for each of scratch->hits, which are the closest hits of
  /// `rays`; 0 0 0 for a miss. kShaded: linear light reflected to the viewer, at most the
  /// largest float. kNormal: the unit normal. kAmbientOcclusion: 1 or 0 in x, by one ray whose
  /// direction scratch->directions decides. Each value depends only on its own ray, hit and
  /// direction. Errors: kCancelled, kDeadlineExceeded.
  Status Shade(const RayBatch& rays, TileScratch* scratch) const;

  bool needs_directions() const { return mode_ == RenderMode::kAmbientOcclusion; }

  /// Luminance of a sample's value, ITU-R BT.709: of linear light, or of (n + 1) / 2 for a normal.
  double LuminanceOf(const Vec3f& value) const;

 private:
  template <class T>
  void ShadeByHeadlight(const RayOf<T>* rays, TileScratch* scratch) const;
  void WriteNormals(TileScratch* scratch) const;
  Status ShadeByLights(const RayBatch& rays, TileScratch* scratch) const;
  void AddHeadlight(const RayBatch& rays, TileScratch* scratch) const;
  Status AddLight(const LightSource& light, TileScratch* scratch) const;
  double CosineOf(const Vec3d& to_light, std::uint32_t sample, const TileScratch& scratch) const;
  void MultiplyByColors(TileScratch* scratch) const;
  Status FindOcclusion(const RayBatch& rays, TileScratch* scratch) const;
  void FaceViewer(const RayBatch& rays, TileScratch* scratch) const;
  Status AddVisible(TileScratch* scratch) const;
  Vec3d PointOf(const Hit& hit) const;

  const Scene& scene_;
  const TriangleMesh& mesh_;
  const RenderMode mode_;
  const TraceOptions trace_options_;
  const Vec3f color_;  // linear
  const bool has_lights_;
  const bool shadows_;
  const SurfaceValue smooth_normals_;
  const SurfaceValue file_colors_;
  std::vector<LightSource> lights_;
  const double ao_radius_;
};

/// Of linear light, ITU-R BT.709.
double LuminanceOf(float r, float g, float b);

/// The direction of a secondary ray: unit, on the side of `unit_normal`, with the density of the
/// cosine between the two, by a point of the unit square. Sources: Shirley and Chiu, "A Low
/// Distortion Map Between Disk and Square", JGT 2(3), 1997; Malley's method (Pharr, Jakob,
/// Humphreys, "Physically Based Rendering", 4th ed., A.5.3); Duff et al., "Building an Orthonormal
/// Basis, Revisited", JCGT 6(1), 2017.
Vec3d CosineDirection(const Vec3d& unit_normal, const SampleWords& at);

}  // namespace kdray::core
