// SPDX-License-Identifier: Apache-2.0
#include "core/io/ply_attributes.h"

#include <optional>

namespace kdray::core {
namespace {

using Pair = std::array<std::string_view, 2>;
using Triple = std::array<std::string_view, 3>;

constexpr std::array<Pair, 4> kUvs = {
    {{"s", "t"}, {"u", "v"}, {"texture_u", "texture_v"}, {"texture_s", "texture_t"}}};
constexpr Triple kNormal = {"nx", "ny", "nz"};
constexpr std::array<Triple, 3> kColors = {
    {{"red", "green", "blue"}, {"diffuse_red", "diffuse_green", "diffuse_blue"}, {"r", "g", "b"}}};

}  // namespace

PlyAttributes::PlyAttributes(const PlyElement* element, const AttributeSink* sink) {
  if (element == nullptr || sink == nullptr) return;
  if (sink->Wants(AttributeKind::kUv)) {
    for (const Pair& names : kUvs) {
      has_uv_ = has_uv_ || Find(*element, PlyMeaning::kUv, names);
    }
  }
  if (sink->Wants(AttributeKind::kShadingNormal)) {
    has_normal_ = Find(*element, PlyMeaning::kNormal, kNormal);
  }
  if (sink->Wants(AttributeKind::kColor)) {
    for (const Triple& names : kColors) {
      has_color_ = has_color_ || Find(*element, PlyMeaning::kColor, names);
    }
  }
}

bool PlyAttributes::Find(const PlyElement& element, PlyMeaning meaning,
                         std::span<const std::string_view> names) {
  std::array<std::size_t, 3> places{};
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::optional<std::size_t> place = element.Find(names[i]);
    if (!place || element.properties[*place].IsList()) return false;
    places[i] = *place;
  }
  uses_.resize(element.properties.size());
  for (std::size_t i = 0; i < names.size(); ++i) uses_[places[i]] = {meaning, static_cast<int>(i)};
  return true;
}

double FullPlyColor(PlyType type) {
  switch (type) {
    case PlyType::kFloat32:
    case PlyType::kFloat64:
      return 1;
    case PlyType::kUint16:
      return 65535;
    default:
      return 255;
  }
}

}  // namespace kdray::core
