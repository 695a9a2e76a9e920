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
EngineFunction FindFor(Engine engine, bool any) {
  if (engine == Engine::kHybrid) {
    return any ? &TraceByHybrid<Search, true> : &TraceByHybrid<Search, false>;
  }
  return any ? &TraceByWave<Search, true> : &TraceByWave<Search, false>;
}

template <class Hits, class Search, bool kAny>
void TraceByFrustumOr(const EngineJob& job, std::size_t first, std::size_t last) {
  TraceByFrustum<Hits>(job, first, last,
                       FindFor<Search>(job.alike ? Engine::kHybrid : Engine::kWave, kAny));
}
template <class ClosestHits, class Search>
EngineFunction FindFrustum(bool any) {
  return any ? &TraceByFrustumOr<AnyPacketHits<ClosestHits>, Search, true>
             : &TraceByFrustumOr<ClosestHits, Search, false>;
}

EngineFunction Find(Engine engine, Precision precision, bool double_vertices, bool any) {
  if (engine == Engine::kFrustum) {
    if (precision == Precision::kFast) return FindFrustum<FastPacketHits, FastSearch>(any);
    if (precision == Precision::kWatertight) {
      return FindFrustum<WatertightPacketHits, WatertightSearch>(any);
    }
  }
  // The other precisions have no frustum of their own.
  if (engine == Engine::kFrustum) engine = Engine::kWave;
  switch (precision) {
    case Precision::kFast:
      return FindFor<FastSearch>(engine, any);
    case Precision::kWatertight:
      return FindFor<WatertightSearch>(engine, any);
    case Precision::kDouble:
      return double_vertices ? FindFor<DoubleSearch<double>>(engine, any)
                             : FindFor<DoubleSearch<float>>(engine, any);
    case Precision::kExact:
      return double_vertices ? FindFor<ExactSearch<double>>(engine, any)
                             : FindFor<ExactSearch<float>>(engine, any);
  }
  return nullptr;
}

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
