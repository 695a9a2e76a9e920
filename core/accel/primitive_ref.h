// SPDX-License-Identifier: Apache-2.0
// Primitive references: the triangles of an unfinished tree.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <new>
#include <span>
#include <type_traits>
#include <vector>

#include "core/accel/build_monitor.h"
#include "core/base/float4.h"
#include "core/base/huge_pages.h"
#include "core/base/parallel.h"
#include "core/geometry/bounds3.h"
#include "core/geometry/hit.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// A triangle in a node.
struct PrimitiveRef {
  Bounds3f bounds;  ///< contains the triangle, or the part of it in the node's (closed) cell
  PrimitiveId id = kNoPrimitive;
  friend bool operator==(const PrimitiveRef&, const PrimitiveRef&) = default;
};

/// The ends of a reference's bounds on the three axes; the fourth lane is unspecified.
inline Float4 LowOf(const PrimitiveRef& reference) { return Load4(&reference); }
inline Float4 HighOf(const PrimitiveRef& reference) {
  static_assert(sizeof(PrimitiveRef) == 28 && offsetof(PrimitiveRef, bounds.max) == 12);
  return Load4(reinterpret_cast<const char*>(&reference) + 12);
}

/// Copies a reference, given its ends.
inline void StorePrimitiveRef(Float4 low, Float4 high, PrimitiveRef* to) {
  std::memcpy(static_cast<void*>(to), &low, sizeof low);
  std::memcpy(static_cast<void*>(reinterpret_cast<char*>(to) + 12), &high, sizeof high);
}

/// An array of uninitialised references. Unlike a vector it does not fill them first, on one
/// thread, which for large nodes would take as long as the work itself.
class PrimitiveRefArray {
 public:
  PrimitiveRefArray() = default;
  explicit PrimitiveRefArray(std::size_t size)
      : references_(static_cast<PrimitiveRef*>(AllocateHuge(size * sizeof(PrimitiveRef)))),
        size_(size) {}

  PrimitiveRef* data() { return references_.get(); }
  const PrimitiveRef* data() const { return references_.get(); }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  PrimitiveRef* begin() { return data(); }
  PrimitiveRef* end() { return data() + size_; }
  const PrimitiveRef* begin() const { return data(); }
  const PrimitiveRef* end() const { return data() + size_; }
  void Shorten(std::size_t size) { size_ = size; }

 private:
  struct Free {
    void operator()(PrimitiveRef* references) const { FreeHuge(references); }
  };
  static_assert(std::is_trivially_copyable_v<PrimitiveRef>);

  std::unique_ptr<PrimitiveRef, Free> references_;
  std::size_t size_ = 0;
};

/// References of all triangles that are not degenerate, by ascending id; local coordinates, rounded
/// outward. Unspecified if the monitor stops, as are the results of the functions below.
PrimitiveRefArray MakePrimitiveRefs(const TriangleMesh& mesh, BuildMonitor* monitor = nullptr);

/// The union of their bounds. Large spans are searched in parallel.
Bounds3f UnionBounds(std::span<const PrimitiveRef> references, BuildMonitor* monitor = nullptr);

/// Work on many references is split into pieces of this size, for any number of threads.
inline constexpr std::size_t kReferenceChunk = 8192;

inline std::size_t ReferenceChunks(std::size_t references) {
  return (references + kReferenceChunk - 1) / kReferenceChunk;
}

/// f(chunk, number) for each of the ReferenceChunks(), possibly in parallel, until the monitor
/// stops.
template <class F>
void ForEachReferenceChunk(std::span<const PrimitiveRef> references, BuildMonitor* monitor,
                           const F& f) {
  ParallelFor(0, ReferenceChunks(references.size()), 1, [&](std::size_t number, std::size_t) {
    if (monitor != nullptr && monitor->ShouldStop()) return;
    const std::size_t first = number * kReferenceChunk;
    f(references.subspan(first, std::min(kReferenceChunk, references.size() - first)), number);
  });
}

/// The sum of reduce(chunk) over all chunks, added in order with T::Add.
template <class T, class Reduce>
T ReduceReferences(std::span<const PrimitiveRef> references, BuildMonitor* monitor,
                   const Reduce& reduce) {
  if (references.size() <= kReferenceChunk) return reduce(references);
  std::vector<T> parts(ReferenceChunks(references.size()));
  ForEachReferenceChunk(references, monitor,
                        [&](auto chunk, std::size_t number) { parts[number] = reduce(chunk); });
  T total = parts.front();
  for (std::size_t i = 1; i < parts.size(); ++i) total.Add(parts[i]);
  return total;
}

}  // namespace kdray::core
