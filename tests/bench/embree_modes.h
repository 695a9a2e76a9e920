// SPDX-License-Identifier: Apache-2.0
// The ways to ask Embree that the benchmark of rays takes: single rays, packets of 16, and streams.
#pragma once

#include <cstddef>
#include <ctime>
#include <limits>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "tests/bench/scenes.h"

namespace kdray::bench {

/// With one thread, the time that it had the processor: what other programs take in between does
/// not count, for neither side. With more, the time on the wall.
class Stopwatch {
 public:
  explicit Stopwatch(int threads)
      : clock_(threads == 1 ? CLOCK_THREAD_CPUTIME_ID : CLOCK_MONOTONIC), start_(Now()) {}
  double seconds() const { return Now() - start_; }

 private:
  double Now() const {
    timespec t;
    clock_gettime(clock_, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
  }
  clockid_t clock_;
  double start_;
};

/// The distance of a ray that hits nothing.
inline constexpr double kMiss = std::numeric_limits<double>::infinity();

enum class Way { kSingle, kPacket, kStream };

/// One way to ask Embree. Rays are laid out beforehand as it likes them; every run starts from a
/// fresh copy.
class EmbreeMode {
 public:
  EmbreeMode(std::string name, const EmbreeScene& scene, Way way, bool coherent)
      : name_(std::move(name)), scene_(scene.scene()), way_(way), coherent_(coherent) {}

  const std::string& name() const { return name_; }

  void Prepare(const BenchRays& batch);
  /// Seconds for the whole batch.
  double Run(int threads);
  /// The distance of a single-ray mode's last run; infinite for a miss, 0 where only "any" was
  /// asked.
  double Distance(std::size_t i) const;
  void Release();

 private:
  template <class T>
  struct Aligned {
    using value_type = T;
    Aligned() = default;
    template <class U>
    Aligned(const Aligned<U>&) {}  // NOLINT(google-explicit-constructor)
    T* allocate(std::size_t n) {
      return static_cast<T*>(::operator new (n * sizeof(T), std::align_val_t{64}));
    }
    void deallocate(T* p, std::size_t) { ::operator delete (p, std::align_val_t{64}); }
    friend bool operator==(const Aligned&, const Aligned&) { return true; }
  };

  std::string name_;
  RTCScene scene_;
  Way way_;
  bool coherent_;
  bool any_ = false;
  std::size_t size_ = 0;
  std::vector<RTCRayHit, Aligned<RTCRayHit>> streams_, work_streams_;
  std::vector<RTCRayHit16, Aligned<RTCRayHit16>> packets_, work_packets_;
  std::vector<RTCRay, Aligned<RTCRay>> occlusion_;
};

}  // namespace kdray::bench
