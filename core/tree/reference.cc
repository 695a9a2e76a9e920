#include "core/tree/reference.h"

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

ReferenceArray MakeReferences(const TriangleMesh& mesh) {
  ReferenceArray references(mesh.triangle_count());
  mesh.VisitVertices([&](auto vertices) {
    ParallelFor(0, references.size(), kReferenceChunk, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) {
        const PrimitiveId id = static_cast<PrimitiveId>(i);
        references.data()[i] = mesh.IsDegenerate(id)
                                   ? Reference{Bounds3f::Empty(), kNoPrimitive}
                                   : Reference{BoundsOf(vertices, mesh.triangles()[i]), id};
      }
    });
  });
  if (mesh.degenerate_count() != 0) {
    const Reference* const end = std::remove_if(references.begin(), references.end(),
                                                [](const auto& r) { return r.id == kNoPrimitive; });
    references.Shorten(static_cast<std::size_t>(end - references.begin()));
  }
  return references;
}

Bounds3f UnionBounds(std::span<const Reference> references) {
  if (references.size() <= kReferenceChunk) {
    Float4 low = Fill4(std::numeric_limits<float>::infinity());
    Float4 high = -low;
    for (const Reference& reference : references) {
      low = Min4(low, LowOf(reference));
      high = Max4(high, HighOf(reference));
    }
    return {{low[0], low[1], low[2]}, {high[0], high[1], high[2]}};
  }
  std::vector<Bounds3f> parts(ReferenceChunks(references.size()));
  ForEachReferenceChunk(
      references, [&](auto chunk, std::size_t number) { parts[number] = UnionBounds(chunk); });
  Bounds3f bounds = Bounds3f::Empty();
  for (const Bounds3f& part : parts) bounds.Extend(part);
  return bounds;
}

}  // namespace kdray::core
