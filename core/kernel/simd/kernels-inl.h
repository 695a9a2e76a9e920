// The kernels of one instruction set, and which of them serves a precision.
#pragma once

#include <cstddef>

#include "core/intersect/precision.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/exact-inl.h"
#include "core/kernel/simd/frustum-inl.h"
#include "core/kernel/simd/interleaved-inl.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/packet_hits-inl.h"
#include "core/kernel/simd/search-inl.h"
#include "core/kernel/simd/stream-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

template <class Search>
KernelFunction FindFor(KernelKind kernel, bool any) {
  if (kernel == KernelKind::kStream) {
    return any ? &TraceStream<Search, true> : &TraceStream<Search, false>;
  }
  return any ? &TraceInterleaved<Search, true> : &TraceInterleaved<Search, false>;
}

template <class Hits, class Search, bool kAny>
void TraceFrustumOr(const KernelJob& job, std::size_t first, std::size_t last) {
  TraceFrustum<Hits>(
      job, first, last,
      FindFor<Search>(job.alike ? KernelKind::kStream : KernelKind::kInterleaved, kAny));
}
template <class ClosestHits, class Search>
KernelFunction FindFrustum(bool any) {
  return any ? &TraceFrustumOr<AnyPacketHits<ClosestHits>, Search, true>
             : &TraceFrustumOr<ClosestHits, Search, false>;
}

KernelFunction Find(KernelKind kernel, Precision precision, bool double_vertices, bool any) {
  if (kernel == KernelKind::kFrustum) {
    if (precision == Precision::kFast) return FindFrustum<FastPacketHits, FastSearch>(any);
    if (precision == Precision::kWatertight) {
      return FindFrustum<WatertightPacketHits, WatertightSearch>(any);
    }
  }
  // The other precisions have no frustum kernel.
  if (kernel == KernelKind::kFrustum) kernel = KernelKind::kInterleaved;
  switch (precision) {
    case Precision::kFast:
      return FindFor<FastSearch>(kernel, any);
    case Precision::kWatertight:
      return FindFor<WatertightSearch>(kernel, any);
    case Precision::kDouble:
      return double_vertices ? FindFor<DoubleSearch<double>>(kernel, any)
                             : FindFor<DoubleSearch<float>>(kernel, any);
    case Precision::kExact:
      return double_vertices ? FindFor<ExactSearch<double>>(kernel, any)
                             : FindFor<ExactSearch<float>>(kernel, any);
  }
  return nullptr;
}

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
