// SPDX-License-Identifier: Apache-2.0
// The kernels of one instruction set, and which of them serves a precision.
#pragma once

#include <cstddef>

#include "core/intersect/precision.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/any_packet_hits-inl.h"
#include "core/kernel/simd/certain_pairs-inl.h"
#include "core/kernel/simd/exact-inl.h"
#include "core/kernel/simd/exact_all-inl.h"
#include "core/kernel/simd/frustum-inl.h"
#include "core/kernel/simd/interleaved-inl.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/keep-inl.h"
#include "core/kernel/simd/packet_hits-inl.h"
#include "core/kernel/simd/search-inl.h"
#include "core/kernel/simd/stored_packet_hits-inl.h"
#include "core/kernel/simd/stream-inl.h"
#include "core/kernel/simd/watertight_all-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

template <class Search, bool kAny>
KernelFunction FindFor(KernelKind kernel) {
  return kernel == KernelKind::kStream ? &TraceStream<Search, kAny>
                                       : &TraceInterleaved<Search, kAny>;
}
/// For closest and any, and for all.
template <class Search, class AllSearch>
KernelFunction FindFor(KernelKind kernel, RayQuery query) {
  switch (query) {
    case RayQuery::kClosest:
      break;
    case RayQuery::kAny:
      return FindFor<Search, true>(kernel);
    case RayQuery::kAll:
      return FindFor<AllSearch, false>(kernel);
  }
  return FindFor<Search, false>(kernel);
}
template <class Stored>
KernelFunction FindForDouble(KernelKind kernel, RayQuery query) {
  return FindFor<DoubleSearch<KeepClosest, Stored>, DoubleSearch<KeepAll, Stored>>(kernel, query);
}
template <class Stored>
KernelFunction FindForExact(KernelKind kernel, RayQuery query) {
  return FindFor<ExactSearch<Stored>, ExactAllSearch<Stored>>(kernel, query);
}

template <class Hits, class Search, bool kAny>
void TraceFrustumOr(const KernelJob& job, std::size_t first, std::size_t last) {
  TraceFrustum<Hits>(
      job, first, last,
      FindFor<Search, kAny>(job.alike ? KernelKind::kStream : KernelKind::kInterleaved));
}
template <class ClosestHits, class Search>
KernelFunction FindFrustum(RayQuery query) {
  return query == RayQuery::kAny ? &TraceFrustumOr<AnyPacketHits<ClosestHits>, Search, true>
                                 : &TraceFrustumOr<ClosestHits, Search, false>;
}

template <class Stored>
KernelFunction FindFrustumOfDouble(RayQuery query) {
  using Any = AnyPacketHits<CertainPairs>;
  using Search = DoubleSearch<KeepClosest, Stored>;
  return query == RayQuery::kAny ? &TraceFrustumOr<Any, Search, true>
                                 : &TraceFrustumOr<DoublePacketHits<Stored>, Search, false>;
}
template <class Stored>
KernelFunction FindFrustumOfExact(RayQuery query) {
  using Any = AnyPacketHits<CertainPairs>;
  using Search = ExactSearch<Stored>;
  return query == RayQuery::kAny ? &TraceFrustumOr<Any, Search, true>
                                 : &TraceFrustumOr<ExactPacketHits<Stored>, Search, false>;
}
/// Null where there is none; see HasFrustum().
inline KernelFunction FindFrustum(Precision precision, bool double_vertices, RayQuery query) {
  if (!HasFrustum(query)) return nullptr;
  switch (precision) {
    case Precision::kFast:
      return FindFrustum<FastPacketHits, FastSearch<KeepClosest>>(query);
    case Precision::kWatertight:
      return FindFrustum<WatertightPacketHits, WatertightSearch<KeepClosest>>(query);
    case Precision::kDouble:
      return double_vertices ? FindFrustumOfDouble<double>(query)
                             : FindFrustumOfDouble<float>(query);
    case Precision::kExact:
      return double_vertices ? FindFrustumOfExact<double>(query) : FindFrustumOfExact<float>(query);
  }
  return nullptr;
}

// One source file for each instruction set includes this one.
// NOLINTNEXTLINE(misc-definitions-in-headers)
KernelFunction Find(KernelKind kernel, Precision precision, bool double_vertices, RayQuery query) {
  if (kernel == KernelKind::kFrustum) {
    if (const KernelFunction frustum = FindFrustum(precision, double_vertices, query)) {
      return frustum;
    }
    kernel = KernelKind::kInterleaved;
  }
  switch (precision) {
    case Precision::kFast:
      return FindFor<FastSearch<KeepClosest>, FastSearch<KeepAll>>(kernel, query);
    case Precision::kWatertight:
      return FindFor<WatertightSearch<KeepClosest>, WatertightAllSearch>(kernel, query);
    case Precision::kDouble:
      return double_vertices ? FindForDouble<double>(kernel, query)
                             : FindForDouble<float>(kernel, query);
    case Precision::kExact:
      return double_vertices ? FindForExact<double>(kernel, query)
                             : FindForExact<float>(kernel, query);
  }
  return nullptr;
}

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
