// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/embree_modes.h"

#include "core/base/parallel.h"
#include "core/geometry/ray.h"

namespace kdray::bench {
namespace {

using core::RayF;

constexpr std::size_t kBlock = 4096;  // rays that a thread takes at a time, as core/trace does

}  // namespace

void EmbreeMode::Prepare(const BenchRays& batch) {
  size_ = batch.rays.size();
  any_ = batch.any;
  streams_.resize(size_);
  for (std::size_t i = 0; i < size_; ++i) {
    const RayF& r = batch.rays[i];
    RTCRayHit& q = streams_[i];
    q.ray = {r.origin.x,
             r.origin.y,
             r.origin.z,
             r.t_min,
             r.direction.x,
             r.direction.y,
             r.direction.z,
             0,
             r.t_max,
             0xffffffffu,
             static_cast<unsigned>(i),
             0};
    q.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    q.hit.primID = RTC_INVALID_GEOMETRY_ID;
    q.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  }
  if (way_ == Way::kPacket) {
    packets_.assign((size_ + 15) / 16, RTCRayHit16{});
    for (std::size_t i = 0; i < size_; ++i) {
      RTCRayHit16& p = packets_[i / 16];
      const std::size_t k = i % 16;
      const RTCRay& r = streams_[i].ray;
      p.ray.org_x[k] = r.org_x;
      p.ray.org_y[k] = r.org_y;
      p.ray.org_z[k] = r.org_z;
      p.ray.tnear[k] = r.tnear;
      p.ray.dir_x[k] = r.dir_x;
      p.ray.dir_y[k] = r.dir_y;
      p.ray.dir_z[k] = r.dir_z;
      p.ray.tfar[k] = r.tfar;
      p.ray.mask[k] = r.mask;
      p.ray.id[k] = r.id;
      p.hit.geomID[k] = RTC_INVALID_GEOMETRY_ID;
      p.hit.primID[k] = RTC_INVALID_GEOMETRY_ID;
      p.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
    }
  }
}

double EmbreeMode::Run(int threads) {
  work_streams_ = streams_;
  work_packets_ = packets_;
  if (any_ && way_ != Way::kPacket) {
    occlusion_.resize(size_);
    for (std::size_t i = 0; i < size_; ++i) occlusion_[i] = streams_[i].ray;
  }
  const Stopwatch watch(threads);
  core::ParallelFor(0, size_, kBlock, [&](std::size_t first, std::size_t last) {
    const FlushDenormals flush;
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags =
        coherent_ ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    switch (way_) {
      case Way::kSingle:
        for (std::size_t i = first; i < last; ++i) {
          if (any_) {
            rtcOccluded1(scene_, &context, &occlusion_[i]);
          } else {
            rtcIntersect1(scene_, &context, &work_streams_[i]);
          }
        }
        break;
      case Way::kPacket:
        for (std::size_t i = first; i < last; i += 16) {
          alignas(64) int valid[16];
          for (std::size_t k = 0; k < 16; ++k) valid[k] = i + k < last ? -1 : 0;
          if (any_) {
            rtcOccluded16(valid, scene_, &context, &work_packets_[i / 16].ray);
          } else {
            rtcIntersect16(valid, scene_, &context, &work_packets_[i / 16]);
          }
        }
        break;
      case Way::kStream:
        if (any_) {
          rtcOccluded1M(scene_, &context, &occlusion_[first], static_cast<unsigned>(last - first),
                        sizeof(RTCRay));
        } else {
          rtcIntersect1M(scene_, &context, &work_streams_[first],
                         static_cast<unsigned>(last - first), sizeof(RTCRayHit));
        }
        break;
    }
  });
  return watch.seconds();
}

double EmbreeMode::Distance(std::size_t i) const {
  if (any_) return occlusion_[i].tfar < 0 ? 0 : kMiss;
  return work_streams_[i].hit.geomID == RTC_INVALID_GEOMETRY_ID
             ? kMiss
             : static_cast<double>(work_streams_[i].ray.tfar);
}

void EmbreeMode::Release() {
  for (auto* v : {&streams_, &work_streams_}) *v = {};
  for (auto* v : {&packets_, &work_packets_}) *v = {};
  occlusion_ = {};
}

}  // namespace kdray::bench
