// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kdtree/partition.h"

#include <algorithm>
#include <array>
#include <cstdint>

namespace kdray::core {

ClippedHalves CutReference(const TriangleMesh& mesh, const PrimitiveRef& reference,
                           const Bounds3f& cell, const SplitPlane& plane) {
  const TriangleIndices& corners = mesh.triangles()[reference.id];
  return mesh.VisitVertices([&](auto vertices) {
    // Clips to the cell instead of the reference's bounds, because the cell's faces are fewer and
    // exact.
    return ClippedHalfBounds(
        std::array{vertices[corners[0]], vertices[corners[1]], vertices[corners[2]]}, cell,
        reference.bounds, plane.axis, plane.position);
  });
}

SideCounts CountSides(std::span<const PrimitiveRef> references, const SplitCandidate& split) {
  SideCounts counts;
  for (const PrimitiveRef& reference : references) {
    const unsigned side = static_cast<unsigned>(SideOf(reference, split));
    counts.below += side & 1u;
    counts.above += side >> 1;
  }
  return counts;
}

namespace {

// Large meshes do not fit the caches: prefetches the corners of the next references.
void PrefetchCorners(const TriangleMesh& mesh, std::span<const PrimitiveRef> next) {
  constexpr std::size_t kIndicesAhead = 8;
  constexpr std::size_t kVerticesAhead = 4;
  if (next.size() > kIndicesAhead) __builtin_prefetch(&mesh.triangles()[next[kIndicesAhead].id]);
  if (next.size() <= kVerticesAhead) return;
  mesh.VisitVertices([&](auto vertices) {
    for (const std::uint32_t corner : mesh.triangles()[next[kVerticesAhead].id]) {
      __builtin_prefetch(&vertices[corner]);
    }
  });
}

// `yes` if `which` is 1, `no` if it is 0: without the branch that a compiler may make of ?:.
PrimitiveRef* Choose(unsigned which, PrimitiveRef* yes, PrimitiveRef* no) {
  const std::uintptr_t a = reinterpret_cast<std::uintptr_t>(yes);
  const std::uintptr_t b = reinterpret_cast<std::uintptr_t>(no);
  return reinterpret_cast<PrimitiveRef*>(b ^ ((a ^ b) & (std::uintptr_t{0} - which)));
}

}  // namespace

SideCounts Distribute(const TriangleMesh& mesh, std::span<const PrimitiveRef> references,
                      const Bounds3f& cell, const SplitCandidate& split, PrimitiveRef* below,
                      PrimitiveRef* above, PrimitiveRef* cut) {
  // Each reference is written once, to a computed address, because branches would be unpredictable.
  PrimitiveRef* below_end = below;
  PrimitiveRef* above_end = above;
  PrimitiveRef* cut_end = cut;
  for (const PrimitiveRef& reference : references) {
    const Float4 low = LowOf(reference);
    const Float4 high = HighOf(reference);
    const unsigned side = static_cast<unsigned>(SideOf(reference, split));
    const unsigned is_below = side & 1u;
    const unsigned is_above = side >> 1;
    const unsigned is_cut = is_below & is_above;
    StorePrimitiveRef(low, high, Choose(is_cut, cut_end, Choose(is_above, above_end, below_end)));
    below_end += is_below ^ is_cut;
    above_end += is_above ^ is_cut;
    cut_end += is_cut;
  }
  SideCounts counts{static_cast<std::size_t>(below_end - below),
                    static_cast<std::size_t>(above_end - above)};
  const std::size_t cut_count = static_cast<std::size_t>(cut_end - cut);
  for (std::size_t i = 0; i < cut_count; ++i) {
    PrefetchCorners(mesh, std::span(cut, cut_count).subspan(i));
    const ClippedHalves parts = CutReference(mesh, cut[i], cell, split.plane);
    below[counts.below] = {parts.below, cut[i].id};
    counts.below += parts.below.IsEmpty() ? 0 : 1;
    above[counts.above] = {parts.above, cut[i].id};
    counts.above += parts.above.IsEmpty() ? 0 : 1;
  }
  return counts;
}

namespace {

// The places for a chunk's references, and the number of unused ones, because clipping left
// nothing.
struct Places {
  std::size_t first = 0;
  std::size_t count = 0;
  std::size_t used = 0;
  Bounds3f bounds;  // of the references in them
};

// Moves references from the end into unused places. The moves depend only on the chunks, and are
// few.
std::size_t CloseGaps(std::span<const Places> chunks, PrimitiveRef* references) {
  std::size_t total = 0;
  for (const Places& places : chunks) total += places.used;
  auto source = chunks.rbegin();  // of the references after `total`
  std::size_t left = 0;           // in that chunk
  if (!chunks.empty()) left = source->used;
  for (const Places& places : chunks) {
    for (std::size_t gap = places.first + places.used; gap < places.first + places.count; ++gap) {
      if (gap >= total) return total;
      while (left == 0) left = (++source)->used;
      references[gap] = references[source->first + --left];
    }
  }
  return total;
}

void Finish(std::span<const Places> chunks, Share* share) {
  share->references.Shorten(CloseGaps(chunks, share->references.data()));
  for (const Places& places : chunks) share->bounds.Extend(places.bounds);
}

}  // namespace

void DistributeInParallel(const TriangleMesh& mesh, std::span<const PrimitiveRef> references,
                          const Bounds3f& cell, const SplitCandidate& split, Share* below,
                          Share* above, BuildMonitor* monitor) {
  // Each chunk gets the number of places that CountSides() returns; gaps that clipping leaves are
  // closed at the end. A chunk that was skipped because the monitor stopped has no places, and is
  // skipped below too.
  const std::size_t chunks = ReferenceChunks(references.size());
  std::vector<Places> below_places(chunks), above_places(chunks);
  ForEachReferenceChunk(references, monitor,
                        [&](std::span<const PrimitiveRef> chunk, std::size_t c) {
                          const SideCounts counts = CountSides(chunk, split);
                          below_places[c].count = counts.below;
                          above_places[c].count = counts.above;
                        });
  for (std::size_t c = 1; c < chunks; ++c) {
    below_places[c].first = below_places[c - 1].first + below_places[c - 1].count;
    above_places[c].first = above_places[c - 1].first + above_places[c - 1].count;
  }
  below->references = PrimitiveRefArray(below_places.back().first + below_places.back().count);
  above->references = PrimitiveRefArray(above_places.back().first + above_places.back().count);

  const auto note = [](std::size_t used, Places* places, const Share& share) {
    places->used = used;
    // Computed while the references are in the cache.
    places->bounds = UnionBounds(std::span(share.references).subspan(places->first, used));
  };
  ForEachReferenceChunk(
      references, monitor, [&](std::span<const PrimitiveRef> chunk, std::size_t c) {
        PrimitiveRefArray cut(chunk.size());
        const SideCounts used =
            Distribute(mesh, chunk, cell, split, below->references.data() + below_places[c].first,
                       above->references.data() + above_places[c].first, cut.data());
        note(used.below, &below_places[c], *below);
        note(used.above, &above_places[c], *above);
      });
  if (monitor != nullptr && monitor->ShouldStop()) return;
  Finish(below_places, below);
  Finish(above_places, above);
}

}  // namespace kdray::core
