// SPDX-License-Identifier: Apache-2.0
#include "api/field_use.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <span>
#include <string_view>

#include "api/names.h"

namespace kdray::api {
namespace {

constexpr std::array<std::string_view, 2> kFormNames = {"render.png", "render.npy"};

/// Some enumerators of `Enum`; by default all.
template <class Enum>
class Some {
 public:
  constexpr Some() = default;
  constexpr Some(std::initializer_list<Enum> members) : bits_(0) {
    for (const Enum member : members) bits_ |= Bit(member);
  }
  constexpr Some operator~() const {
    Some others;
    others.bits_ = ~bits_;
    return others;
  }
  constexpr bool Has(Enum member) const { return (bits_ & Bit(member)) != 0; }

  /// "shaded or normal"
  std::string Words(std::span<const std::string_view> names) const {
    std::string words;
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (!Has(static_cast<Enum>(i))) continue;
      if (!words.empty()) words += " or ";
      words += names[i];
    }
    return words;
  }

 private:
  static constexpr std::uint32_t Bit(Enum member) {
    return std::uint32_t{1} << static_cast<unsigned>(member);
  }
  std::uint32_t bits_ = ~std::uint32_t{0};
};

struct FieldUse {
  std::string_view field;
  Some<Projection> projections = {};
  Some<RenderMode> modes = {};
  Some<ImageForm> forms = {};
  Some<RenderMode> array_modes =
      {};  ///< the modes whose arrays use it, where a picture always does
};

constexpr Some<Projection> kFlat = {Projection::kPerspective, Projection::kOrthographic};

/// The modes that may take more samples than the pixel's centre.
constexpr Some<RenderMode> kSampled = ~Some<RenderMode>{RenderMode::kDepth, RenderMode::kTriangle,
                                                        RenderMode::kCost, RenderMode::kPosition};

constexpr std::array kFieldUses = {
    FieldUse{.field = "fov_deg", .projections = {Projection::kPerspective}},
    FieldUse{.field = "view_height", .projections = {Projection::kOrthographic}},
    FieldUse{.field = "h_fov_deg", .projections = {Projection::kSpherical}},
    FieldUse{.field = "v_fov_deg", .projections = {Projection::kSpherical}},
    FieldUse{.field = "intrinsic", .projections = {Projection::kPerspective}},
    FieldUse{.field = "extrinsic", .projections = {Projection::kPerspective}},
    FieldUse{.field = "cells_depth", .projections = kFlat, .array_modes = {RenderMode::kShaded}},
    FieldUse{.field = "edges", .array_modes = {RenderMode::kShaded}},
    FieldUse{.field = "depth_range", .modes = {RenderMode::kDepth}, .forms = {ImageForm::kPng}},
    FieldUse{.field = "samples", .modes = kSampled},
    FieldUse{.field = "seed", .modes = kSampled},
    FieldUse{.field = "max_samples", .modes = kSampled},
    FieldUse{.field = "max_noise", .modes = kSampled},
    FieldUse{.field = "budget_ms", .modes = kSampled},
    FieldUse{.field = "color", .modes = {RenderMode::kShaded}},
    FieldUse{.field = "lights", .modes = {RenderMode::kShaded}},
    FieldUse{.field = "shadows", .modes = {RenderMode::kShaded}},
    FieldUse{.field = "smooth", .modes = {RenderMode::kShaded}},
    FieldUse{.field = "ao_radius", .modes = {RenderMode::kAmbientOcclusion}},
    FieldUse{.field = "background", .forms = {ImageForm::kPng}},
};

/// A request with `field` has no use for `replaced`.
struct Replacement {
  std::string_view field, replaced;
};

constexpr std::array kReplacements = {
    Replacement{"extrinsic", "eye"}, Replacement{"extrinsic", "target"},
    Replacement{"extrinsic", "up"},  Replacement{"extrinsic", "view"},
    Replacement{"eye", "view"},      Replacement{"intrinsic", "fov_deg"},
};

/// The mode, projection or form that the field belongs to, if the request does not use the field;
/// else nullopt.
std::optional<std::string> Owner(const FieldUse& use, const RenderRequest& request,
                                 ImageForm form) {
  if (!use.projections.Has(request.projection)) {
    return "projection " + use.projections.Words(kProjectionNames) + ", not to " +
           std::string(Name(request.projection));
  }
  if (!use.modes.Has(request.mode)) {
    return "mode " + use.modes.Words(kRenderModeNames) + ", not to " +
           std::string(Name(request.mode));
  }
  if (!use.forms.Has(form)) {
    return use.forms.Words(kFormNames) + ", not to " +
           std::string(kFormNames[static_cast<std::size_t>(form)]);
  }
  if (form == ImageForm::kNpy && !use.array_modes.Has(request.mode)) {
    return "render.png and to arrays of mode " + use.array_modes.Words(kRenderModeNames) +
           ", not to arrays of mode " + std::string(Name(request.mode));
  }
  return std::nullopt;
}

/// A request with only a mode, with the defaults that depend on it and the form.
RenderRequest DefaultsOf(RenderMode mode, ImageForm form) {
  RenderRequest request;
  request.mode = mode;
  request.samples = DefaultSamples(mode, form);
  request.background = DefaultBackground(mode);
  request.up = kDefaultUp;
  return request;
}

}  // namespace

Check CheckFieldsAreUsed(const RenderRequest& request, ImageForm form,
                         const FieldTable<RenderRequest>& table, const std::string& pointer) {
  const RenderRequest defaults = DefaultsOf(request.mode, form);
  const auto refuse_unless_default = [&](std::string_view name, const std::string& why) -> Check {
    const Field<RenderRequest>* field = FindField(table, name);
    if (field == nullptr) return std::nullopt;
    const std::optional<FieldValue> value = field->get(request);
    if (!value || value == field->get(defaults)) return std::nullopt;
    return Problem{
        ErrorCode::kInvalidParameter,
        std::string(name) + " " + WriteText(field->kind, *value) + " has no effect here: " + why,
        pointer + std::string(name)};
  };
  for (const FieldUse& use : kFieldUses) {
    const std::optional<std::string> owner = Owner(use, request, form);
    if (!owner) continue;
    if (Check unused = refuse_unless_default(use.field, "it belongs to " + *owner)) return unused;
  }
  for (const auto& [name, replaced] : kReplacements) {
    const Field<RenderRequest>* field = FindField(table, name);
    if (field == nullptr || !field->get(request)) continue;
    const std::string why = std::string(name) + " replaces it";
    if (Check unused = refuse_unless_default(replaced, why)) return unused;
  }
  return std::nullopt;
}

}  // namespace kdray::api
