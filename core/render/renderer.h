// SPDX-License-Identifier: Apache-2.0
// Renders a scene to pixels. Rays go through the batch interface of core/trace/trace.h;
// core/render/picture.h converts the result to 8-bit colours.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/progress.h"
#include "core/base/result.h"
#include "core/geometry/bounds3.h"
#include "core/intersect/precision.h"
#include "core/render/camera.h"
#include "core/render/color.h"
#include "core/render/edge_lines.h"
#include "core/render/film.h"
#include "core/render/framing.h"
#include "core/render/light.h"
#include "core/render/render_counts.h"
#include "core/render/surface_value.h"
#include "core/scene/scene.h"

namespace kdray::core {

enum class RenderMode : std::uint8_t {
  kShaded,            ///< Lambert under the lights, two-sided
  kNormal,            ///< unit normals of the triangles, world axes, by the order of their corners
  kDepth,             ///< distance along the view axis, world units
  kTriangle,          ///< number of the triangle
  kAmbientOcclusion,  ///< the share of the surroundings that nothing near hides, weighted by the
                      ///< cosine to the normal on the viewer's side
  kCost,              ///< nodes visited and triangles tested on the binary tree (TraceCost);
                      ///< depends on the build
  kPosition,          ///< the triangle's point (SurfacePoint), world units
};

/// Depths that a depth picture shows, world units; near <= far.
struct DepthRange {
  double near = 0, far = 0;
  friend bool operator==(const DepthRange&, const DepthRange&) = default;
};

/// The background of the mesh.
struct Background {
  Rgb color = {1, 1, 1};  ///< sRGB
  bool transparent = false;
};

struct RenderSpec {
  static constexpr int kMaxWholeSide = 1 << 20;  ///< of the image that the camera sees
  static constexpr int kMaxSide = 16384;         ///< of the rendered region
  static constexpr int kMaxSamples = 65536;
  static constexpr std::size_t kMaxLights = 64;
  int width = 640, height = 480;  ///< pixels of the whole image, each 1..kMaxWholeSide
  CameraSpec camera = {};
  RenderMode mode = RenderMode::kShaded;
  /// Per pixel, 1..kMaxSamples; 1 is the pixel's centre. Modes for which
  /// HasOneSample always take it.
  /// nullopt: as many as smooth silhouettes need, which is kSmoothSamples or, where the colours
  /// around the pixel hardly differ, 1. That depends only on the centre samples of the pixel and of
  /// its 8 neighbours in the whole image. kAmbientOcclusion then takes kSmoothSamples everywhere.
  std::optional<int> samples = 1;
  std::optional<Precision> precision = Precision::kWatertight;  ///< nullopt: PicturePrecision
  Rgb color = {0.93f, 0.88f, 0.81f};                            ///< of the mesh, sRGB, each 0..1
  std::optional<Background> background = std::nullopt;  ///< left out: white for kShaded, else black

  /// kShaded: at most kMaxLights. Empty: everything is black. nullopt: a headlight, which is a
  /// light of intensity 1 at the eye that does not fall off; every surface that is seen faces it.
  std::optional<std::vector<Light>> lights = std::nullopt;
  /// kShaded: surfaces hide lights from each other; the headlight is hidden from none that is seen.
  bool shadows = false;
  /// kShaded: unit normals that replace those of the triangles in the cosine to a light; empty:
  /// none. The triangle's normal alone decides which side of the surface is seen and lit.
  SurfaceValue smooth_normals = nullptr;
  /// kShaded: linear colours that replace `color`, each 0..1; empty: none.
  SurfaceValue file_colors = nullptr;
  /// kAmbientOcclusion: surfaces farther than this do not count, world units, > 0; nullopt:
  /// DefaultAoRadius.
  std::optional<double> ao_radius = std::nullopt;

  std::optional<std::uint32_t> cells_depth =
      std::nullopt;  ///< draw the tree's nodes at this depth and the leaves above it
                     ///< as lines; at most max_cells of them
  std::optional<SidesOfTriangle> edges = std::nullopt;  ///< draw these edges as lines (EdgeLines)
  std::size_t max_cells = 16384;  ///< more are refused: kInvalidArgument, `cells_depth`
  std::optional<Region> region = std::nullopt;  ///< part of the image to render; left out: all of
                                                ///< it. At most kMaxSide a side
  std::uint64_t seed = 0;                       ///< of the sample positions
  /// kShaded without cells and edges: only RenderedImage::codes are wanted. They take a fifth of
  /// the memory of light, and are made while a tile is in the cache. No effect elsewhere.
  bool as_codes = false;

  // With one of these, pixels of kShaded, kNormal and kAmbientOcclusion stop by themselves, after
  // at most max_samples, and `samples` is ignored.

  /// A pixel stops when the standard error of its mean luminance falls below this, > 0, and it has
  /// kMinAdaptiveSamples. Of linear light, except for kNormal: of (n + 1) / 2.
  std::optional<double> max_noise = std::nullopt;
  /// Time for tracing, > 0: all pixels are refined together until it has passed. The first samples
  /// are always taken.
  std::optional<std::chrono::milliseconds> budget = std::nullopt;
  int max_samples = 1024;  ///< 1..kMaxSamples
};

/// With fewer samples the estimate of their error is unreliable.
inline constexpr int kMinAdaptiveSamples = 16;

/// Where one sample would show steps (RenderSpec::samples).
inline constexpr int kSmoothSamples = 16;

/// What ended the sampling.
enum class Stopped : std::uint8_t {
  kDone,    ///< all samples were taken: RenderSpec::samples, or max_samples in some pixel
  kNoise,   ///< the noise of every pixel is below max_noise
  kBudget,  ///< the time budget was used
};

/// A rendered image. All films cover the same region.
struct RenderedImage {
  RenderMode mode = RenderMode::kShaded;
  Camera camera;                                 ///< as used, chosen values filled in
  Precision precision = Precision::kWatertight;  ///< as used
  Bounds3d bounds;                               ///< of the mesh, world units
  Background background;                         ///< as used

  /// kShaded: float, 4 channels: linear red, green, blue premultiplied by the fourth, coverage
  /// (less than 1 only with a transparent background). Includes lines of cells and edges. kNormal:
  /// float, 3 channels: mean over the samples of x, y, z, where a miss counts as 0 0 0. kDepth:
  /// float, 1 channel: infinity for a miss; a hit beyond the range of float has the largest float.
  /// kTriangle: int32, 1 channel: -1 for a miss. kAmbientOcclusion: float, 1 channel: the mean over
  /// the samples, 0 where all is hidden; a miss counts as 1. kCost: int32, 2
  /// channels. kPosition: double, 3 channels: NaN for a miss.
  std::variant<Film<float>, Film<std::int32_t>, Film<double>> values;

  /// With RenderSpec::as_codes: the pixels of MakePicture, 3 channels, or 4 with a transparent
  /// background. `values` then has no channels.
  std::optional<Film<std::uint8_t>> codes;

  std::optional<DepthRange> depth_range;  ///< kDepth: what MakePicture shows; set by its caller

  std::optional<Film<float>>
      coverage;                      ///< kNormal, kAmbientOcclusion: share of the samples that hit
  std::optional<Film<float>> lines;  ///< if cells are drawn and the mode is not kShaded: opacity of
                                     ///< the lines, for pictures; `values` has no lines

  std::optional<Film<float>> edges;  ///< the same of edges

  int samples = 1;              ///< the largest number that a pixel took
  std::optional<double> noise;  ///< largest standard error of a pixel (RenderSpec::max_noise); only
                                ///< with max_noise or budget, and at least two samples
  Stopped stopped = Stopped::kDone;
  RenderCounts counts;

  const Region& region() const {
    return std::visit([](const auto& film) -> const Region& { return film.region(); }, values);
  }
};

inline constexpr std::size_t kBudgetBytesPerPixel = 64;

/// Renders in tiles, in parallel within the caller's arena. The result depends only on scene.mesh
/// and spec (with cells_depth also on the tree, with a budget also on the time). It does not depend
/// on the number of threads, nor on the region, so regions put together equal the whole bit for
/// bit. Only the mode's values are computed. Memory: 24 bytes a pixel at most, and some 0.5 MB a
/// thread; with a budget kBudgetBytesPerPixel besides. `progress` may be null; it reaches 1.
/// Errors: kInvalidArgument (with Error::field), kCancelled, kDeadlineExceeded. Safe from many
/// threads at once.
Result<RenderedImage> Render(const Scene& scene, const RenderSpec& spec,
                             const CancelToken& cancel = {}, Progress* progress = nullptr);

}  // namespace kdray::core
