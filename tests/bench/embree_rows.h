// SPDX-License-Identifier: Apache-2.0
// Embree as a service would use it: from rows of rays to rows of answers, as core/trace/trace.h
// takes and gives them. Rays are laid out, and answers converted, in vectors of four.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "tests/bench/embree_modes.h"
#include "tests/bench/scenes.h"

namespace kdray::bench {

/// Closest hits of a block of rays, with its layout and its answers' in the caches.
void TraceRows(RTCScene scene, Way way, bool coherent, std::span<const core::RayF> rays,
               std::span<core::Hit> hits);
/// 1 for a ray that hits anything, else 0.
void OccludeRows(RTCScene scene, Way way, bool coherent, std::span<const core::RayF> rays,
                 std::span<std::uint8_t> occluded);

/// One way to ask Embree, from rows to rows.
class EmbreeRows {
 public:
  EmbreeRows(std::string name, const EmbreeScene& scene, Way way, bool coherent)
      : name_(std::move(name)), scene_(scene.scene()), way_(way), coherent_(coherent) {}

  const std::string& name() const { return name_; }

  /// Seconds for the whole batch.
  double Run(const BenchRays& batch, int threads);
  /// The distance of the last run; as EmbreeMode::Distance.
  double Distance(std::size_t i) const;
  void Release();

 private:
  std::string name_;
  RTCScene scene_;
  Way way_;
  bool coherent_;
  std::vector<core::Hit> hits_;
  std::vector<std::uint8_t> occluded_;
};

}  // namespace kdray::bench
