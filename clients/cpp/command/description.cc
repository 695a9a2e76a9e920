// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/description.h"

#include <algorithm>

#include "clients/cpp/command/text.h"

namespace kdray::client {
namespace {

// The members of a JSON object as texts for people; "" for one that is missing.
class Fields {
 public:
  explicit Fields(Document object) : object_(std::move(object)) {}

  Fields operator[](const char* name) const { return Fields(object_[name]); }

  std::string Text(const char* name) const { return object_[name].Text().value_or(""); }

  std::string Count(const char* name) const {
    const auto count = object_[name].Count();
    return count ? CountText(*count) : std::string();
  }

  std::string Bytes(const char* name) const {
    const auto bytes = object_[name].Number();
    return bytes ? ByteText(*bytes) : std::string();
  }

  std::string Number(const char* name) const {
    const auto number = object_[name].Number();
    return number ? NumberText(*number) : std::string();
  }

  std::string Duration(const char* name) const {
    const auto milliseconds = object_[name].Number();
    return milliseconds ? DurationText(*milliseconds) : std::string();
  }

  /// "x y z" of an array of three numbers.
  std::string Vector(const char* name) const { return VectorText(object_[name].Numbers()); }

  bool Is(const char* name, bool value) const { return object_[name].Flag() == value; }

 private:
  Document object_;
};

// Joins the nonempty parts: {"a", "", "b"} -> "a, b".
std::string Join(const std::vector<std::string>& parts, const char* separator = ", ") {
  std::string text;
  for (const std::string& part : parts) {
    if (part.empty()) continue;
    if (!text.empty()) text += separator;
    text += part;
  }
  return text;
}

// "12 nodes", "1 node", or "" if the number is missing.
std::string With(const std::string& number, const char* one, const char* many) {
  return number.empty() ? std::string() : number + " " + (number == "1" ? one : many);
}

// Like With, but "" for zero, so the health line of a sound mesh is short.
std::string Unless0(const std::string& number, const char* one, const char* many) {
  return number == "0" ? std::string() : With(number, one, many);
}

std::string HealthOf(const Fields& health) {
  const std::string closed = health.Is("closed", true)    ? "closed"
                             : health.Is("closed", false) ? "not closed"
                                                          : "";
  const std::string resolution = health.Number("coordinate_resolution");
  return Join(
      {closed, Unless0(health.Count("open_edges"), "open edge", "open edges"),
       Unless0(health.Count("non_manifold_edges"), "edge with more than two triangles",
               "edges with more than two triangles"),
       Unless0(health.Count("degenerate"), "triangle without area", "triangles without area"),
       Unless0(health.Count("duplicate"), "triangle twice", "triangles twice"),
       Unless0(health.Count("concave"), "concave polygon", "concave polygons"),
       resolution.empty() ? "" : "coordinates " + resolution + " apart"});
}

}  // namespace

std::string SummaryOf(const Document& description) {
  const Fields fields(description);
  const Fields mesh = fields["mesh"];
  const Fields tree = fields["tree"];
  const std::string nodes = With(tree.Count("nodes"), "node", "nodes");
  const std::string build = tree.Text("build");
  const std::string built = tree.Duration("build_ms");
  return Join({With(mesh.Count("triangles"), "triangle", "triangles"),
               build.empty() ? nodes : Join({build, nodes}, ": "),
               built.empty() ? "" : "built in " + built});
}

std::string DetailsOf(const Document& description) {
  const Fields fields(description);
  const Fields mesh = fields["mesh"];
  const Fields tree = fields["tree"];
  std::string out;
  const auto add = [&](const char* name, const std::string& value) {
    if (value.empty()) return;
    std::string label(name);
    label.resize(10, ' ');
    out += label + value + "\n";
  };
  const int percent =
      static_cast<int>(100 * std::clamp(description["progress"].Number().value_or(0), 0.0, 1.0));
  add("id", fields.Text("id"));
  add("state", fields.Text("state") == "building"
                   ? "building, " + std::to_string(percent) + "% done"
                   : fields.Text("state"));
  add("created", fields.Text("created_at"));
  add("mesh", Join({mesh.Text("format"), mesh.Bytes("bytes"),
                    With(mesh.Count("triangles"), "triangle", "triangles"),
                    With(mesh.Count("vertices"), "vertex", "vertices"),
                    Unless0(mesh.Count("dropped"), "face dropped", "faces dropped")}));
  add("bounds", Join({mesh["bounds"].Vector("min"), mesh["bounds"].Vector("max")}, "  to  "));
  const auto named = [&](const char* name, const std::string& number) {
    return number.empty() ? "" : name + (" " + number);
  };
  add("surface",
      Join({named("area", mesh.Number("area")), named("volume", mesh.Number("volume"))}));
  add("health", HealthOf(mesh["health"]));
  add("tree", Join({tree.Text("build"), With(tree.Count("nodes"), "node", "nodes"),
                    With(tree.Count("leaves"), "leaf", "leaves"),
                    With(tree.Count("empty_leaves"), "of them empty", "of them empty"),
                    With(tree.Count("references"), "reference", "references")}));
  add("", Join({tree.Count("max_depth").empty() ? "" : "depth " + tree.Count("max_depth"),
                tree.Bytes("bytes"),
                tree.Number("sah_cost").empty() ? "" : "SAH cost " + tree.Number("sah_cost")}));
  add("time",
      Join({tree.Duration("parse_ms").empty() ? "" : "read in " + tree.Duration("parse_ms"),
            tree.Duration("build_ms").empty() ? "" : "built in " + tree.Duration("build_ms")}));
  add("plan", fields.Text("plan"));
  return out;
}

std::vector<std::string> ListHeader() {
  return {"ID", "TRIANGLES", "BUILD", "STATE", "FORMAT", "SIZE", "CREATED"};
}

std::vector<std::string> ListRowOf(const Tree& tree, bool full_id) {
  const Fields fields(tree.description);
  const Fields mesh = fields["mesh"];
  std::string created = fields.Text("created_at").substr(0, 16);  // to the minute
  if (const std::size_t t = created.find('T'); t != std::string::npos) created[t] = ' ';
  return {full_id ? tree.id : ShortTreeId(tree.id),
          mesh.Count("triangles"),
          fields["tree"].Text("build"),
          fields.Text("state"),
          mesh.Text("format"),
          mesh.Bytes("bytes"),
          created};
}

}  // namespace kdray::client
