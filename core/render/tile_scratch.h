// SPDX-License-Identifier: Apache-2.0
// The memory of one thread that renders tiles, kept from tile to tile: allocating it for each would
// take as long as tracing.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/geometry/vec3.h"
#include "core/render/four.h"
#include "core/render/render_counts.h"
#include "core/render/sampler.h"

namespace kdray::core {

/// Unit normals (core/render/shading.h) of the triangles met last: neighbouring samples hit the
/// same ones.
class NormalCache {
 public:
  const Vec3f& Normal(const TriangleMesh& mesh, PrimitiveId id, RenderCounts* counts) {
    Entry& entry = entries_[id % kEntries];
    if (entry.id != id) [[unlikely]]
      Fill(mesh, id, &entry, counts);
    return entry.normal;
  }

 private:
  static constexpr std::size_t kEntries = 1024;
  struct Entry {
    PrimitiveId id = kNoPrimitive;
    Vec3f normal;
  };
  static void Fill(const TriangleMesh& mesh, PrimitiveId id, Entry* entry, RenderCounts* counts);

  std::array<Entry, kEntries> entries_;
};

/// Rays of one batch: enough for kernels that trace coherent rays together, few enough to stay in
/// the second-level cache with their hits.
inline constexpr std::size_t kRaysPerBatch = 4096;

/// Arrays of a batch; each user resizes what it needs.
struct TileScratch {
  /// Room for kRaysPerBatch rays of the camera, in double or single precision; ray_count are set.
  /// Not resized, because initialising a ray costs as much as making it.
  std::vector<Ray> rays = std::vector<Ray>(kRaysPerBatch);
  std::vector<RayF> float_rays = std::vector<RayF>(kRaysPerBatch);
  std::size_t ray_count = 0;
  std::vector<Hit> hits;                ///< of the ray_count rays
  std::vector<SampleWords> directions;  ///< random numbers of secondary rays
  std::vector<Vec3f> values;            ///< of the samples
  std::vector<Vec3f> normals;           ///< of the samples, towards the viewer
  std::vector<Vec3f> smooth_normals;    ///< of the samples, on the same side
  std::vector<Ray> secondary_rays;
  std::vector<std::uint8_t> occluded;
  struct Contribution {
    std::uint32_t sample;
    Vec3f value;
  };
  std::vector<Contribution> contributions;  ///< of the secondary rays, if they are not occluded
  /// What the eye compares of a centre: red, green and blue as displayed, and 1 for a hit.
  struct Look {
    FourFloats channels;
  };
  std::vector<Look> looks;            ///< row by row
  std::vector<std::uint8_t> is_step;  ///< of the same pixels
  NormalCache normal_cache;
  RenderCounts counts;

  /// PixelOrder of a tile of that size, made anew only when the size changes.
  const std::vector<std::uint32_t>& OrderOf(int width, int height);

 private:
  int order_width_ = 0, order_height_ = 0;
  std::vector<std::uint32_t> order_;
};

/// Hands out scratch memory. Safe from many threads at once. The counts are complete when all is
/// back.
class ScratchPool {
 public:
  class Lease {
   public:
    explicit Lease(ScratchPool* pool) : pool_(pool), scratch_(pool->Take()) {}
    ~Lease() { pool_->Return(std::move(scratch_)); }
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;
    TileScratch* get() const { return scratch_.get(); }

   private:
    ScratchPool* const pool_;
    std::unique_ptr<TileScratch> scratch_;
  };

  RenderCounts Counts() const;

 private:
  std::unique_ptr<TileScratch> Take();
  void Return(std::unique_ptr<TileScratch> scratch);

  mutable std::mutex mutex_;
  std::vector<std::unique_ptr<TileScratch>> free_;
};

}  // namespace kdray::core
