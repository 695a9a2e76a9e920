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
};

/// The modes that may take more samples than the pixel's centre.
constexpr Some<RenderMode> kSampled = {RenderMode::kShaded, RenderMode::kNormal,
                                       RenderMode::kAmbientOcclusion};

constexpr std::array kFieldUses = {
    FieldUse{.field = "fov_deg", .projections = {Projection::kPerspective}},
    FieldUse{.field = "view_height", .projections = {Projection::kOrthographic}},
    FieldUse{.field = "samples", .modes = kSampled},
    FieldUse{.field = "seed", .modes = kSampled},
    FieldUse{.field = "max_samples", .modes = kSampled},
    FieldUse{.field = "max_noise", .modes = kSampled},
    FieldUse{.field = "budget_ms", .modes = kSampled},
    FieldUse{.field = "color", .modes = {RenderMode::kShaded}},
    FieldUse{.field = "lights", .modes = {RenderMode::kShaded}},
    FieldUse{.field = "shadows", .modes = {RenderMode::kShaded}},
    FieldUse{.field = "ao_radius", .modes = {RenderMode::kAmbientOcclusion}},
    FieldUse{.field = "background", .forms = {ImageForm::kPng}},
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
  return std::nullopt;
}

/// A request with only a mode, with the defaults that depend on it and the form.
RenderRequest DefaultsOf(RenderMode mode, ImageForm form) {
  RenderRequest request;
  request.mode = mode;
  request.samples = DefaultSamples(mode, form);
  request.background = DefaultBackground(mode);
  return request;
}

}  // namespace

Check CheckFieldsAreUsed(const RenderRequest& request, ImageForm form,
                         const FieldTable<RenderRequest>& table, const std::string& pointer) {
  const RenderRequest defaults = DefaultsOf(request.mode, form);
  for (const FieldUse& use : kFieldUses) {
    const std::optional<std::string> owner = Owner(use, request, form);
    const Field<RenderRequest>* field = FindField(table, use.field);
    if (!owner || field == nullptr) continue;
    const std::optional<FieldValue> value = field->get(request);
    if (!value || value == field->get(defaults)) continue;
    return Problem{ErrorCode::kInvalidParameter,
                   std::string(field->name) + " " + WriteText(field->kind, *value) +
                       " has no effect here: it belongs to " + *owner,
                   pointer + std::string(field->name)};
  }
  return std::nullopt;
}

}  // namespace kdray::api
