// SPDX-License-Identifier: Apache-2.0
#include "core/io/attribute_sink.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace kdray::core {
namespace {

constexpr std::size_t kMaxNameBytes = 128;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr Vec3f kNoVector = {kNan, kNan, kNan};

// The length of the UTF-8 character that a text begins with; 0 if it begins with none (RFC 3629).
std::size_t CharacterBytes(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned first = byte(0);
  if (first < 0x80) return 1;
  const std::size_t bytes = first >= 0xc2 && first < 0xe0   ? 2
                            : first >= 0xe0 && first < 0xf0 ? 3
                            : first >= 0xf0 && first < 0xf5 ? 4
                                                            : 0;
  if (bytes == 0 || bytes > text.size()) return 0;
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xc0u) != 0x80) return 0;
  }
  const unsigned second = byte(1);
  const bool is_overlong = (first == 0xe0 && second < 0xa0) || (first == 0xf0 && second < 0x90);
  const bool is_surrogate = first == 0xed && second >= 0xa0;
  const bool is_beyond = first == 0xf4 && second >= 0x90;
  return is_overlong || is_surrogate || is_beyond ? 0 : bytes;
}

// Divides by 255 if a number is beyond 1: programs that write text colour with bytes or fractions.
void ScaleColors(std::vector<Vec3f>* colors, CancelPoll* poll) {
  float greatest = 0;
  PolledLoop(colors->size(), 4, poll, [&](std::size_t i) {
    const Vec3f& color = (*colors)[i];
    for (int k = 0; k < 3; ++k) greatest = color[k] > greatest ? color[k] : greatest;
  });
  if (!(greatest > 1)) return;
  PolledLoop(colors->size(), 4, poll,
             [&](std::size_t i) { (*colors)[i] = (*colors)[i] * (1 / 255.0f); });
}

}  // namespace

std::string ShownGroupName(std::string_view name) {
  constexpr std::string_view kReplacement = "\xef\xbf\xbd";
  std::string shown;
  while (!name.empty()) {
    const std::size_t bytes = CharacterBytes(name);
    const std::string_view character = bytes == 0 ? kReplacement : name.substr(0, bytes);
    if (shown.size() + character.size() > kMaxNameBytes) break;
    shown += character;
    name.remove_prefix(std::max<std::size_t>(bytes, 1));
  }
  return shown;
}

void AttributeSink::Begin() { *this = AttributeSink(attributes_.kinds_); }

std::uint64_t AttributeSink::PlannedBytes(const Counts& counts) const {
  // A name stands in the list and in the table of numbers.
  constexpr std::uint64_t kBytesOfGroup = 2 * (kMaxNameBytes + sizeof(std::string)) + 64;
  const std::uint64_t names =
      std::min<std::uint64_t>(counts.groups, MeshAttributes::kMaxGroups) * kBytesOfGroup;
  if (attributes_.kinds_.empty()) return names;
  const std::uint64_t corner_arrays = (counts.has_vertex_values ? 1u : 0u) +
                                      (counts.has_corner_uvs ? 1u : 0u) +
                                      (counts.has_corner_normals ? 1u : 0u);
  std::uint64_t by_triangle = corner_arrays * sizeof(TriangleIndices);
  if (counts.has_face_colors) by_triangle += sizeof(Vec3f);
  if (Wants(AttributeKind::kGroup)) by_triangle += sizeof(std::int16_t);
  if (Wants(AttributeKind::kEdges)) by_triangle += 1;
  return names + counts.triangles * by_triangle + counts.uvs * sizeof(std::array<double, 2>) +
         (counts.normals + counts.vertex_colors) * sizeof(Vec3f);
}

void AttributeSink::Plan(const Counts& counts) {
  if (attributes_.kinds_.empty()) return;
  planned_triangles_ = counts.triangles;
  attributes_.uvs_.reserve(counts.uvs);
  attributes_.normals_.reserve(counts.normals);
  attributes_.vertex_colors_.reserve(counts.vertex_colors);
  if (counts.has_vertex_values) attributes_.vertex_corners_.reserve(counts.triangles);
  if (counts.has_corner_uvs) attributes_.uv_corners_.reserve(counts.triangles);
  if (counts.has_corner_normals) attributes_.normal_corners_.reserve(counts.triangles);
}

void AttributeSink::BeginValues() {
  attributes_.uvs_.clear();
  attributes_.normals_.clear();
  attributes_.vertex_colors_.clear();
}

void AttributeSink::AddNormal(const Vec3d& normal) {
  const Vec3f unit(NormalizedAtAnyScale(normal));
  attributes_.normals_.push_back(IsFinite(unit) ? unit : kNoVector);
}

void AttributeSink::AddVertexWithoutColor() { attributes_.vertex_colors_.push_back(kNoVector); }

void AttributeSink::SetGroup(std::string_view name, bool is_new) {
  next_group_ = GroupOfFaces{name, is_new};
}

void AttributeSink::EndGroup() {
  next_group_.reset();
  group_ = MeshAttributes::kNoGroup;
}

// Sets group_ to the group of the face that was just read.
void AttributeSink::FindGroup() {
  if (!next_group_) return;
  const GroupOfFaces next = *std::exchange(next_group_, std::nullopt);
  group_ = MeshAttributes::kNoGroup;
  std::string name = ShownGroupName(next.name);
  if (!next.is_new) {
    if (const auto found = group_numbers_.find(name); found != group_numbers_.end()) {
      group_ = found->second;
      return;
    }
  }
  if (attributes_.group_names_.size() == MeshAttributes::kMaxGroups) return;
  group_ = static_cast<std::int16_t>(attributes_.group_names_.size());
  if (!next.is_new) group_numbers_.emplace(name, group_);
  attributes_.group_names_.push_back(std::move(name));
}

void AttributeSink::AddFace(const Face& face, CancelPoll* poll) {
  if (face.vertices.size() < 3) return;
  FindGroup();
  PolledLoop(cuts_.size(), 32, poll, [&](std::size_t i) { AddCut(face, cuts_[i]); });
  cuts_.clear();
}

void AttributeSink::AddTriangle(const Face& face) {
  FindGroup();
  if (!attributes_.kinds_.empty()) AddCut(face, {0, 1, 2});
}

// Arrays begin with the first triangle that needs them; the ones before it get the usual value.
void AttributeSink::AddCut(const Face& face, const TriangleIndices& cut) {
  MeshAttributes& to = attributes_;
  const auto corners_of = [&](std::span<const std::uint32_t> all) -> TriangleIndices {
    return {all[cut[0]], all[cut[1]], all[cut[2]]};
  };
  const bool uses_vertices = (!to.uvs_.empty() && face.uvs.empty()) ||
                             (!to.normals_.empty() && face.normals.empty()) ||
                             !to.vertex_colors_.empty();
  if (uses_vertices) to.vertex_corners_.push_back(corners_of(face.vertices));
  if (!to.uvs_.empty() && !face.uvs.empty()) to.uv_corners_.push_back(corners_of(face.uvs));
  if (!to.normals_.empty() && !face.normals.empty()) {
    to.normal_corners_.push_back(corners_of(face.normals));
  }
  const auto add = [&](auto* values, auto value, auto usual) {
    if (values->empty()) {
      values->reserve(planned_triangles_);
      values->resize(triangles_, usual);
    }
    values->push_back(value);
  };
  if (Wants(AttributeKind::kColor) && (face.color || !to.face_colors_.empty())) {
    add(&to.face_colors_, face.color ? Vec3f(*face.color) : kNoVector, kNoVector);
  }
  if (Wants(AttributeKind::kGroup) && (group_ >= 0 || !to.groups_.empty())) {
    add(&to.groups_, group_, static_cast<std::int16_t>(MeshAttributes::kNoGroup));
  }
  const std::size_t corners = face.vertices.size();
  if (Wants(AttributeKind::kEdges) && (corners > 3 || !to.edges_.empty())) {
    unsigned edges = 0;
    for (unsigned k = 0; k < 3; ++k) {
      const std::size_t from = cut[k];
      const std::size_t to_corner = cut[(k + 1) % 3];
      const bool is_edge = (from + 1) % corners == to_corner || (to_corner + 1) % corners == from;
      edges |= is_edge ? 1u << k : 0u;
    }
    add(&to.edges_, static_cast<std::uint8_t>(edges), MeshAttributes::kAllEdges);
  }
  ++triangles_;
}

MeshAttributes AttributeSink::Finish(CancelPoll* poll) {
  if (!attributes_.has_linear_colors_) {
    ScaleColors(&attributes_.vertex_colors_, poll);
    ScaleColors(&attributes_.face_colors_, poll);
  }
  return std::move(attributes_);
}

}  // namespace kdray::core
