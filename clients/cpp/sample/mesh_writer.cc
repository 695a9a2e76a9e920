// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/sample/mesh_writer.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdint>

#include "clients/cpp/sample/little_endian.h"

namespace kdray::client {
namespace {

template <class Number>
void AppendNumber(Number number, std::string& out) {
  std::array<char, 32> text;
  const auto end = std::to_chars(text.data(), text.data() + text.size(), number).ptr;
  out.append(text.data(), end);
}

std::string EncodeObj(const SampleMesh& mesh) {
  std::string out;
  for (const Point& p : mesh.vertices) {
    out += 'v';
    for (const double x : p) {
      out += ' ';
      AppendNumber(static_cast<float>(x), out);
    }
    out += '\n';
  }
  for (const Face& face : mesh.triangles) {
    out += 'f';
    for (const std::uint32_t index : face) {
      out += ' ';
      AppendNumber(index + 1, out);  // OBJ counts from one
    }
    out += '\n';
  }
  return out;
}

std::string EncodePly(const SampleMesh& mesh) {
  std::string out = "ply\nformat binary_little_endian 1.0\nelement vertex ";
  AppendNumber(mesh.vertices.size(), out);
  out += "\nproperty float x\nproperty float y\nproperty float z\nelement face ";
  AppendNumber(mesh.triangles.size(), out);
  out += "\nproperty list uchar uint vertex_indices\nend_header\n";
  for (const Point& p : mesh.vertices)
    for (const double x : p) AppendLittleEndian(static_cast<float>(x), out);
  for (const Face& face : mesh.triangles) {
    out += '\3';
    for (const std::uint32_t index : face) AppendLittleEndian(index, out);
  }
  return out;
}

std::string EncodeStl(const SampleMesh& mesh) {
  std::string out(80, '\0');  // the header must not begin with "solid", which means text
  AppendLittleEndian(static_cast<std::uint32_t>(mesh.triangles.size()), out);
  for (const Face& face : mesh.triangles) {
    const Point& a = mesh.vertices[face[0]];
    const Point& b = mesh.vertices[face[1]];
    const Point& c = mesh.vertices[face[2]];
    Point normal;
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3;
      const int v = (axis + 2) % 3;
      normal[axis] = (b[u] - a[u]) * (c[v] - a[v]) - (b[v] - a[v]) * (c[u] - a[u]);
    }
    const double length =
        std::sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    for (const double x : normal)
      AppendLittleEndian(static_cast<float>(length > 0 ? x / length : 0), out);
    for (const Point* corner : {&a, &b, &c})
      for (const double x : *corner) AppendLittleEndian(static_cast<float>(x), out);
    AppendLittleEndian(std::uint16_t{0}, out);  // attribute bytes: none
  }
  return out;
}

}  // namespace

std::optional<MeshFormat> MeshFormatOf(std::string_view file_name) {
  const std::size_t dot = file_name.rfind('.');
  if (dot == std::string_view::npos) return std::nullopt;
  std::string ending(file_name.substr(dot + 1));
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (ending == "obj") return MeshFormat::kObj;
  if (ending == "ply") return MeshFormat::kPly;
  if (ending == "stl") return MeshFormat::kStl;
  return std::nullopt;
}

std::string EncodeMesh(const SampleMesh& mesh, MeshFormat format) {
  switch (format) {
    case MeshFormat::kObj:
      return EncodeObj(mesh);
    case MeshFormat::kPly:
      return EncodePly(mesh);
    case MeshFormat::kStl:
      return EncodeStl(mesh);
  }
  return {};
}

}  // namespace kdray::client
