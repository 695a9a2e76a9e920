// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/embree_rows.h"

#include <emmintrin.h>

#include <algorithm>
#include <cstring>

#include "core/base/parallel.h"

namespace kdray::bench {
namespace {

using core::Hit;
using core::RayF;

constexpr std::size_t kBlock = 4096;   // rays that a thread takes at a time, as core/trace does
constexpr std::size_t kStream = 1024;  // rays whose layout stays in the second-level cache

static_assert(sizeof(RayF) == 32 && sizeof(Hit) == 32);

// A row is origin and t_min, then direction and t_max.
__m128 FirstHalf(const RayF& ray) { return _mm_loadu_ps(&ray.origin.x); }
__m128 SecondHalf(const RayF& ray) { return _mm_loadu_ps(&ray.direction.x); }

// What Embree leaves as it is.
void Prepare(RTCRay16* rays) {
  for (std::size_t k = 0; k < 16; ++k) {
    rays->time[k] = 0;
    rays->mask[k] = 0xffffffffu;
    rays->id[k] = 0;
    rays->flags[k] = 0;
  }
}

void Pack(const RayF* rows, RTCRay16* rays) {
  for (std::size_t k = 0; k < 16; k += 4) {
    __m128 a = FirstHalf(rows[k]), b = FirstHalf(rows[k + 1]), c = FirstHalf(rows[k + 2]),
           d = FirstHalf(rows[k + 3]);
    _MM_TRANSPOSE4_PS(a, b, c, d);
    _mm_store_ps(rays->org_x + k, a);
    _mm_store_ps(rays->org_y + k, b);
    _mm_store_ps(rays->org_z + k, c);
    _mm_store_ps(rays->tnear + k, d);
    a = SecondHalf(rows[k]), b = SecondHalf(rows[k + 1]), c = SecondHalf(rows[k + 2]),
    d = SecondHalf(rows[k + 3]);
    _MM_TRANSPOSE4_PS(a, b, c, d);
    _mm_store_ps(rays->dir_x + k, a);
    _mm_store_ps(rays->dir_y + k, b);
    _mm_store_ps(rays->dir_z + k, c);
    _mm_store_ps(rays->tfar + k, d);
  }
}

// Four answers, from t, u, v, primitives, and geometries, which are invalid for a miss.
void Unpack(__m128 t, __m128 u, __m128 v, __m128i primitive, __m128i geometry, Hit* hits) {
  const __m128i missed = _mm_cmpeq_epi32(geometry, _mm_set1_epi32(-1));
  const __m128 miss = _mm_castsi128_ps(missed);
  t = _mm_or_ps(_mm_andnot_ps(miss, t),
                _mm_and_ps(miss, _mm_set1_ps(std::numeric_limits<float>::infinity())));
  u = _mm_andnot_ps(miss, u);
  v = _mm_andnot_ps(miss, v);
  primitive = _mm_or_si128(primitive, missed);
  const __m128 tu[2] = {_mm_unpacklo_ps(t, u), _mm_unpackhi_ps(t, u)};
  const __m128i ids[2] = {_mm_unpacklo_epi32(primitive, _mm_setzero_si128()),
                          _mm_unpackhi_epi32(primitive, _mm_setzero_si128())};
  const __m128d vs[2] = {_mm_cvtps_pd(v), _mm_cvtps_pd(_mm_movehl_ps(v, v))};
  for (std::size_t k = 0; k < 2; ++k) {
    const __m128d id = _mm_castsi128_pd(ids[k]);
    double* first = &hits[2 * k].t;
    double* second = &hits[2 * k + 1].t;
    _mm_storeu_pd(first, _mm_cvtps_pd(tu[k]));
    _mm_storeu_pd(first + 2, _mm_unpacklo_pd(vs[k], id));
    _mm_storeu_pd(second, _mm_cvtps_pd(_mm_movehl_ps(tu[k], tu[k])));
    _mm_storeu_pd(second + 2, _mm_unpackhi_pd(vs[k], id));
  }
}

// t of a ray that Embree found occluded is -infinity.
void Unpack(const RTCRay16& rays, std::uint8_t* occluded) {
  __m128i below[4];
  for (std::size_t k = 0; k < 4; ++k) {
    below[k] = _mm_castps_si128(_mm_cmplt_ps(_mm_load_ps(rays.tfar + 4 * k), _mm_setzero_ps()));
  }
  const __m128i bytes =
      _mm_packs_epi16(_mm_packs_epi32(below[0], below[1]), _mm_packs_epi32(below[2], below[3]));
  _mm_storeu_si128(reinterpret_cast<__m128i*>(occluded), _mm_and_si128(bytes, _mm_set1_epi8(1)));
}

__m128i Load(const unsigned* from) {
  return _mm_load_si128(reinterpret_cast<const __m128i*>(from));
}

// f(rows, count, valid) for sixteen rays after the other; of the last ones copies fill the packet.
template <class F>
void ForEachPacket(std::span<const RayF> rays, const F& f) {
  alignas(64) int valid[16];
  std::fill(valid, valid + 16, -1);
  std::size_t i = 0;
  for (; i + 16 <= rays.size(); i += 16) f(&rays[i], i, std::size_t{16}, valid);
  if (i == rays.size()) return;
  RayF rest[16];
  const std::size_t count = rays.size() - i;
  for (std::size_t k = 0; k < 16; ++k) {
    rest[k] = rays[i + std::min(k, count - 1)];
    valid[k] = k < count ? -1 : 0;
  }
  f(rest, i, count, valid);
}

void TracePackets(RTCScene scene, RTCIntersectContext* context, std::span<const RayF> rays,
                  std::span<Hit> hits) {
  RTCRayHit16 packet;
  Prepare(&packet.ray);
  ForEachPacket(rays, [&](const RayF* rows, std::size_t first, std::size_t count, int* valid) {
    Pack(rows, &packet.ray);
    std::memset(packet.hit.geomID, 0xff, sizeof packet.hit.geomID);
    std::memset(packet.hit.instID[0], 0xff, sizeof packet.hit.instID[0]);
    rtcIntersect16(valid, scene, context, &packet);
    Hit rest[16];
    Hit* to = count == 16 ? &hits[first] : rest;
    for (std::size_t k = 0; k < 16; k += 4) {
      Unpack(_mm_load_ps(packet.ray.tfar + k), _mm_load_ps(packet.hit.u + k),
             _mm_load_ps(packet.hit.v + k), Load(packet.hit.primID + k),
             Load(packet.hit.geomID + k), to + k);
    }
    if (to == rest) std::copy(rest, rest + count, &hits[first]);
  });
}

void OccludePackets(RTCScene scene, RTCIntersectContext* context, std::span<const RayF> rays,
                    std::span<std::uint8_t> occluded) {
  RTCRay16 packet;
  Prepare(&packet);
  ForEachPacket(rays, [&](const RayF* rows, std::size_t first, std::size_t count, int* valid) {
    Pack(rows, &packet);
    rtcOccluded16(valid, scene, context, &packet);
    std::uint8_t all[16];
    Unpack(packet, all);
    std::copy(all, all + count, &occluded[first]);
  });
}

void Pack(const RayF& row, RTCRay* ray) {
  const __m128 second = SecondHalf(row);
  _mm_store_ps(&ray->org_x, FirstHalf(row));
  _mm_store_ps(&ray->dir_x, second);
  ray->time = 0;
  ray->tfar = row.t_max;
  ray->mask = 0xffffffffu;
  ray->id = 0;
  ray->flags = 0;
}

void Pack(const RayF& row, RTCRayHit* ray) {
  Pack(row, &ray->ray);
  ray->hit.geomID = RTC_INVALID_GEOMETRY_ID;
  ray->hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
}

void Unpack(const RTCRayHit& from, Hit* hit) {
  if (from.hit.geomID == RTC_INVALID_GEOMETRY_ID) {
    *hit = Hit();
    return;
  }
  const __m128 uv = _mm_castsi128_ps(
      _mm_loadl_epi64(reinterpret_cast<const __m128i*>(&from.hit.u)));  // u and v are neighbours
  hit->t = static_cast<double>(from.ray.tfar);
  _mm_storeu_pd(&hit->u, _mm_cvtps_pd(uv));
  hit->primitive_id = from.hit.primID;
}

RTCIntersectContext ContextFor(bool coherent) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags =
      coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  return context;
}

}  // namespace

void TraceRows(RTCScene scene, Way way, bool coherent, std::span<const RayF> rays,
               std::span<Hit> hits) {
  const FlushDenormals flush;
  RTCIntersectContext context = ContextFor(coherent);
  if (way == Way::kPacket) return TracePackets(scene, &context, rays, hits);
  static thread_local std::vector<RTCRayHit> layout;
  layout.resize(kStream);
  for (std::size_t first = 0; first < rays.size(); first += kStream) {
    const std::size_t count = std::min(kStream, rays.size() - first);
    for (std::size_t i = 0; i < count; ++i) {
      Pack(rays[first + i], &layout[i]);
      if (way == Way::kSingle) rtcIntersect1(scene, &context, &layout[i]);
    }
    if (way == Way::kStream) {
      rtcIntersect1M(scene, &context, layout.data(), static_cast<unsigned>(count),
                     sizeof(RTCRayHit));
    }
    for (std::size_t i = 0; i < count; ++i) Unpack(layout[i], &hits[first + i]);
  }
}

void OccludeRows(RTCScene scene, Way way, bool coherent, std::span<const RayF> rays,
                 std::span<std::uint8_t> occluded) {
  const FlushDenormals flush;
  RTCIntersectContext context = ContextFor(coherent);
  if (way == Way::kPacket) return OccludePackets(scene, &context, rays, occluded);
  static thread_local std::vector<RTCRay> layout;
  layout.resize(kStream);
  for (std::size_t first = 0; first < rays.size(); first += kStream) {
    const std::size_t count = std::min(kStream, rays.size() - first);
    for (std::size_t i = 0; i < count; ++i) {
      Pack(rays[first + i], &layout[i]);
      if (way == Way::kSingle) rtcOccluded1(scene, &context, &layout[i]);
    }
    if (way == Way::kStream) {
      rtcOccluded1M(scene, &context, layout.data(), static_cast<unsigned>(count), sizeof(RTCRay));
    }
    for (std::size_t i = 0; i < count; ++i) occluded[first + i] = layout[i].tfar < 0 ? 1 : 0;
  }
}

double EmbreeRows::Run(const BenchRays& batch, int threads) {
  const std::span<const RayF> rays(batch.rays);
  hits_.resize(batch.any ? 0 : rays.size());
  occluded_.resize(batch.any ? rays.size() : 0);
  const Stopwatch watch(threads);
  core::ParallelFor(0, rays.size(), kBlock, [&](std::size_t first, std::size_t last) {
    const auto block = rays.subspan(first, last - first);
    if (batch.any) {
      OccludeRows(scene_, way_, coherent_, block,
                  std::span(occluded_).subspan(first, last - first));
    } else {
      TraceRows(scene_, way_, coherent_, block, std::span(hits_).subspan(first, last - first));
    }
  });
  return watch.seconds();
}

double EmbreeRows::Distance(std::size_t i) const {
  if (hits_.empty()) return occluded_[i] != 0 ? 0 : kMiss;
  return hits_[i].t;
}

void EmbreeRows::Release() {
  hits_ = {};
  occluded_ = {};
}

}  // namespace kdray::bench
