// SPDX-License-Identifier: Apache-2.0
#include "server/mapping.h"

#include <array>
#include <charconv>
#include <chrono>
#include <type_traits>
#include <utility>

#include "api/limits.h"
#include "api/names.h"
#include "core/base/enumerators.h"
#include "core/store/object_store.h"
#include "server/http/time_text.h"
#include "server/plan.h"

namespace kdray::server {
namespace {

// The contract allows no image that core rejects.
static_assert(api::kMaxWholeSide == core::RenderSpec::kMaxWholeSide);
static_assert(api::Limits{}.max_image_side == core::RenderSpec::kMaxSide);
static_assert(api::kMaxLights == core::RenderSpec::kMaxLights);
static_assert(api::Limits{}.max_samples <= core::RenderSpec::kMaxSamples);

/// The pairs of enumerators of the contract and of core, by their names. Only the contract's `auto`
/// may have no partner; any other enumerator without one fails to compile.
template <class Api, class Core, std::size_t kApiNames>
class NamedPairs {
 public:
  consteval explicit NamedPairs(const std::array<std::string_view, kApiNames>& api_names) {
    for (std::size_t i = 0; i < kApiNames; ++i) {
      for (const Core core : core::kAll<Core>) {
        if (core::Name(core) != api_names[i]) continue;
        to_core_[i] = core;
        to_api_[static_cast<std::size_t>(core)] = static_cast<Api>(i);
      }
      if (!to_core_[i] && api_names[i] != "auto") throw "core has nothing of this name";
    }
    for (const std::optional<Api>& api : to_api_) {
      if (!api) throw "the contract has no such name";
    }
  }

  constexpr std::optional<Core> ToCore(Api api) const {
    return to_core_[static_cast<std::size_t>(api)];
  }
  constexpr Api ToApi(Core core) const { return *to_api_[static_cast<std::size_t>(core)]; }

 private:
  std::array<std::optional<Core>, kApiNames> to_core_{};
  std::array<std::optional<Api>, core::kAll<Core>.size()> to_api_{};
};

template <class Api, class Core, std::size_t kApiNames>
consteval auto PairByName(const std::array<std::string_view, kApiNames>& api_names) {
  return NamedPairs<Api, Core, kApiNames>(api_names);
}

constexpr auto kBuilds = PairByName<api::Build, core::BuildKind>(api::kBuildNames);
constexpr auto kPrecisions = PairByName<api::Precision, core::Precision>(api::kPrecisionNames);
constexpr auto kCulls = PairByName<api::Cull, core::Cull>(api::kCullNames);
constexpr auto kFormats = PairByName<api::MeshFormat, core::MeshFormat>(api::kMeshFormatNames);

api::Vec3 ToVec(const core::Vec3d& v) { return {v.x, v.y, v.z}; }
core::Vec3d ToVec(const api::Vec3& v) { return {v[0], v[1], v[2]}; }
api::Box ToBox(const core::Bounds3d& b) { return {ToVec(b.min), ToVec(b.max)}; }

core::Rgb ToRgb(const api::Vec3& c) {
  return {static_cast<float>(c[0]), static_cast<float>(c[1]), static_cast<float>(c[2])};
}

core::Projection ToCore(api::Projection projection) {
  switch (projection) {
    case api::Projection::kPerspective:
      return core::Projection::kPerspective;
    case api::Projection::kOrthographic:
      return core::Projection::kOrthographic;
    case api::Projection::kSpherical:
      break;
  }
  return core::Projection::kSpherical;
}

core::View ToCore(api::View view) {
  switch (view) {
    case api::View::kIso:
      return core::View::kIso;
    case api::View::kFront:
      return core::View::kFront;
    case api::View::kBack:
      return core::View::kBack;
    case api::View::kLeft:
      return core::View::kLeft;
    case api::View::kRight:
      return core::View::kRight;
    case api::View::kTop:
      return core::View::kTop;
    case api::View::kBottom:
      break;
  }
  return core::View::kBottom;
}

core::CameraSpec CameraOf(const api::RenderRequest& request) {
  core::CameraSpec camera;
  camera.projection = ToCore(request.projection);
  if (request.eye) camera.eye = ToVec(*request.eye);
  if (request.target) camera.target = ToVec(*request.target);
  if (request.up) camera.up = ToVec(*request.up);
  if (request.view) camera.view = ToCore(*request.view);
  if (request.projection == api::Projection::kPerspective) camera.fov_deg = request.fov_deg;
  camera.view_height = request.view_height;
  if (request.projection == api::Projection::kSpherical) {
    camera.h_fov_deg = request.h_fov_deg;
    camera.v_fov_deg = request.v_fov_deg;
  }
  if (request.intrinsic) {
    const auto& [fx, fy, cx, cy] = *request.intrinsic;
    camera.intrinsic = core::Intrinsics{.fx = fx, .fy = fy, .cx = cx, .cy = cy};
  }
  camera.extrinsic = request.extrinsic;
  return camera;
}

core::RenderMode ToCore(api::RenderMode mode) {
  switch (mode) {
    case api::RenderMode::kShaded:
      return core::RenderMode::kShaded;
    case api::RenderMode::kNormal:
      return core::RenderMode::kNormal;
    case api::RenderMode::kDepth:
      return core::RenderMode::kDepth;
    case api::RenderMode::kAmbientOcclusion:
      return core::RenderMode::kAmbientOcclusion;
    case api::RenderMode::kTriangle:
      return core::RenderMode::kTriangle;
    case api::RenderMode::kCost:
      return core::RenderMode::kCost;
    case api::RenderMode::kPosition:
      break;
  }
  return core::RenderMode::kPosition;
}

api::ErrorCode CodeOf(core::ErrorCode code, api::ErrorCode not_found) {
  switch (code) {
    case core::ErrorCode::kInvalidMesh:
      return api::ErrorCode::kInvalidMesh;
    case core::ErrorCode::kEmptyMesh:
      return api::ErrorCode::kEmptyMesh;
    case core::ErrorCode::kUnsupportedMeshFormat:
      return api::ErrorCode::kUnsupportedMeshFormat;
    case core::ErrorCode::kMeshTooLarge:
      return api::ErrorCode::kMeshTooLarge;
    case core::ErrorCode::kInvalidArgument:
      return api::ErrorCode::kInvalidParameter;
    case core::ErrorCode::kNotFound:
      return not_found;
    case core::ErrorCode::kCancelled:
      // Shutdown, or a client that has left: then the answer is not read, and the request is
      // recorded as such (exchange.h).
      return api::ErrorCode::kDraining;
    case core::ErrorCode::kDeadlineExceeded:
      return api::ErrorCode::kDeadlineExceeded;
    case core::ErrorCode::kMemoryFull:
      return api::ErrorCode::kMemoryFull;
    case core::ErrorCode::kStoreFull:
      return api::ErrorCode::kStoreFull;
    case core::ErrorCode::kCorrupt:
    case core::ErrorCode::kIo:
    case core::ErrorCode::kInternal:
      break;
  }
  return api::ErrorCode::kInternal;
}

api::MeshDescription DescribeMesh(const core::Sha256Digest& digest, std::uint64_t bytes,
                                  const core::MeshFacts* facts) {
  api::MeshDescription mesh;
  mesh.sha256 = digest.ToHex();
  mesh.bytes = bytes;
  if (facts == nullptr) return mesh;
  mesh.format = kFormats.ToApi(facts->format);
  mesh.triangles = facts->triangles;
  mesh.dropped = facts->dropped;
  mesh.vertices = facts->vertices;
  mesh.bounds = ToBox(facts->bounds);
  const core::MeshHealth& health = facts->health;
  mesh.health = {health.degenerate,           health.duplicate,          health.concave,
                 health.open_edges,           health.non_manifold_edges, health.closed,
                 health.coordinate_resolution};
  mesh.area = facts->area;
  mesh.volume = facts->volume;
  return mesh;
}

api::TreeFacts DescribeTree(const core::TreeFacts& facts, double parse_ms) {
  const core::TreeStats& stats = facts.stats;
  api::TreeFacts tree;
  tree.build = ToApi(facts.build);
  tree.nodes = stats.nodes;
  tree.leaves = stats.leaves;
  tree.empty_leaves = stats.empty_leaves;
  tree.references = stats.references;
  tree.max_depth = stats.max_depth;
  tree.leaf_histogram = stats.leaf_histogram;
  tree.max_leaf = stats.max_leaf;
  tree.bytes = stats.bytes;
  tree.sah_cost = stats.sah_cost;
  tree.traversal_cost = stats.traversal_cost;
  tree.intersection_cost = stats.intersection_cost;
  tree.parse_ms = parse_ms;
  tree.build_ms = facts.build_ms;
  return tree;
}

template <class T>
std::optional<T> ParseDecimal(std::string_view text) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

}  // namespace

api::Problem ToProblem(const core::Error& error, api::ErrorCode not_found) {
  if (core::IsStoreAway(error)) {
    // Repeated by clients and proxies, as other answers with 503.
    return {.code = api::ErrorCode::kOverloaded, .detail = error.message};
  }
  api::Problem problem;
  problem.code = CodeOf(error.code, not_found);
  problem.detail = error.message;
  problem.line = error.line;
  if (!error.field.empty()) {
    problem.parameter = error.field;
    problem.detail = std::string(error.field) + ": " + error.message;
  }
  switch (problem.code) {
    case api::ErrorCode::kInternal:
      problem.detail =
          error.code == core::ErrorCode::kCorrupt
              ? "the stored mesh is damaged or cannot be read; uploading it again repairs it"
              : "the server had an internal error, or its disk failed";
      break;
    case api::ErrorCode::kDraining:
      problem.detail = "the server is shutting down";
      break;
    default:
      break;
  }
  return problem;
}

api::Check ToCheck(const core::Status& status) {
  if (status.ok()) return std::nullopt;
  return ToProblem(status.error());
}

api::Problem TooManyCells(std::string_view parameter, std::int64_t depth, std::uint64_t limit) {
  return {.code = api::ErrorCode::kTooManyCells,
          .detail = "at depth " + std::to_string(depth) + " there are more than " +
                    std::to_string(limit) + " cells",
          .parameter = std::string(parameter),
          .limit = static_cast<double>(limit)};
}

std::optional<core::BuildKind> ToCore(api::Build build) { return kBuilds.ToCore(build); }
api::Build ToApi(core::BuildKind build) { return kBuilds.ToApi(build); }

core::Precision ToCore(api::Precision precision, core::Precision automatic) {
  return kPrecisions.ToCore(precision).value_or(automatic);
}
api::Precision ToApi(core::Precision precision) { return kPrecisions.ToApi(precision); }
core::Cull ToCore(api::Cull cull) { return *kCulls.ToCore(cull); }

core::PointPrecision ToCore(api::PointPrecision precision, core::PointPrecision automatic) {
  switch (precision) {
    case api::PointPrecision::kDouble:
      return core::PointPrecision::kDouble;
    case api::PointPrecision::kExact:
      return core::PointPrecision::kExact;
    case api::PointPrecision::kAuto:
      break;
  }
  return automatic;
}
api::Precision ToApi(core::PointPrecision precision) {
  return precision == core::PointPrecision::kExact ? api::Precision::kExact
                                                   : api::Precision::kDouble;
}

api::Outcome<core::TreeId> ToTreeId(std::string_view id) {
  if (const std::optional<core::TreeId> parsed = core::ParseTreeId(id)) return *parsed;
  return ToProblem(core::Error{core::ErrorCode::kNotFound, "no tree has this id"});
}

api::TreeDescription ToApi(const core::TreeInfo& info) {
  const core::TreeRecord& record = info.record;
  api::TreeDescription description;
  description.id = record.id.ToString();
  description.ready = info.ready();
  description.progress = info.progress;
  description.created_at = Rfc3339(record.created_ms);
  description.mesh_known = record.mesh.has_value();
  description.mesh =
      DescribeMesh(record.id.mesh, record.mesh_bytes, record.mesh ? &*record.mesh : nullptr);
  if (record.tree) {
    description.tree = DescribeTree(*record.tree, record.mesh ? record.mesh->parse_ms : 0.0);
  }
  description.plan = DescribePlan(record);
  return description;
}

std::string FormatCursor(const core::TreeInfo& info) {
  return std::to_string(info.record.created_ms) + "." + info.record.id.ToString();
}

std::optional<core::TreeLibrary::Position> ParseCursor(std::string_view cursor) {
  const std::size_t dot = cursor.find('.');
  if (dot == std::string_view::npos) return std::nullopt;
  const auto created_ms = ParseDecimal<std::int64_t>(cursor.substr(0, dot));
  const std::optional<core::TreeId> id = core::ParseTreeId(cursor.substr(dot + 1));
  if (!created_ms || !id) return std::nullopt;
  return core::TreeLibrary::Position{*created_ms, *id};
}

core::Light ToCore(const api::Light& light) {
  core::Light converted;
  converted.kind = light.position ? core::LightKind::kPoint : core::LightKind::kDirectional;
  converted.vector =
      ToVec(light.position ? *light.position : light.direction.value_or(api::Vec3{}));
  converted.intensity = light.intensity;
  converted.color = ToRgb(light.color);
  return converted;
}

core::RenderSpec ToCore(const api::RenderRequest& request) {
  core::RenderSpec spec;
  spec.width = static_cast<int>(request.width);
  spec.height = static_cast<int>(request.height);
  spec.camera = CameraOf(request);
  spec.mode = ToCore(request.mode);
  spec.samples = std::nullopt;
  if (request.samples) spec.samples = static_cast<int>(*request.samples);
  spec.precision = kPrecisions.ToCore(request.precision);
  spec.color = ToRgb(request.color);
  if (request.background || request.transparent) {
    core::Background background;
    if (request.background) background.color = ToRgb(*request.background);
    background.transparent = request.transparent;
    spec.background = background;
  }
  if (request.lights) {
    spec.lights.emplace();
    for (const api::Light& light : *request.lights) spec.lights->push_back(ToCore(light));
  }
  spec.shadows = request.shadows;
  spec.ao_radius = request.ao_radius;
  if (request.cells_depth) spec.cells_depth = static_cast<std::uint32_t>(*request.cells_depth);
  if (request.region) {
    spec.region =
        core::Region{static_cast<int>(request.region->x0), static_cast<int>(request.region->y0),
                     static_cast<int>(request.region->x1), static_cast<int>(request.region->y1)};
  }
  spec.seed = request.seed;
  spec.max_noise = request.max_noise;
  if (request.budget_ms) spec.budget = std::chrono::milliseconds(*request.budget_ms);
  spec.max_samples = static_cast<int>(request.max_samples);
  return spec;
}

api::Stopped ToApi(core::Stopped stopped) {
  switch (stopped) {
    case core::Stopped::kDone:
      return api::Stopped::kDone;
    case core::Stopped::kNoise:
      return api::Stopped::kNoise;
    case core::Stopped::kBudget:
      break;
  }
  return api::Stopped::kBudget;
}

api::RenderCounts ToApi(const core::RenderCounts& counts) {
  return {.camera_rays = counts.camera_rays,
          .shadow_rays = counts.shadow_rays,
          .occlusion_rays = counts.occlusion_rays,
          .normals = counts.normals};
}

api::ImageArray ToApi(core::RenderedImage image) {
  return std::visit(
      [](auto&& film) {
        api::ImageArray array;
        array.width = static_cast<std::size_t>(film.region().width());
        array.height = static_cast<std::size_t>(film.region().height());
        array.channels = static_cast<std::size_t>(film.channels());
        array.values = std::move(film).TakeValues();
        return array;
      },
      std::move(image.values));
}

api::Cell ToApi(const core::TreeCell& cell) {
  return {ToBox(cell.bounds), cell.depth, cell.leaf, cell.triangles};
}

}  // namespace kdray::server
