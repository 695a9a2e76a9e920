// SPDX-License-Identifier: Apache-2.0
// The types of the HTTP contract as plain structs: requests and answers. Defaults are defined only
// here; names and ranges of fields in the tables of fields (api/request_fields.h); enumerations in
// api/names.h, which the build makes from the lists in api/openapi.yaml. No JSON, no HTTP, no
// geometry.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "api/errors.h"
#include "api/names.h"

namespace kdray::api {

/// A value, or the problem to send instead.
template <class T>
class [[nodiscard]] Outcome {
 public:
  // NOLINTNEXTLINE(google-explicit-constructor)
  Outcome(T value) : state_(std::in_place_index<0>, std::move(value)) {}
  // NOLINTNEXTLINE(google-explicit-constructor)
  Outcome(Problem problem) : state_(std::in_place_index<1>, std::move(problem)) {}
  bool ok() const { return state_.index() == 0; }
  explicit operator bool() const { return ok(); }
  T& operator*() & { return std::get<0>(state_); }
  const T& operator*() const& { return std::get<0>(state_); }
  T&& operator*() && { return std::get<0>(std::move(state_)); }
  T* operator->() { return &std::get<0>(state_); }
  const T* operator->() const { return &std::get<0>(state_); }
  const Problem& problem() const& { return std::get<1>(state_); }
  Problem&& problem() && { return std::get<1>(std::move(state_)); }

 private:
  std::variant<T, Problem> state_;
};
/// For steps that only succeed or fail.
using Check = std::optional<Problem>;

using Vec3 = std::array<double, 3>;
struct Box {
  Vec3 min{}, max{};
};

// ---- Batches ----

/// Query parameters of a batch of ray queries.
struct RayOptions {
  Precision precision = Precision::kAuto;
  std::vector<RayField> fields = {RayField::kT, RayField::kTriangle, RayField::kU,
                                  RayField::kV};  ///< in the requested order
  std::int64_t max_hits = 64;                     ///< of a row of `all`
  double t_min = 0;                               ///< for rows of 6 columns
  std::optional<double> t_max;                    ///< for rows of 6 columns; nullopt: infinity
  bool auto_t_min = false;  ///< off the surface that a ray begins on; then t_min is 0
  bool auto_t_max = false;  ///< off the surface at the end of the direction; then t_max is 1
  Cull cull = Cull::kNone;
  std::int64_t deadline_ms = 30000;
  std::optional<NumberType>
      dtype;  ///< of the answer's numbers; nullopt: the request's, f8 for JSON

  bool Names(RayField field) const {
    return std::find(fields.begin(), fields.end(), field) != fields.end();
  }
};

/// A hit. A miss has triangle -1 and t infinity; an invalid row has t NaN. No accepted upload has
/// 2^31 triangles.
struct RayHit {
  double t, u, v;
  std::int32_t triangle;
};

/// What an answered batch has beside its rows.
struct BatchReport {
  Precision precision = Precision::kAuto;         ///< the one used, never kAuto
  std::optional<double> offset;                   ///< with t_min or t_max auto: the contract's B
  std::vector<std::uint64_t> invalid, truncated;  ///< row numbers, ascending
  double parse_ms = 0;                            ///< rows of the body to rays
  double trace_ms = 0;                            ///< rays in memory to hits in memory
  double encode_ms = 0;                           ///< hits to bytes
};

// ---- Trees ----

struct MeshHealth {
  std::uint64_t degenerate = 0, duplicate = 0, concave = 0, open_edges = 0, non_manifold_edges = 0;
  bool closed = false;
  double coordinate_resolution = 0;
};

struct MeshDescription {
  std::string sha256;  ///< 64 lower-case hexadecimal digits
  MeshFormat format = MeshFormat::kObj;
  std::uint64_t bytes = 0, triangles = 0, dropped = 0, vertices = 0;
  Box bounds;
  MeshHealth health;
  std::optional<double> area;
  std::optional<double> volume;                    ///< only if closed
  std::optional<std::vector<std::string>> groups;  ///< names; not in lists
};

struct TreeFacts {
  Build build = Build::kKdSah;  ///< the build that was made, never kAuto
  std::uint64_t nodes = 0, leaves = 0, empty_leaves = 0, references = 0;
  std::uint32_t max_depth = 0;
  std::vector<std::uint64_t> leaf_histogram;  ///< [65] counts all leaves beyond 64 triangles
  std::uint64_t max_leaf = 0;                 ///< triangles of the largest leaf
  std::uint64_t bytes = 0;
  double sah_cost = 0, traversal_cost = 0, intersection_cost = 0, parse_ms = 0, build_ms = 0;
};

/// The answer of POST and GET /v1/trees. While a tree is built, `mesh` has only sha256 and bytes,
/// and `tree` is absent.
struct TreeDescription {
  std::string id;
  bool ready = false;      ///< `state`: "ready" or "building"
  double progress = 0;     ///< 0..1; 1 when ready
  std::string created_at;  ///< RFC 3339, UTC, milliseconds
  MeshDescription mesh;
  bool mesh_known = false;  ///< the mesh was parsed: format, counts, bounds and health are known
  std::optional<TreeFacts> tree;
  std::string plan;  ///< for people: how the mesh was modelled, and why
};

/// Query parameters of POST /v1/trees.
struct UploadRequest {
  Build build = Build::kAuto;
  std::optional<std::string>
      mesh;  ///< sha256 of a stored mesh, for another build of it without a body
  std::int64_t wait_ms = 30000;  ///< 0 answers at once
};

/// Query parameters of GET /v1/trees.
struct ListRequest {
  std::string mesh;          ///< sha256; empty: every mesh
  std::int64_t limit = 100;  ///< trees per page
  std::string after;         ///< `next` of the previous page; empty: from the newest
};

/// Query parameters of GET /v1/trees/{id}.
struct DescribeRequest {
  std::int64_t wait_ms = 0;  ///< 0 answers at once
};

/// Query parameters of GET /v1/trees/{id}/cells.
struct CellsRequest {
  std::int64_t depth = 0;  ///< of the nodes to list; required
};

struct TreePage {
  std::vector<TreeDescription> trees;
  std::optional<std::string> next;  ///< cursor for `after`
};

// ---- Measured trade-offs ----

/// Query parameters of POST /v1/trees/{id}/tradeoff.
struct MeasureRequest {
  std::int64_t wait_ms = 30000;  ///< 0 answers at once
};

/// The number of wrong rays among `rays`. A zero is answered with its 95% bound, 3 / rays.
struct ErrorRate {
  std::uint64_t count = 0, rays = 0;
};

/// The cost of one kind of rays.
struct RayCost {
  double rays_per_s = 0, slowest = 0, fastest = 0;  ///< the median run, and the extremes
  double nodes_per_ray = 0, triangles_per_ray = 0;
};

struct TradeoffRow {
  Build build = Build::kKdSah;             ///< never kAuto
  Precision precision = Precision::kFast;  ///< never kAuto
  double build_ms = 0;
  std::uint64_t bytes = 0;
  double sah_cost = 0;
  RayCost random, aimed;
  std::optional<ErrorRate> leaks;  ///< nullopt if the mesh is not closed
  ErrorRate wrong_triangles, unconnected_triangles, folds, missed_hits, extra_hits, differences;
  std::uint64_t t_error_rays = 0;
  double t_error_p999 = 0, t_error_max = 0;  ///< scaled like the bound
  std::optional<double> t_error_bound;       ///< nullopt for `fast`
};

/// The answer of POST and GET /v1/trees/{id}/tradeoff. While measuring, only `progress`.
struct Tradeoff {
  bool ready = false;
  double progress = 0;      ///< 0..1
  std::string measured_at;  ///< RFC 3339, UTC, milliseconds
  std::uint64_t triangles = 0;
  bool closed = false;
  bool aimed_from_inside = false;
  int threads = 0;
  double load_average = 0;
  std::uint64_t runs = 0, disturbed_runs = 0;
  std::uint64_t seed = 0;
  double total_ms = 0;
  std::vector<TradeoffRow> results;  ///< every build with every precision
};

// ---- Renders ----

enum class ImageForm : std::uint8_t { kPng, kNpy };  ///< render.png, render.npy
struct Region {
  std::int64_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;  ///< half-open pixels of the whole image
};

/// One of a shaded render's `lights`: at most one of direction and position is set, and in a
/// decoded request exactly one.
struct Light {
  std::optional<Vec3> direction;  ///< where the light travels to, not 0,0,0
  std::optional<Vec3> position;   ///< of a point light
  double intensity = 1;           ///< >= 0
  Vec3 color = {1, 1, 1};         ///< sRGB 0..1
  friend bool operator==(const Light&, const Light&) = default;
};

/// Fields of render.png and render.npy. Missing camera values are chosen so that the whole mesh is
/// visible.
struct RenderRequest {
  std::int64_t width = 640, height = 480;
  Projection projection = Projection::kPerspective;
  std::optional<Vec3> eye, target;
  std::optional<Vec3> up;    ///< nullopt: kDefaultUp, unless the view is along it
  std::optional<View> view;  ///< the side from which the mesh is seen, instead of `eye`
  double fov_deg = 40;
  std::optional<double> view_height;
  double h_fov_deg = 360, v_fov_deg = 180;
  std::optional<std::array<double, 4>> intrinsic;   ///< fx, fy, cx, cy, instead of fov_deg
  std::optional<std::array<double, 16>> extrinsic;  ///< world to camera, row by row, instead of
                                                    ///< eye, target, up and view
  RenderMode mode = RenderMode::kShaded;
  std::optional<std::array<double, 2>> depth_range;  ///< near and far of a depth picture; nullopt:
                                                     ///< the hits of the whole image
  std::optional<std::int64_t> samples;               ///< per pixel; nullopt: see DefaultSamples
  Precision precision = Precision::kAuto;
  Vec3 color = {0.93, 0.88, 0.81};  ///< of the surface, sRGB 0..1
  bool file_color = false;          ///< color=file: that of the file, where it has one
  std::optional<Vec3> background;   ///< sRGB 0..1; see `transparent`. nullopt: DefaultBackground
  bool transparent = false;         ///< background=transparent
  std::optional<std::vector<Light>> lights;  ///< nullopt: a headlight
  bool shadows = false;                      ///< lights are hidden by what is between
  bool smooth = false;                       ///< by the vertex normals of the file
  std::optional<double> ao_radius;  ///< of ambient occlusion; nullopt: a share of the mesh's size
  bool edges = false;               ///< draws the edges of the file's faces
  std::optional<std::int64_t> cells_depth;
  std::optional<Region> region;
  std::uint64_t seed = 0;
  std::optional<std::int64_t> budget_ms;  ///< the best image within this time
  std::optional<double> max_noise;        ///< a pixel stops below it (standard error, linear light)
  std::int64_t max_samples = 1024;        ///< per pixel, with budget_ms or max_noise
  std::int64_t deadline_ms = 60000;
};

inline constexpr Vec3 kDefaultUp = {0, 1, 0};

/// White for modes that show light, black for the others.
constexpr Vec3 DefaultBackground(RenderMode mode) {
  return mode == RenderMode::kShaded || mode == RenderMode::kAmbientOcclusion ? Vec3{1, 1, 1}
                                                                              : Vec3{0, 0, 0};
}

/// Modes whose values are those of the pixel's centre.
constexpr bool HasOneSample(RenderMode mode) {
  return mode == RenderMode::kDepth || mode == RenderMode::kTriangle || mode == RenderMode::kCost ||
         mode == RenderMode::kPosition;
}

/// The samples of a request that does not say; nullopt: as many as smooth silhouettes need. An
/// array has one, and so has a mode whose values are not means (there, one is all that may be asked
/// for).
constexpr std::optional<std::int64_t> DefaultSamples(RenderMode mode, ImageForm form) {
  if (mode == RenderMode::kAmbientOcclusion) return 16;
  if (HasOneSample(mode)) return 1;
  return form == ImageForm::kNpy ? std::optional<std::int64_t>(1) : std::nullopt;
}

/// RenderCounts of core: what a render computed.
struct RenderCounts {
  std::uint64_t camera_rays = 0, shadow_rays = 0, occlusion_rays = 0;
  std::uint64_t normals = 0;  ///< of triangles, computed
};

/// Row-major [height][width][channels], top row first.
struct ImageArray {
  std::size_t width = 0, height = 0,
              channels = 1;  ///< channels 1: shape (H, W); else (H, W, channels)
  std::variant<std::vector<float>, std::vector<std::int32_t>, std::vector<double>> values;
};

struct RenderAnswer {
  Precision precision = Precision::kAuto;
  std::int64_t samples = 1;          ///< the largest number that a pixel took
  std::optional<double> noise;       ///< largest standard error of a pixel, if estimated
  Stopped stopped = Stopped::kDone;  ///< why sampling ended
  std::optional<std::array<double, 2>> depth_range;  ///< depth pictures with a hit or depth_range
  std::variant<std::vector<std::byte>, ImageArray> image;  ///< PNG bytes, or the array for .npy
  double trace_ms = 0, encode_ms = 0;
  RenderCounts counts;
};

struct Cell {
  Box bounds;
  std::uint32_t depth = 0;
  bool leaf = false;
  std::uint64_t triangles = 0;
};

}  // namespace kdray::api
