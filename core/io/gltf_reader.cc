// SPDX-License-Identifier: Apache-2.0
#include "core/io/gltf_reader.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/io/attribute_sink.h"
#include "core/io/gltf_accessors.h"
#include "core/io/gltf_container.h"
#include "core/io/gltf_document.h"
#include "core/io/mesh_error.h"
#include "core/io/parse_text.h"
#include "core/io/vertex_check.h"

namespace kdray::core {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// A node of the scene with a mesh.
struct Instance {
  std::uint64_t node = 0;
  std::uint64_t mesh = 0;
  GltfTransform transform;
};

// A primitive with triangles, checked.
struct Part {
  const GltfPrimitive* primitive = nullptr;
  std::uint64_t number = 0;  // in its mesh
  std::uint64_t vertices = 0;
  std::uint64_t corners = 0;
  std::uint64_t triangles = 0;
  bool has_rest = false;  // corners after the last triangle
};

struct MeshParts {
  bool is_known = false;
  std::vector<Part> parts;
  std::uint64_t vertices = 0;
  std::uint64_t triangles = 0;
};

std::uint64_t TrianglesOf(GltfMode mode, std::uint64_t corners) {
  switch (mode) {
    case GltfMode::kTriangles:
      return corners / 3;
    case GltfMode::kTriangleStrip:
    case GltfMode::kTriangleFan:
      return corners < 3 ? 0 : corners - 2;
    default:
      return 0;
  }
}

// Positions of a triangle's corners in the list of a primitive's corners.
TriangleIndices CornersOf(GltfMode mode, std::uint32_t i) {
  switch (mode) {
    case GltfMode::kTriangleStrip:
      return i % 2 == 0 ? TriangleIndices{i, i + 1, i + 2} : TriangleIndices{i, i + 2, i + 1};
    case GltfMode::kTriangleFan:
      return {0, i + 1, i + 2};
    default:
      return {3 * i, 3 * i + 1, 3 * i + 2};
  }
}

// The matrix of cofactors: normals are transformed by it, up to a positive factor.
GltfTransform NormalTransform(const GltfTransform& transform) {
  GltfTransform cofactors{Cross(transform.y, transform.z),
                          Cross(transform.z, transform.x),
                          Cross(transform.x, transform.y),
                          {}};
  if (Dot(transform.x, cofactors.x) < 0) {
    cofactors.x = -cofactors.x;
    cofactors.y = -cofactors.y;
    cofactors.z = -cofactors.z;
  }
  return cofactors;
}

Vec3d ToVec3(const GltfElement& element) { return {element[0], element[1], element[2]}; }

// Three passes: the scene's nodes; the primitives of its meshes, checked and counted; their
// triangles.
class SceneReader {
 public:
  SceneReader(const GltfDocument& document, const GltfContainer& container, std::size_t file_bytes,
              std::uint64_t document_bytes, const MeshReadOptions& options)
      : document_(document),
        options_(options),
        sink_(options.attributes),
        cancel_(options.cancel),
        accessors_(document, container.binary, file_bytes, &cancel_),
        meshes_(document.meshes.size()) {
    counts_.other_bytes = document_bytes;
    data_.format = container.is_glb ? MeshFormat::kGlb : MeshFormat::kGltf;
    data_.single_precision = true;  // the widest type of a position
  }

  Result<MeshData> Read() {
    if (sink_ != nullptr) sink_->Begin();
    for (const auto pass : {&SceneReader::FindInstances, &SceneReader::Count,
                            &SceneReader::ReadInstances, &SceneReader::CheckVertices}) {
      if (Status status = (this->*pass)(); !status.ok()) return std::move(status).error();
    }
    return std::move(data_);
  }

 private:
  static std::string NodePointer(std::uint64_t node) { return "/nodes/" + std::to_string(node); }
  static std::string PartPointer(std::uint64_t mesh, std::uint64_t primitive) {
    return "/meshes/" + std::to_string(mesh) + "/primitives/" + std::to_string(primitive);
  }

  // Depth first, without recursion: a chain of nodes may be long.
  Status FindInstances() {
    struct Visit {
      std::uint64_t node;
      GltfTransform parent;
    };
    std::vector<bool> is_reached(document_.nodes.size());
    std::vector<Visit> stack;
    const auto push = [&](std::uint64_t node, const GltfTransform& parent,
                          const std::string& from) -> Status {
      if (node >= document_.nodes.size()) {
        return AtPointer(from, "node " + std::to_string(node) + " does not exist; the file has " +
                                   std::to_string(document_.nodes.size()));
      }
      if (is_reached[node]) {
        return AtPointer(NodePointer(node),
                         "the scene reaches this node twice; a node has one parent, and is not its "
                         "own descendant");
      }
      is_reached[node] = true;
      stack.push_back({node, parent});
      return {};
    };
    for (auto root = document_.roots.rbegin(); root != document_.roots.rend(); ++root) {
      if (cancel_.Spend(64)) return cancel_.ToError();
      if (Status status = push(*root, {}, "/scenes"); !status.ok()) return status;
    }
    while (!stack.empty()) {
      if (cancel_.Spend(256)) return cancel_.ToError();
      const Visit visit = stack.back();
      stack.pop_back();
      const GltfNode& node = document_.nodes[visit.node];
      const GltfTransform transform = visit.parent * node.transform;
      if (node.mesh) instances_.push_back({visit.node, *node.mesh, transform});
      for (std::uint32_t i = node.children.count; i > 0; --i) {
        if (cancel_.Spend(64)) return cancel_.ToError();
        const std::uint64_t child = document_.links[node.children.first + i - 1];
        Status status = push(child, transform, NodePointer(visit.node) + "/children");
        if (!status.ok()) return status;
      }
    }
    return {};
  }

  Status Count() {
    std::uint64_t groups = 0;
    for (const Instance& instance : instances_) {
      if (cancel_.Spend(64)) return cancel_.ToError();
      if (Status status = CountMesh(instance); !status.ok()) return status;
      const MeshParts& mesh = meshes_[instance.mesh];
      counts_.vertices += mesh.vertices;
      counts_.triangles += mesh.triangles;
      groups += mesh.parts.size();
      if (counts_.vertices > kMaxVertices || counts_.triangles > kMaxTriangles) {
        return Error{ErrorCode::kMeshTooLarge,
                     "the scene has more than " + std::to_string(kMaxTriangles) +
                         " triangles or more than " + std::to_string(kMaxVertices) + " vertices"};
      }
    }
    if (counts_.triangles == 0) {
      return Error{ErrorCode::kEmptyMesh, "the scene of the glTF file has no triangle"};
    }
    counts_.other_bytes += accessors_.buffers().DecodedBytes() +
                           most_corners_ * sizeof(std::uint32_t) +
                           2 * instances_.size() * sizeof(Instance);
    if (sink_ != nullptr) {
      const auto values = [&](bool has) { return has ? counts_.vertices : 0; };
      planned_.triangles = counts_.triangles;
      planned_.uvs = values(has_uv_);
      planned_.normals = values(has_normal_);
      planned_.vertex_colors = values(has_color_);
      planned_.has_vertex_values = has_uv_ || has_normal_ || has_color_;
      planned_.groups = groups;
      counts_.other_bytes += sink_->PlannedBytes(planned_);
      if (planned_.has_vertex_values) counts_.other_bytes += most_vertices_ * sizeof(Vec3d);
    }
    return options_.Counted(counts_);
  }

  // Checks a mesh at its first use.
  Status CountMesh(const Instance& instance) {
    if (instance.mesh >= document_.meshes.size()) {
      return AtPointer(NodePointer(instance.node), "mesh " + std::to_string(instance.mesh) +
                                                       " does not exist; the file has " +
                                                       std::to_string(document_.meshes.size()));
    }
    MeshParts& mesh = meshes_[instance.mesh];
    if (std::exchange(mesh.is_known, true)) return {};
    const GltfRange range = document_.meshes[instance.mesh].primitives;
    for (std::uint32_t i = 0; i < range.count; ++i) {
      if (cancel_.Spend(1024)) return cancel_.ToError();
      const GltfPrimitive& primitive = document_.primitives[range.first + i];
      if (primitive.mode < GltfMode::kTriangles) continue;
      if (!primitive.position) {
        return AtPointer(PartPointer(instance.mesh, i), "the attribute POSITION is missing");
      }
      Status status = accessors_.Check(*primitive.position, GltfUse::kPosition);
      if (status.ok() && primitive.indices) {
        status = accessors_.Check(*primitive.indices, GltfUse::kIndices);
      }
      if (!status.ok()) return status;
      Part part{&primitive, i, accessors_.CountOf(*primitive.position)};
      part.corners = primitive.indices ? accessors_.CountOf(*primitive.indices) : part.vertices;
      part.triangles = TrianglesOf(primitive.mode, part.corners);
      part.has_rest = primitive.mode == GltfMode::kTriangles && part.corners % 3 != 0;
      // Before sums can overflow.
      if (part.vertices > kMaxVertices || part.triangles > kMaxTriangles) {
        return Error{ErrorCode::kMeshTooLarge,
                     PartPointer(instance.mesh, i) + ": " + std::to_string(part.vertices) +
                         " vertices and " + std::to_string(part.triangles) +
                         " triangles; at most " + std::to_string(kMaxVertices) + " and " +
                         std::to_string(kMaxTriangles) + " are allowed"};
      }
      if (part.triangles == 0) continue;
      if (primitive.indices) most_corners_ = std::max(most_corners_, part.corners);
      has_uv_ = has_uv_ || Finds(primitive.uv, AttributeKind::kUv, GltfUse::kUv, part);
      has_normal_ = has_normal_ ||
                    Finds(primitive.normal, AttributeKind::kShadingNormal, GltfUse::kNormal, part);
      has_color_ =
          has_color_ || Finds(primitive.color, AttributeKind::kColor, GltfUse::kColor, part);
      most_vertices_ = std::max(most_vertices_, part.vertices);
      mesh.vertices += part.vertices;
      mesh.triangles += part.triangles;
      mesh.parts.push_back(part);
    }
    return {};
  }

  // Whether the sink wants a kind that the primitive has, valid and for every vertex.
  bool Finds(const std::optional<std::uint64_t>& accessor, AttributeKind kind, GltfUse use,
             const Part& part) {
    return sink_ != nullptr && sink_->Wants(kind) && accessor &&
           accessors_.Check(*accessor, use).ok() && accessors_.CountOf(*accessor) >= part.vertices;
  }

  Status ReadInstances() {
    if (Status status = accessors_.buffers().Decode(); !status.ok()) return status;
    data_.vertices.reserve(counts_.vertices);
    data_.triangles.reserve(counts_.triangles);
    corners_.reserve(most_corners_);
    if (sink_ != nullptr) sink_->Plan(planned_);
    if (has_color_) sink_->SetLinearColors();
    for (const Instance& instance : instances_) {
      for (const Part& part : meshes_[instance.mesh].parts) {
        if (cancel_.Spend(256)) return cancel_.ToError();
        if (Status status = ReadPart(instance, part); !status.ok()) return status;
      }
    }
    return {};
  }

  Status ReadPart(const Instance& instance, const Part& part) {
    const std::size_t first = data_.vertices.size();
    data_.vertices.resize(first + part.vertices);
    const bool all = accessors_.ForEach(*part.primitive->position,
                                        [&](std::size_t i, const GltfElement& element) {
                                          const Vec3d vertex = instance.transform(ToVec3(element));
                                          data_.vertices[first + i] = vertex;
                                          all_valid_ = all_valid_ && IsValidVertex(vertex);
                                        });
    if (!all) return WhyStopped();
    if (sink_ != nullptr) ReadAttributesOf(instance, part);
    if (Status status = ReadCorners(instance, part); !status.ok()) return status;
    const bool is_mirrored =
        Dot(instance.transform.x, Cross(instance.transform.y, instance.transform.z)) < 0;
    const auto corner = [&](std::uint32_t place) {
      const std::uint32_t vertex = part.primitive->indices ? corners_[place] : place;
      return static_cast<std::uint32_t>(first + vertex);
    };
    PolledLoop(part.triangles, 32, &cancel_, [&](std::size_t i) {
      const auto [a, b, c] = CornersOf(part.primitive->mode, static_cast<std::uint32_t>(i));
      data_.triangles.push_back(
          {corner(a), corner(is_mirrored ? c : b), corner(is_mirrored ? b : c)});
      if (sink_ != nullptr) sink_->AddTriangle({.vertices = data_.triangles.back()});
    });
    data_.dropped += part.has_rest ? 1 : 0;
    return cancel_.ToStatus();
  }

  Status WhyStopped() const { return cancel_.stopped() ? cancel_.ToError() : accessors_.error(); }

  Status ReadCorners(const Instance& instance, const Part& part) {
    if (!part.primitive->indices) return {};
    corners_.resize(part.corners);
    std::optional<std::size_t> wrong;
    const bool all = accessors_.ForEach(*part.primitive->indices,
                                        [&](std::size_t i, const GltfElement& element) {
                                          corners_[i] = static_cast<std::uint32_t>(element[0]);
                                        });
    if (!all) return WhyStopped();
    PolledLoop(corners_.size(), 2, &cancel_, [&](std::size_t i) {
      if (!wrong && corners_[i] >= part.vertices) wrong = i;
    });
    if (!wrong || cancel_.stopped()) return cancel_.ToStatus();
    return AtPointer(PartPointer(instance.mesh, part.number) + "/indices",
                     "index " + std::to_string(*wrong) + " is vertex " +
                         std::to_string(corners_[*wrong]) + "; the primitive has " +
                         std::to_string(part.vertices) + ", counted from 0");
  }

  // A value for each vertex; NaN where the primitive has none. Incomplete when the poll has
  // stopped.
  void ReadAttributesOf(const Instance& instance, const Part& part) {
    const GltfPrimitive& primitive = *part.primitive;
    const auto read = [&](bool has_any, const std::optional<std::uint64_t>& accessor,
                          AttributeKind kind, GltfUse use, const auto& add) {
      if (!has_any) return;
      values_.assign(part.vertices, Vec3d{kNan, kNan, kNan});
      if (Finds(accessor, kind, use, part)) {
        (void)accessors_.ForEach(*accessor, [&](std::size_t i, const GltfElement& element) {
          if (i < part.vertices) values_[i] = ToVec3(element);
        });
      }
      PolledLoop(values_.size(), 32, &cancel_, [&](std::size_t i) { add(values_[i]); });
    };
    read(has_uv_, primitive.uv, AttributeKind::kUv, GltfUse::kUv,
         [&](const Vec3d& uv) { sink_->AddUv(uv.x, uv.y); });
    const GltfTransform turn = NormalTransform(instance.transform);
    read(has_normal_, primitive.normal, AttributeKind::kShadingNormal, GltfUse::kNormal,
         [&](const Vec3d& normal) { sink_->AddNormal(turn.Turned(normal)); });
    read(has_color_, primitive.color, AttributeKind::kColor, GltfUse::kColor,
         [&](const Vec3d& color) { sink_->AddVertexColor(color); });
    group_name_ = NameOf(instance, part);
    sink_->StartGroup(group_name_);
  }

  // That of the node, else of its mesh, else the node's number; and which of several primitives.
  std::string NameOf(const Instance& instance, const Part& part) const {
    const GltfMesh& mesh = document_.meshes[instance.mesh];
    const std::string& node_name = document_.nodes[instance.node].name;
    std::string name = !node_name.empty()   ? node_name
                       : !mesh.name.empty() ? mesh.name
                                            : "node " + std::to_string(instance.node);
    if (mesh.primitives.count > 1) name += "/" + std::to_string(part.number);
    return name;
  }

  // A sparse value may replace an invalid one, so the flag alone decides nothing.
  Status CheckVertices() {
    if (all_valid_) return {};
    const Result<std::optional<std::size_t>> invalid = FindInvalidVertex(data_, options_);
    if (!invalid.ok()) return invalid.error();
    if (!*invalid) return {};
    std::size_t vertex = **invalid;
    const Vec3d& position = data_.vertices[vertex];
    for (const Instance& instance : instances_) {
      for (const Part& part : meshes_[instance.mesh].parts) {
        if (vertex >= part.vertices) {
          vertex -= part.vertices;
          continue;
        }
        const int axis = InvalidAxis(position);
        return AtPointer(PartPointer(instance.mesh, part.number),
                         std::string(1, "xyz"[axis]) + " of vertex " + std::to_string(vertex) +
                             " (counted from 0), as node " + std::to_string(instance.node) +
                             " places it: " + WhyNotCoordinate(position[axis]));
      }
    }
    return Error{ErrorCode::kInvalidMesh, WhyNotVertex(data_, **invalid)};
  }

  const GltfDocument& document_;
  const MeshReadOptions& options_;
  AttributeSink* sink_;  // or null
  CancelPoll cancel_;
  GltfAccessors accessors_;
  std::vector<Instance> instances_;
  std::vector<MeshParts> meshes_;
  MeshCounts counts_;
  MeshData data_;
  std::uint64_t most_corners_ = 0;   // of a primitive with indices
  std::uint64_t most_vertices_ = 0;  // of a primitive
  std::vector<std::uint32_t> corners_;
  bool all_valid_ = true;  // the coordinates of all vertices
  bool has_uv_ = false;    // a primitive of the scene, and the sink wants it
  bool has_normal_ = false;
  bool has_color_ = false;
  AttributeSink::Counts planned_;
  std::vector<Vec3d> values_;
  std::string group_name_;
};

}  // namespace

Result<MeshData> ReadGltf(std::span<const std::byte> bytes, const MeshReadOptions& options) {
  CancelPoll poll(options.cancel);
  const Result<GltfContainer> container = OpenGltf(bytes, &poll);
  if (!container.ok()) return container.error();
  std::uint64_t document_bytes = 0;
  const Result<GltfDocument> document =
      ReadGltfDocument(container->json, container->json_begin, &poll, [&](std::uint64_t needed) {
        document_bytes = needed;
        return options.Counted({.other_bytes = needed});
      });
  if (!document.ok()) return document.error();
  return SceneReader(*document, *container, bytes.size(), document_bytes, options).Read();
}

}  // namespace kdray::core
