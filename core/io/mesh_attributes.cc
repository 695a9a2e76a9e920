// SPDX-License-Identifier: Apache-2.0
#include "core/io/mesh_attributes.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/cancel_poll.h"
#include "core/io/attribute_sink.h"

namespace kdray::core {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr Vec3d kNoVector = {kNan, kNan, kNan};

// The standard curve of sRGB (IEC 61966-2-1).
double SrgbToLinear(double encoded) {
  return encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
}

Vec3d Mix(const Vec3f& a, const Vec3f& b, const Vec3f& c, double u, double v) {
  return Vec3d(a) * (1 - u - v) + Vec3d(b) * u + Vec3d(c) * v;
}

template <class T>
std::uint64_t BytesOf(const std::vector<T>& values) {
  return values.capacity() * sizeof(T);
}

}  // namespace

bool MeshAttributes::has(AttributeKind kind) const {
  switch (kind) {
    case AttributeKind::kUv:
      return !uvs_.empty();
    case AttributeKind::kShadingNormal:
      return !normals_.empty();
    case AttributeKind::kColor:
      return !vertex_colors_.empty() || !face_colors_.empty();
    case AttributeKind::kGroup:
      return !groups_.empty();
    case AttributeKind::kEdges:
      return !edges_.empty();
  }
  return false;
}

std::array<double, 2> MeshAttributes::Uv(PrimitiveId id, double u, double v) const {
  if (uvs_.empty()) return {kNan, kNan};
  const auto [a, b, c] = (uv_corners_.empty() ? vertex_corners_ : uv_corners_)[id];
  if (a == kNoValue || b == kNoValue || c == kNoValue) return {kNan, kNan};
  const double w = 1 - u - v;
  const std::array<double, 2> uv = {w * uvs_[a][0] + u * uvs_[b][0] + v * uvs_[c][0],
                                    w * uvs_[a][1] + u * uvs_[b][1] + v * uvs_[c][1]};
  if (!std::isfinite(uv[0]) || !std::isfinite(uv[1])) return {kNan, kNan};
  return uv;
}

Vec3d MeshAttributes::ShadingNormal(PrimitiveId id, double u, double v) const {
  if (normals_.empty()) return kNoVector;
  const auto [a, b, c] = (normal_corners_.empty() ? vertex_corners_ : normal_corners_)[id];
  if (a == kNoValue || b == kNoValue || c == kNoValue) return kNoVector;
  const Vec3d normal = NormalizedAtAnyScale(Mix(normals_[a], normals_[b], normals_[c], u, v));
  return IsFinite(normal) ? normal : kNoVector;
}

Vec3d MeshAttributes::Color(PrimitiveId id, double u, double v) const {
  Vec3d color = kNoVector;
  if (!vertex_colors_.empty()) {
    const auto [a, b, c] = vertex_corners_[id];
    color = Mix(vertex_colors_[a], vertex_colors_[b], vertex_colors_[c], u, v);
  } else if (!face_colors_.empty()) {
    color = Vec3d(face_colors_[id]);
  }
  if (!IsFinite(color)) return kNoVector;
  for (int i = 0; i < 3; ++i) {
    color[i] = std::clamp(color[i], 0.0, 1.0);
    if (!has_linear_colors_) color[i] = SrgbToLinear(color[i]);
  }
  return color;
}

std::uint64_t MeshAttributes::bytes() const {
  std::uint64_t names = BytesOf(group_names_);
  for (const std::string& name : group_names_) names += name.capacity();
  return sizeof(*this) + BytesOf(vertex_corners_) + BytesOf(uv_corners_) +
         BytesOf(normal_corners_) + BytesOf(uvs_) + BytesOf(normals_) + BytesOf(vertex_colors_) +
         BytesOf(face_colors_) + BytesOf(groups_) + names + BytesOf(edges_);
}

Result<MeshAttributes> ReadAttributes(std::span<const std::byte> bytes, AttributeKinds kinds,
                                      const MeshReadOptions& options) {
  AttributeSink sink(kinds);
  MeshReadOptions with_sink = options;
  with_sink.attributes = &sink;
  const Result<MeshData> mesh = ReadMesh(bytes, with_sink);
  if (!mesh.ok()) return mesh.error();
  CancelPoll poll(options.cancel);
  MeshAttributes attributes = sink.Finish(&poll);
  if (poll.stopped()) return poll.ToError();
  return attributes;
}

}  // namespace kdray::core
