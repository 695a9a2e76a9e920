// SPDX-License-Identifier: Apache-2.0
#include "core/render/shader.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/render/shading.h"
#include "core/trace/leave_surface.h"

namespace kdray::core {
namespace {

float ToFloat(double light) {
  return static_cast<float>(
      std::min(light, static_cast<double>(std::numeric_limits<float>::max())));
}

// A sum that stays finite.
Vec3f Sum(const Vec3f& a, const Vec3f& b) {
  const auto add = [](float x, float y) {
    return ToFloat(static_cast<double>(x) + static_cast<double>(y));
  };
  return {add(a.x, b.x), add(a.y, b.y), add(a.z, b.z)};
}

bool IsZero(const Vec3f& v) { return v.x == 0 && v.y == 0 && v.z == 0; }

// sin and cos on [-pi/4, pi/4] to some 2^-40, the same on every machine, unlike those of a library.
double SmallSine(double x) {
  const double y = x * x;
  return x * (1 - y / 6 * (1 - y / 20 * (1 - y / 42 * (1 - y / 72 * (1 - y / 110)))));
}
double SmallCosine(double x) {
  const double y = x * x;
  return 1 - y / 2 * (1 - y / 12 * (1 - y / 30 * (1 - y / 56 * (1 - y / 90 * (1 - y / 132)))));
}

}  // namespace

double LuminanceOf(float r, float g, float b) {
  return 0.2126 * static_cast<double>(r) + 0.7152 * static_cast<double>(g) +
         0.0722 * static_cast<double>(b);
}

Vec3d CosineDirection(const Vec3d& n, const SampleWords& at) {
  // The centre of the word's interval, in (-1, 1): never 0 for both.
  const double a = (static_cast<double>(at.x) + 0.5) * 0x1p-31 - 1;
  const double b = (static_cast<double>(at.y) + 0.5) * 0x1p-31 - 1;
  constexpr double kQuarterPi = std::numbers::pi / 4;
  double x, y;
  if (std::fabs(a) >= std::fabs(b)) {
    const double angle = kQuarterPi * (b / a);
    x = a * SmallCosine(angle);
    y = a * SmallSine(angle);
  } else {
    const double angle = kQuarterPi * (a / b);
    x = b * SmallSine(angle);
    y = b * SmallCosine(angle);
  }
  const double z = std::sqrt(std::max(0.0, 1 - x * x - y * y));
  const double sign = std::copysign(1.0, n.z);
  const double c = -1 / (sign + n.z);
  const double d = n.x * n.y * c;
  const Vec3d tangent = {1 + sign * n.x * n.x * c, sign * d, -sign * n.x};
  const Vec3d other = {d, sign + n.y * n.y * c, -n.y};
  return tangent * x + other * y + n * z;
}

Shader::Shader(const Scene& scene, const RenderSpec& spec, const TraceOptions& trace_options)
    : scene_(scene),
      mesh_(*scene.mesh),
      mode_(spec.mode),
      trace_options_(trace_options),
      color_([&] {
        const Rgb linear = SrgbToLinear(spec.color);
        return Vec3f{linear.r, linear.g, linear.b};
      }()),
      has_lights_(spec.lights.has_value()),
      shadows_(spec.shadows),
      smooth_normals_(spec.smooth_normals),
      file_colors_(spec.file_colors),
      ao_radius_(spec.ao_radius.value_or(DefaultAoRadius(scene.mesh->bounds()))) {
  if (!spec.lights) return;
  for (const Light& light : *spec.lights) lights_.emplace_back(light, mesh_.bounds());
}

double Shader::LuminanceOf(const Vec3f& value) const {
  switch (mode_) {
    case RenderMode::kNormal:
      return core::LuminanceOf((value.x + 1) / 2, (value.y + 1) / 2, (value.z + 1) / 2);
    case RenderMode::kAmbientOcclusion:
      return static_cast<double>(value.x);
    default:
      return core::LuminanceOf(value.x, value.y, value.z);
  }
}

Status Shader::Shade(const RayBatch& rays, TileScratch* scratch) const {
  scratch->values.resize(scratch->hits.size());
  switch (mode_) {
    case RenderMode::kNormal:
      WriteNormals(scratch);
      return {};
    case RenderMode::kAmbientOcclusion:
      return FindOcclusion(rays, scratch);
    default:
      break;
  }
  if (has_lights_ || smooth_normals_ || file_colors_) return ShadeByLights(rays, scratch);
  // Shadows are no question here: the viewer sees all that the light at the eye meets.
  if (const RayF* floats = rays.floats()) {
    ShadeByHeadlight(floats, scratch);
  } else {
    ShadeByHeadlight(rays.doubles(), scratch);
  }
  return {};
}

template <class T>
void Shader::ShadeByHeadlight(const RayOf<T>* rays, TileScratch* scratch) const {
  for (std::size_t i = 0; i < scratch->hits.size(); ++i) {
    const Hit& hit = scratch->hits[i];
    if (!hit.IsHit()) {
      scratch->values[i] = {};
      continue;
    }
    const Vec3f& normal = scratch->normal_cache.Normal(mesh_, hit.primitive_id, &scratch->counts);
    scratch->values[i] = color_ * HeadlightCosine(Vec3<T>(normal), rays[i].direction);
  }
}

void Shader::WriteNormals(TileScratch* scratch) const {
  for (std::size_t i = 0; i < scratch->hits.size(); ++i) {
    const Hit& hit = scratch->hits[i];
    scratch->values[i] =
        hit.IsHit() ? scratch->normal_cache.Normal(mesh_, hit.primitive_id, &scratch->counts)
                    : Vec3f{};
  }
}

// Fills scratch->normals, on the viewer's side of the triangle, and with smooth_normals_
// scratch->smooth_normals, on the same side.
void Shader::FaceViewer(const RayBatch& rays, TileScratch* scratch) const {
  scratch->normals.resize(scratch->hits.size());
  for (std::size_t i = 0; i < scratch->hits.size(); ++i) {
    const Hit& hit = scratch->hits[i];
    if (!hit.IsHit()) continue;
    const Vec3f& normal = scratch->normal_cache.Normal(mesh_, hit.primitive_id, &scratch->counts);
    const bool is_back = Dot(Vec3d(normal), rays[i].direction) > 0;
    scratch->normals[i] = is_back ? -normal : normal;
  }
  if (!smooth_normals_) return;
  scratch->smooth_normals = scratch->normals;
  for (std::size_t i = 0; i < scratch->hits.size(); ++i) {
    const Hit& hit = scratch->hits[i];
    if (!hit.IsHit()) continue;
    const Vec3f smooth(smooth_normals_(hit.primitive_id, hit.u, hit.v));
    if (!IsFinite(smooth)) continue;
    scratch->smooth_normals[i] = Dot(smooth, scratch->normals[i]) < 0 ? -smooth : smooth;
  }
}

Status Shader::ShadeByLights(const RayBatch& rays, TileScratch* scratch) const {
  std::fill(scratch->values.begin(), scratch->values.end(), Vec3f{});
  FaceViewer(rays, scratch);
  if (!has_lights_) AddHeadlight(rays, scratch);
  for (const LightSource& light : lights_) {
    if (Status status = AddLight(light, scratch); !status.ok()) return status;
  }
  MultiplyByColors(scratch);
  return {};
}

void Shader::AddHeadlight(const RayBatch& rays, TileScratch* scratch) const {
  for (std::uint32_t i = 0; i < scratch->hits.size(); ++i) {
    if (!scratch->hits[i].IsHit()) continue;
    const double cosine = CosineOf(-Normalized(rays[i].direction), i, *scratch);
    const float light = cosine > 0 ? static_cast<float>(cosine) : 0.0f;
    scratch->values[i] = {light, light, light};
  }
}

// Between the surface's normal and the unit vector to a light; at most 0 if the light is on the
// other side of the triangle.
double Shader::CosineOf(const Vec3d& to_light, std::uint32_t sample,
                        const TileScratch& scratch) const {
  // A triangle whose normal double cannot resolve is at most a line; black looks like a crack.
  if (IsZero(scratch.normals[sample])) return 1;
  const double cosine = std::min(Dot(Vec3d(scratch.normals[sample]), to_light), 1.0);
  if (!smooth_normals_ || !(cosine > 0)) return cosine;
  return std::min(Dot(Vec3d(scratch.smooth_normals[sample]), to_light), 1.0);
}

void Shader::MultiplyByColors(TileScratch* scratch) const {
  for (std::size_t i = 0; i < scratch->hits.size(); ++i) {
    const Hit& hit = scratch->hits[i];
    if (!hit.IsHit()) continue;
    Vec3d color(color_);
    if (file_colors_) {
      const Vec3d own = file_colors_(hit.primitive_id, hit.u, hit.v);
      if (IsFinite(own)) color = own;
    }
    const Vec3d value(scratch->values[i]);
    scratch->values[i] = {ToFloat(value.x * color.x), ToFloat(value.y * color.y),
                          ToFloat(value.z * color.z)};
  }
}

Status Shader::AddLight(const LightSource& light, TileScratch* scratch) const {
  scratch->secondary_rays.clear();
  scratch->contributions.clear();
  for (std::uint32_t i = 0; i < scratch->hits.size(); ++i) {
    const Hit& hit = scratch->hits[i];
    if (!hit.IsHit()) continue;
    const LightSource::Arrival arrival = light.At(light.is_point() ? PointOf(hit) : Vec3d{});
    const double cosine = CosineOf(arrival.to_light, i, *scratch);
    if (!(cosine > 0)) continue;
    const Vec3f value = {ToFloat(arrival.r * cosine), ToFloat(arrival.g * cosine),
                         ToFloat(arrival.b * cosine)};
    scratch->contributions.push_back({i, value});
    if (!shadows_) continue;
    Ray ray;
    ray.origin = LeaveSurface(mesh_, hit, arrival.to_light, trace_options_.precision);
    if (light.is_point()) {
      ray.direction = light.place() - ray.origin;
      ray.t_max = 1;
    } else {
      ray.direction = arrival.to_light;
    }
    scratch->secondary_rays.push_back(ray);
  }
  if (shadows_) {
    scratch->counts.shadow_rays += scratch->secondary_rays.size();
    return AddVisible(scratch);
  }
  for (const TileScratch::Contribution& add : scratch->contributions) {
    Vec3f& value = scratch->values[add.sample];
    value = Sum(value, add.value);
  }
  return {};
}

// Adds the contributions whose rays meet nothing.
Status Shader::AddVisible(TileScratch* scratch) const {
  const std::span<const Ray> rays = scratch->secondary_rays;
  scratch->occluded.resize(rays.size());
  Status status = TraceAny(scene_, rays, trace_options_, scratch->occluded);
  if (!status.ok()) return status;
  for (std::size_t k = 0; k < rays.size(); ++k) {
    if (scratch->occluded[k] != 0) continue;
    Vec3f& value = scratch->values[scratch->contributions[k].sample];
    value = Sum(value, scratch->contributions[k].value);
  }
  return {};
}

Status Shader::FindOcclusion(const RayBatch& rays, TileScratch* scratch) const {
  std::fill(scratch->values.begin(), scratch->values.end(), Vec3f{});
  FaceViewer(rays, scratch);
  scratch->secondary_rays.clear();
  scratch->contributions.clear();
  for (std::uint32_t i = 0; i < scratch->hits.size(); ++i) {
    const Hit& hit = scratch->hits[i];
    if (!hit.IsHit()) continue;
    if (IsZero(scratch->normals[i])) {
      scratch->values[i].x = 1;
      continue;
    }
    Ray ray;
    ray.direction = CosineDirection(Vec3d(scratch->normals[i]), scratch->directions[i]);
    ray.origin = LeaveSurface(mesh_, hit, ray.direction, trace_options_.precision);
    ray.t_max = ao_radius_;
    scratch->secondary_rays.push_back(ray);
    scratch->contributions.push_back({i, {1, 0, 0}});
  }
  scratch->counts.occlusion_rays += scratch->secondary_rays.size();
  return AddVisible(scratch);
}

Vec3d Shader::PointOf(const Hit& hit) const {
  const Vec3d a = mesh_.LocalCorner(hit.primitive_id, 0);
  const Vec3d b = mesh_.LocalCorner(hit.primitive_id, 1);
  const Vec3d c = mesh_.LocalCorner(hit.primitive_id, 2);
  return mesh_.frame().ToWorld(a * (1 - hit.u - hit.v) + b * hit.u + c * hit.v);
}

}  // namespace kdray::core
