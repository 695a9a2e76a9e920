// SPDX-License-Identifier: Apache-2.0
// Counts of what a render computed.
#pragma once

#include <cstdint>

namespace kdray::core {

/// What a render computed, by kind. Only what the request names is computed, which tests and
/// metrics check with these.
struct RenderCounts {
  std::uint64_t camera_rays = 0;     ///< through pixels
  std::uint64_t shadow_rays = 0;     ///< from surfaces to lights
  std::uint64_t occlusion_rays = 0;  ///< of ambient occlusion
  std::uint64_t normals = 0;         ///< of triangles, computed; some triangles more than once

  void Add(const RenderCounts& other) {
    camera_rays += other.camera_rays;
    shadow_rays += other.shadow_rays;
    occlusion_rays += other.occlusion_rays;
    normals += other.normals;
  }
};

}  // namespace kdray::core
