#include "core/kdtree/partition.h"

#include <algorithm>
#include <array>

namespace kdray::core {

ClippedHalves CutReference(const TriangleMesh& mesh, const Reference& reference,
                           const Bounds3f& cell, const SplitPlane& plane) {
  const TriangleIndices& corners = mesh.triangles()[reference.id];
  return mesh.VisitVertices([&](auto vertices) {
    // Clip to the cell rather than to the reference's bounds: its faces are fewer, and exact.
    return ClippedHalfBounds(
        std::array{vertices[corners[0]], vertices[corners[1]], vertices[corners[2]]}, cell,
        reference.bounds, plane.axis, plane.position);
  });
}

SideCounts CountSides(std::span<const Reference> references, const SplitCandidate& split) {
  SideCounts counts;
  for (const Reference& reference : references) {
    const unsigned side = static_cast<unsigned>(SideOf(reference, split));
    counts.below += side & 1u;
    counts.above += side >> 1;
  }
  return counts;
}

namespace {

// Large meshes do not fit the caches: asks early for what the next references will need.
void PrefetchCorners(const TriangleMesh& mesh, std::span<const Reference> next) {
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

}  // namespace

SideCounts Distribute(const TriangleMesh& mesh, std::span<const Reference> references,
                      const Bounds3f& cell, const SplitCandidate& split, Reference* below,
                      Reference* above, Reference* cut) {
  SideCounts counts;
  std::size_t cut_count = 0;
  for (std::size_t i = 0; i < references.size(); ++i) {
    // Each is written to all three places and stays in one: branches could not be foretold.
    const Float4 low = LowOf(references[i]);
    const Float4 high = HighOf(references[i]);
    const unsigned side = static_cast<unsigned>(SideOf(references[i], split));
    const unsigned both = side & side >> 1;
    StoreReference(low, high, &below[counts.below]);
    StoreReference(low, high, &above[counts.above]);
    StoreReference(low, high, &cut[cut_count]);
    counts.below += (side & 1u) ^ both;
    counts.above += (side >> 1) ^ both;
    cut_count += both;
  }
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

// Where a chunk of the work puts its references, and how many of those places it does not need,
// since clipping left nothing.
struct Places {
  std::size_t first = 0;
  std::size_t count = 0;
  std::size_t used = 0;
  Bounds3f bounds;  // of what is in them
};

// Moves references from the end into the places that are not used. What is moved depends on the
// chunks alone, and there are few of them.
std::size_t CloseGaps(std::span<const Places> chunks, Reference* references) {
  std::size_t total = 0;
  for (const Places& places : chunks) total += places.used;
  auto source = chunks.rbegin();  // of what lies behind `total`
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

void DistributeInParallel(const TriangleMesh& mesh, std::span<const Reference> references,
                          const Bounds3f& cell, const SplitCandidate& split, Share* below,
                          Share* above) {
  // Each chunk gets the places that CountSides() promises; the gaps that clipping leaves are closed
  // at the end.
  const std::size_t chunks = ReferenceChunks(references.size());
  std::vector<Places> below_places(chunks), above_places(chunks);
  ForEachReferenceChunk(references, [&](std::span<const Reference> chunk, std::size_t c) {
    const SideCounts counts = CountSides(chunk, split);
    below_places[c].count = counts.below;
    above_places[c].count = counts.above;
  });
  for (std::size_t c = 1; c < chunks; ++c) {
    below_places[c].first = below_places[c - 1].first + below_places[c - 1].count;
    above_places[c].first = above_places[c - 1].first + above_places[c - 1].count;
  }
  below->references = ReferenceArray(below_places.back().first + below_places.back().count);
  above->references = ReferenceArray(above_places.back().first + above_places.back().count);

  // While a chunk is in the cache, its copy and its bounds cost little.
  const auto place = [](std::span<const Reference> from, Places* places, Share* to) {
    std::copy(from.begin(), from.end(), to->references.data() + places->first);
    places->used = from.size();
    places->bounds = UnionBounds(from);
  };
  ForEachReferenceChunk(references, [&](std::span<const Reference> chunk, std::size_t c) {
    // Distribute() writes beyond what it keeps.
    ReferenceArray scratch(3 * chunk.size());
    Reference* const chunk_below = scratch.data();
    Reference* const chunk_above = chunk_below + chunk.size();
    const SideCounts used =
        Distribute(mesh, chunk, cell, split, chunk_below, chunk_above, chunk_above + chunk.size());
    place({chunk_below, used.below}, &below_places[c], below);
    place({chunk_above, used.above}, &above_places[c], above);
  });
  Finish(below_places, below);
  Finish(above_places, above);
}

}  // namespace kdray::core
