// SPDX-License-Identifier: Apache-2.0
// The picture of core/render/renderer.h with the hits of Embree: the same camera, tiles, shading
// and film, so the difference is the tracing.
#pragma once

#include <string>
#include <utility>

#include "core/render/renderer.h"
#include "core/scene/scene.h"
#include "tests/bench/embree_rows.h"
#include "tests/bench/scenes.h"

namespace kdray::bench {

/// The bench's view as a shaded picture, a sample a pixel, side x side.
core::RenderSpec PictureOf(const BenchView& view, int side);

/// `camera` is that of the image that core::Render made of `spec`. All arguments must outlive it.
class EmbreePicture {
 public:
  EmbreePicture(std::string name, const EmbreeScene& embree, Way way, bool coherent,
                const core::Scene& scene, const core::RenderSpec& spec,
                const core::RenderedImage& image)
      : name_(std::move(name)),
        embree_(embree.scene()),
        way_(way),
        coherent_(coherent),
        scene_(scene),
        spec_(spec),
        image_(image) {}

  const std::string& name() const { return name_; }
  /// Seconds for the picture.
  double Run(int threads);
  /// The share of pixels whose colour differs by more than 1/256 from those of `image`.
  double Difference() const;

 private:
  std::string name_;
  RTCScene embree_;
  Way way_;
  bool coherent_;
  const core::Scene& scene_;
  const core::RenderSpec& spec_;
  const core::RenderedImage& image_;
  core::Film<float> film_;
};

}  // namespace kdray::bench
