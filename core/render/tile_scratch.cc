// SPDX-License-Identifier: Apache-2.0
#include "core/render/tile_scratch.h"

#include "core/render/pixel_order.h"
#include "core/render/shading.h"

namespace kdray::core {

void NormalCache::Fill(const TriangleMesh& mesh, PrimitiveId id, Entry* entry,
                       RenderCounts* counts) {
  entry->id = id;
  entry->normal = Vec3f(UnitNormal(mesh, id));
  ++counts->normals;
}

const std::vector<std::uint32_t>& TileScratch::OrderOf(int width, int height) {
  if (width != order_width_ || height != order_height_) {
    order_ = PixelOrder(width, height);
    order_width_ = width;
    order_height_ = height;
  }
  return order_;
}

RenderCounts ScratchPool::Counts() const {
  const std::lock_guard lock(mutex_);
  RenderCounts sum;
  for (const auto& scratch : free_) sum.Add(scratch->counts);
  return sum;
}

std::unique_ptr<TileScratch> ScratchPool::Take() {
  {
    const std::lock_guard lock(mutex_);
    if (!free_.empty()) {
      std::unique_ptr<TileScratch> scratch = std::move(free_.back());
      free_.pop_back();
      return scratch;
    }
    free_.reserve(free_.capacity() + 1);
  }
  return std::make_unique<TileScratch>();
}

void ScratchPool::Return(std::unique_ptr<TileScratch> scratch) {
  const std::lock_guard lock(mutex_);
  free_.push_back(std::move(scratch));
}

}  // namespace kdray::core
