// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/turntable.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

#include "clients/cpp/command/camera.h"
#include "kdray/error.h"

namespace kdray::client {
namespace {

// Room around the mesh, so its silhouette does not touch the picture's edge.
constexpr double kMargin = 1.02;

class FieldSet {
 public:
  explicit FieldSet(Parameters fields) : fields_(std::move(fields)) {}

  std::string Text(const std::string& name) const {
    const auto field = std::find_if(fields_.begin(), fields_.end(),
                                    [&](const auto& pair) { return pair.first == name; });
    return field == fields_.end() ? std::string() : field->second;
  }

  double Number(const std::string& name, double absent) const {
    const std::string text = Text(name);
    double number = absent;
    std::from_chars(text.data(), text.data() + text.size(), number);  // the server names errors
    return number;
  }

  void Set(const std::string& name, const std::string& value) {
    std::erase_if(fields_, [&](const auto& pair) { return pair.first == name; });
    fields_.emplace_back(name, value);
  }

  void Drop(const std::string& name) {
    std::erase_if(fields_, [&](const auto& pair) { return pair.first == name; });
  }

  const Parameters& parameters() const { return fields_; }

 private:
  Parameters fields_;
};

std::string NumberParameter(double number) {
  std::array<char, 32> digits;
  return {digits.data(), std::to_chars(digits.data(), digits.data() + digits.size(), number).ptr};
}

}  // namespace

std::vector<Parameters> TurntableFrames(const Parameters& given, const Document& description,
                                        const std::string& format, int count) {
  FieldSet fields(given);
  const std::string projection = fields.Text("projection");
  if (projection == "spherical" || !fields.Text("extrinsic").empty()) {
    throw UsageError(
        "--turntable turns a perspective or orthographic camera that is given by its "
        "eye or its view, not spherical or extrinsic");
  }
  Vector3 up = {0, 1, 0};
  if (const std::string text = fields.Text("up"); !text.empty()) up = ParseVector(text, "--up");
  if (!(Length(up) > 0)) throw UsageError("--up must not be zero");
  up = (1 / Length(up)) * up;

  const Framing framing = Framing::Of(description);
  Vector3 target = framing.center;
  if (const std::string text = fields.Text("target"); !text.empty()) {
    target = ParseVector(text, "--target");
  }
  Vector3 to_eye;
  // How far the mesh reaches from the point that the camera looks at.
  const double reach = kMargin * (framing.radius + Length(target - framing.center));
  if (const std::string text = fields.Text("eye"); !text.empty()) {
    to_eye = ParseVector(text, "--eye") - target;
  } else {
    const auto direction = TowardViewer(up, fields.Text("view"));
    if (!direction) throw UsageError("--turntable cannot begin at the top or the bottom");
    const double aspect = fields.Number("width", 640) / fields.Number("height", 480);
    if (projection == "orthographic") {
      if (fields.Text("view_height").empty()) {
        fields.Set("view_height", NumberParameter(2 * reach * std::max(1.0, 1 / aspect)));
      }
      to_eye = (2 * reach) * *direction;
    } else {
      const double half_height = fields.Number("fov_deg", 40) * std::numbers::pi / 360;
      const double half = std::min(half_height, std::atan(std::tan(half_height) * aspect));
      to_eye = (reach / std::sin(half)) * *direction;
    }
  }
  const double distance = Length(to_eye);
  if (!(distance > 0) || !(Length(Cross(to_eye, up)) > 1e-9 * distance)) {
    throw UsageError("--turntable needs an eye beside the axis through the target");
  }
  fields.Drop("view");
  fields.Set("target", VectorParameter(target));
  fields.Set("up", VectorParameter(up));
  if (format == "png" && fields.Text("mode") == "depth" && fields.Text("depth_range").empty()) {
    fields.Set("depth_range", NumberParameter(std::max(0.0, distance - reach)) + "," +
                                  NumberParameter(distance + reach));
  }
  std::vector<Parameters> frames;
  for (int i = 0; i < count; ++i) {
    const double angle = 2 * std::numbers::pi * i / count;
    fields.Set("eye", VectorParameter(target + Turned(to_eye, up, angle)));
    frames.push_back(fields.parameters());
  }
  return frames;
}

std::string FrameName(const std::string& output, int frame, int count) {
  if (output == "-") return output;
  std::string number = std::to_string(frame);
  const std::size_t digits = std::to_string(count - 1).size();
  number.insert(0, digits - number.size(), '0');
  return std::string(output).insert(output.rfind('.'), "-" + number);
}

}  // namespace kdray::client
