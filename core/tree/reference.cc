#include "core/tree/reference.h"

#include <limits>

namespace kdray::core {

std::vector<Reference> MakeReferences(const TriangleMesh& mesh) {
  std::vector<Reference> references(mesh.triangle_count());
  ParallelFor(0, references.size(), kReferenceChunk, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      const PrimitiveId id = static_cast<PrimitiveId>(i);
      if (mesh.IsDegenerate(id)) continue;
      Bounds3d bounds = Bounds3d::Empty();
      for (int corner = 0; corner < 3; ++corner) bounds.Extend(mesh.LocalCorner(id, corner));
      references[i] = {RoundOutward(bounds), id};
    }
  });
  if (mesh.degenerate_count() != 0) {
    std::erase_if(references, [](const Reference& r) { return r.id == kNoPrimitive; });
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
