// SPDX-License-Identifier: Apache-2.0
#include "core/accel/primitive_ref.h"

#include <limits>

namespace kdray::core {

namespace {

Bounds3f BoundsOf(std::span<const Vec3f> vertices, const TriangleIndices& corners) {
  Bounds3f bounds = Bounds3f::Empty();
  for (const std::uint32_t corner : corners) bounds.Extend(vertices[corner]);
  return bounds;
}
Bounds3f BoundsOf(std::span<const Vec3d> vertices, const TriangleIndices& corners) {
  Bounds3d bounds = Bounds3d::Empty();
  for (const std::uint32_t corner : corners) bounds.Extend(vertices[corner]);
  return RoundOutward(bounds);
}

}  // namespace

PrimitiveRefArray MakePrimitiveRefs(const TriangleMesh& mesh, BuildMonitor* monitor) {
  PrimitiveRefArray references(mesh.triangle_count());
  mesh.VisitVertices([&](auto vertices) {
    ParallelFor(0, references.size(), kReferenceChunk, [&](std::size_t first, std::size_t last) {
      if (monitor != nullptr && monitor->ShouldStop()) return;
      for (std::size_t i = first; i < last; ++i) {
        const PrimitiveId id = static_cast<PrimitiveId>(i);
        references.data()[i] = mesh.IsDegenerate(id)
                                   ? PrimitiveRef{Bounds3f::Empty(), kNoPrimitive}
                                   : PrimitiveRef{BoundsOf(vertices, mesh.triangles()[i]), id};
      }
    });
  });
  if (mesh.degenerate_count() != 0) {
    CancelPoll poll = monitor != nullptr ? monitor->MakePoll() : CancelPoll(CancelToken());
    std::size_t kept = 0;
    PolledLoop(references.size(), 4, &poll, [&](std::size_t i) {
      const PrimitiveRef& reference = references.data()[i];
      if (reference.id != kNoPrimitive) references.data()[kept++] = reference;
    });
    references.Shorten(kept);
  }
  return references;
}

Bounds3f UnionBounds(std::span<const PrimitiveRef> references, BuildMonitor* monitor) {
  if (references.size() <= kReferenceChunk) {
    Float4 low = Fill4(std::numeric_limits<float>::infinity());
    Float4 high = -low;
    for (const PrimitiveRef& reference : references) {
      low = Min4(low, LowOf(reference));
      high = Max4(high, HighOf(reference));
    }
    return {{low[0], low[1], low[2]}, {high[0], high[1], high[2]}};
  }
  std::vector<Bounds3f> parts(ReferenceChunks(references.size()), Bounds3f::Empty());
  ForEachReferenceChunk(references, monitor, [&](auto chunk, std::size_t number) {
    parts[number] = UnionBounds(chunk);
  });
  Bounds3f bounds = Bounds3f::Empty();
  for (const Bounds3f& part : parts) bounds.Extend(part);
  return bounds;
}

}  // namespace kdray::core
