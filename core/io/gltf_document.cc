// SPDX-License-Identifier: Apache-2.0
#include "core/io/gltf_document.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/io/format_sniffer.h"
#include "core/io/gltf_json.h"
#include "core/io/mesh_error.h"

namespace kdray::core {
namespace {

using Json = nlohmann::json;

constexpr const char* kQuantization = "KHR_mesh_quantization";
constexpr const char* kMeshopt = "EXT_meshopt_compression";

// A JSON value and where it stands. The pointer is made only for an error.
struct Place {
  const Json* value = nullptr;
  const Place* parent = nullptr;
  const char* name = nullptr;  // in an object; else `index`
  std::size_t index = 0;

  std::string Pointer() const {
    if (parent == nullptr) return {};
    return parent->Pointer() + "/" + (name != nullptr ? std::string(name) : std::to_string(index));
  }
};

class DocumentReader {
 public:
  DocumentReader(const std::vector<std::string_view>& uris, CancelPoll* poll)
      : uris_(uris), poll_(poll) {}

  Result<GltfDocument> Read(const Json& json) {
    const Place root{&json};
    CheckVersion(root);
    CheckExtensions(root);
    ForEach(root, "buffers", [&](const Place& place) { AddBuffer(place); });
    ForEach(root, "bufferViews", [&](const Place& place) { AddView(place); });
    ForEach(root, "accessors", [&](const Place& place) { AddAccessor(place); });
    ForEach(root, "meshes", [&](const Place& place) { AddMesh(place); });
    ForEach(root, "nodes", [&](const Place& place) { AddNode(place); });
    FindRoots(root);
    if (poll_->stopped()) return poll_->ToError();
    if (error_) return *std::move(error_);
    return std::move(document_);
  }

 private:
  // The first error counts; what is read after it is dropped.
  void Fail(const Place& place, std::string_view cause) {
    if (!error_) error_ = AtPointer(place.Pointer(), cause);
  }
  bool failed() const { return error_.has_value(); }

  static std::optional<Place> Find(const Place& object, const char* name) {
    if (!object.value->is_object()) return std::nullopt;
    const auto found = object.value->find(name);
    if (found == object.value->end()) return std::nullopt;
    return Place{&*found, &object, name};
  }

  // Calls visit(place) for each element of a list, which may be missing.
  template <class Visit>
  void ForEach(const Place& object, const char* name, const Visit& visit) {
    const std::optional<Place> list = Find(object, name);
    if (!list) return;
    if (!list->value->is_array()) return Fail(*list, "is not an array");
    for (std::size_t i = 0; i < list->value->size(); ++i) {
      if (failed() || poll_->Spend(256)) return;
      visit(Place{&(*list->value)[i], &*list, nullptr, i});
    }
  }
  template <class Visit>
  void ForEachObject(const Place& object, const char* name, const Visit& visit) {
    ForEach(object, name, [&](const Place& place) {
      if (!place.value->is_object()) return Fail(place, "is not an object");
      visit(place);
    });
  }

  std::optional<std::uint64_t> ToUint(const Place& place) {
    const Json& value = *place.value;
    constexpr double kLargest = 0x1p53;
    if (value.is_number_unsigned()) return value.get<std::uint64_t>();
    if (value.is_number_float()) {
      const auto number = value.get<double>();
      if (number >= 0 && number <= kLargest && number == std::floor(number)) {
        return static_cast<std::uint64_t>(number);
      }
    }
    Fail(place, "is not an integer from 0 on");
    return std::nullopt;
  }
  std::optional<std::uint64_t> Uint(const Place& object, const char* name) {
    const std::optional<Place> place = Find(object, name);
    return place ? ToUint(*place) : std::nullopt;
  }
  std::uint64_t UintOr(const Place& object, const char* name, std::uint64_t missing) {
    return Uint(object, name).value_or(missing);
  }
  std::uint64_t NeedUint(const Place& object, const char* name) {
    const std::optional<std::uint64_t> value = Uint(object, name);
    if (!value) Fail(object, "has no '" + std::string(name) + "'");
    return value.value_or(0);
  }

  // A name or another text that is not needed: of any other kind, it is as if it was missing.
  static std::string Text(const Place& object, const char* name) {
    const std::optional<Place> place = Find(object, name);
    return place && place->value->is_string() ? place->value->get<std::string>() : std::string();
  }

  // Numbers of a list that has exactly so many; false if it is missing.
  template <std::size_t N>
  bool Numbers(const Place& object, const char* name, std::array<double, N>* numbers) {
    const std::optional<Place> list = Find(object, name);
    if (!list) return false;
    const Json& values = *list->value;
    const bool fits = values.is_array() && values.size() == N &&
                      std::all_of(values.begin(), values.end(),
                                  [](const Json& value) { return value.is_number(); });
    if (!fits) {
      Fail(*list, "is not an array of " + std::to_string(N) + " numbers");
      return false;
    }
    for (std::size_t i = 0; i < N; ++i) (*numbers)[i] = values[i].get<double>();
    return true;
  }

  void CheckVersion(const Place& root) {
    const std::optional<Place> asset = Find(root, "asset");
    if (!asset) {
      error_ = UnsupportedFormat("JSON without 'asset', so they are not glTF");
      return;
    }
    const std::string version = Text(*asset, "version");
    const std::string least = Text(*asset, "minVersion");
    const bool is_readable = version.starts_with("2.") && (least.empty() || least == "2.0");
    if (is_readable) return;
    Fail(*asset, "needs glTF " + Quoted(least.empty() ? version : least) + "; 2.0 is read");
  }

  void CheckExtensions(const Place& root) {
    const auto note = [&](const Place& place) {
      if (*place.value == kQuantization) document_.may_be_quantized = true;
    };
    ForEach(root, "extensionsUsed", note);
    ForEach(root, "extensionsRequired", [&](const Place& place) {
      note(place);
      if (!place.value->is_string()) return Fail(place, "is not a string");
      const auto name = place.value->get<std::string>();
      if (name == kQuantization || name == kMeshopt) return;
      Fail(place, "the file needs the extension " + Quoted(name) + ", which is not read; " +
                      kQuantization + " and " + kMeshopt + " are");
    });
  }

  void AddBuffer(const Place& place) {
    GltfBuffer buffer;
    buffer.bytes = NeedUint(place, "byteLength");
    const std::string uri = Text(place, "uri");
    constexpr std::string_view kReplaced = "data:#";
    if (uri.starts_with(kReplaced)) {
      std::size_t number = uris_.size();
      std::from_chars(uri.data() + kReplaced.size(), uri.data() + uri.size(), number);
      if (number < uris_.size()) buffer.data_uri = uris_[number];
    }
    if (!buffer.data_uri) buffer.other_uri = uri.substr(0, 64);
    document_.buffers.push_back(std::move(buffer));
  }

  void AddView(const Place& place) {
    GltfView view;
    view.buffer = NeedUint(place, "buffer");
    view.offset = UintOr(place, "byteOffset", 0);
    view.bytes = NeedUint(place, "byteLength");
    view.stride = UintOr(place, "byteStride", 0);
    if (const std::optional<Place> extensions = Find(place, "extensions")) {
      if (const std::optional<Place> meshopt = Find(*extensions, kMeshopt)) {
        view.meshopt = ReadMeshopt(*meshopt);
      }
    }
    document_.views.push_back(view);
  }

  GltfMeshopt ReadMeshopt(const Place& place) {
    GltfMeshopt meshopt;
    meshopt.buffer = NeedUint(place, "buffer");
    meshopt.offset = UintOr(place, "byteOffset", 0);
    meshopt.bytes = NeedUint(place, "byteLength");
    meshopt.form.stride = NeedUint(place, "byteStride");
    meshopt.form.count = NeedUint(place, "count");
    meshopt.form.mode = OneOf<MeshoptMode>(place, "mode", "",
                                           {{"ATTRIBUTES", MeshoptMode::kAttributes},
                                            {"TRIANGLES", MeshoptMode::kTriangles},
                                            {"INDICES", MeshoptMode::kIndices}});
    meshopt.form.filter = OneOf<MeshoptFilter>(place, "filter", "NONE",
                                               {{"NONE", MeshoptFilter::kNone},
                                                {"OCTAHEDRAL", MeshoptFilter::kOctahedral},
                                                {"QUATERNION", MeshoptFilter::kQuaternion},
                                                {"EXPONENTIAL", MeshoptFilter::kExponential}});
    return meshopt;
  }

  // The value whose name a member has; `missing` stands for a member that is not there.
  template <class T>
  T OneOf(const Place& object, const char* name, std::string missing,
          std::initializer_list<std::pair<const char*, T>> known) {
    const std::string text = Find(object, name) ? Text(object, name) : std::move(missing);
    std::string names;
    for (const auto& [word, value] : known) {
      if (text == word) return value;
      names += (names.empty() ? "" : ", ") + std::string(word);
    }
    Fail(object, "has the " + std::string(name) + " " + Quoted(text) + "; allowed are " + names);
    return known.begin()->second;
  }

  GltfType Type(const Place& object) {
    const std::uint64_t type = NeedUint(object, "componentType");
    for (const GltfType known :
         {GltfType::kByte, GltfType::kUnsignedByte, GltfType::kShort, GltfType::kUnsignedShort,
          GltfType::kUnsignedInt, GltfType::kFloat}) {
      if (type == static_cast<std::uint64_t>(known)) return known;
    }
    Fail(object, "has the componentType " + std::to_string(type) +
                     "; allowed are 5120, 5121, 5122, 5123, 5125, 5126");
    return GltfType::kFloat;
  }

  static std::uint8_t Components(const std::string& type) {
    if (type == "SCALAR") return 1;
    if (type == "VEC2") return 2;
    if (type == "VEC3") return 3;
    if (type == "VEC4") return 4;
    return 0;
  }

  void AddAccessor(const Place& place) {
    GltfAccessor accessor;
    accessor.view = Uint(place, "bufferView");
    accessor.offset = UintOr(place, "byteOffset", 0);
    accessor.count = NeedUint(place, "count");
    accessor.type = Type(place);
    accessor.components = Components(Text(place, "type"));
    const std::optional<Place> normalized = Find(place, "normalized");
    accessor.normalized = normalized && *normalized->value == true;
    if (const std::optional<Place> sparse = Find(place, "sparse")) {
      accessor.sparse = ReadSparse(*sparse);
    }
    document_.accessors.push_back(accessor);
  }

  GltfSparse ReadSparse(const Place& place) {
    GltfSparse sparse;
    sparse.count = NeedUint(place, "count");
    const std::optional<Place> indices = Find(place, "indices");
    const std::optional<Place> values = Find(place, "values");
    if (!indices || !values) {
      Fail(place, "has no 'indices' or no 'values'");
      return sparse;
    }
    sparse.index_view = NeedUint(*indices, "bufferView");
    sparse.index_offset = UintOr(*indices, "byteOffset", 0);
    sparse.index_type = Type(*indices);
    sparse.value_view = NeedUint(*values, "bufferView");
    sparse.value_offset = UintOr(*values, "byteOffset", 0);
    return sparse;
  }

  void AddMesh(const Place& place) {
    GltfMesh mesh;
    mesh.name = Text(place, "name");
    mesh.primitives.first = static_cast<std::uint32_t>(document_.primitives.size());
    ForEachObject(place, "primitives", [&](const Place& primitive) { AddPrimitive(primitive); });
    mesh.primitives.count =
        static_cast<std::uint32_t>(document_.primitives.size()) - mesh.primitives.first;
    document_.meshes.push_back(std::move(mesh));
  }

  void AddPrimitive(const Place& place) {
    GltfPrimitive primitive;
    const std::uint64_t mode = UintOr(place, "mode", 4);
    if (mode > 6) return Fail(place, "has the mode " + std::to_string(mode) + "; 0 to 6 exist");
    primitive.mode = static_cast<GltfMode>(mode);
    if (const std::optional<Place> attributes = Find(place, "attributes")) {
      primitive.position = Uint(*attributes, "POSITION");
      primitive.normal = Uint(*attributes, "NORMAL");
      primitive.uv = Uint(*attributes, "TEXCOORD_0");
      primitive.color = Uint(*attributes, "COLOR_0");
    }
    primitive.indices = Uint(place, "indices");
    document_.primitives.push_back(primitive);
  }

  void AddNode(const Place& place) {
    GltfNode node;
    node.name = Text(place, "name");
    node.mesh = Uint(place, "mesh");
    node.children.first = static_cast<std::uint32_t>(document_.links.size());
    ForEach(place, "children",
            [&](const Place& child) { document_.links.push_back(ToUint(child).value_or(0)); });
    node.children.count = static_cast<std::uint32_t>(document_.links.size()) - node.children.first;
    node.transform = ReadTransform(place);
    document_.nodes.push_back(std::move(node));
  }

  GltfTransform ReadTransform(const Place& place) {
    std::array<double, 16> m{};
    if (Numbers(place, "matrix", &m)) {
      return {{m[0], m[1], m[2]}, {m[4], m[5], m[6]}, {m[8], m[9], m[10]}, {m[12], m[13], m[14]}};
    }
    GltfTransform transform;
    std::array<double, 4> rotation{};
    if (Numbers(place, "rotation", &rotation)) {
      const auto [x, y, z, w] = rotation;
      transform.x = {1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)};
      transform.y = {2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)};
      transform.z = {2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)};
    }
    std::array<double, 3> numbers{};
    if (Numbers(place, "scale", &numbers)) {
      transform.x = transform.x * numbers[0];
      transform.y = transform.y * numbers[1];
      transform.z = transform.z * numbers[2];
    }
    if (Numbers(place, "translation", &numbers)) {
      transform.offset = {numbers[0], numbers[1], numbers[2]};
    }
    return transform;
  }

  void FindRoots(const Place& root) {
    const std::optional<Place> named = Find(root, "scene");
    const std::uint64_t number = named ? ToUint(*named).value_or(0) : 0;
    const std::optional<Place> scenes = Find(root, "scenes");
    const std::size_t count = scenes && scenes->value->is_array() ? scenes->value->size() : 0;
    if (number >= count) {
      if (!named && count == 0) return FindOrphans();
      return Fail(*named, "scene " + std::to_string(number) + " does not exist; the file has " +
                              std::to_string(count));
    }
    const Place scene{&(*scenes->value)[number], &*scenes, nullptr, number};
    ForEach(scene, "nodes",
            [&](const Place& node) { document_.roots.push_back(ToUint(node).value_or(0)); });
  }

  void FindOrphans() {
    std::vector<bool> is_child(document_.nodes.size());
    for (const std::uint64_t node : document_.links) {
      if (node < is_child.size()) is_child[node] = true;
    }
    for (std::size_t node = 0; node < is_child.size(); ++node) {
      if (!is_child[node]) document_.roots.push_back(node);
    }
  }

  const std::vector<std::string_view>& uris_;
  CancelPoll* poll_;
  GltfDocument document_;
  std::optional<Error> error_;
};

}  // namespace

Error AtPointer(std::string_view pointer, std::string_view cause) {
  return Error{ErrorCode::kInvalidMesh, pointer.empty()
                                            ? std::string(cause)
                                            : std::string(pointer) + ": " + std::string(cause)};
}

Result<GltfDocument> ReadGltfDocument(std::string_view text, std::uint64_t first_byte,
                                      CancelPoll* poll,
                                      const std::function<Status(std::uint64_t)>& on_bytes) {
  const Result<GltfJson> parsed = ParseGltfJson(text, first_byte, poll, on_bytes);
  if (!parsed.ok()) return parsed.error();
  return DocumentReader(parsed->uris, poll).Read(parsed->json);
}

}  // namespace kdray::core
