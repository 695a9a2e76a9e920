// SPDX-License-Identifier: Apache-2.0
#include "server/plan.h"

#include <charconv>
#include <cstddef>
#include <optional>
#include <system_error>

#include "api/json_text.h"
#include "core/accel/auto_choice.h"
#include "core/accel/build_kind.h"
#include "core/geometry/power_of_two.h"
#include "core/intersect/precision.h"

namespace kdray::server {
namespace {

// With one digit after the point.
std::string Tenths(double value) {
  char text[32];
  const auto [end, error] =
      std::to_chars(text, text + sizeof text, value, std::chars_format::fixed, 1);
  return error == std::errc() ? std::string(text, end) : api::NumberText(value);
}

// Why auto chose the build of a mesh that needs a tree.
std::string DescribeChoice(const core::AutoChoice& choice, core::BuildKind build) {
  if (!choice.costs) {
    return "the boxes of its triangles overlap so little (a random line meets " +
           Tenths(choice.overlap) + " of them) that kd-sah was not tried";
  }
  const std::string bvh = Tenths(choice.costs->bvh), kd_sah = Tenths(choice.costs->kd_sah);
  std::string text = "a random line is expected to meet ";
  text += build == core::BuildKind::kKdSah
              ? kd_sah + " of its nodes and blocks of triangles, and " + bvh + " with bvh"
              : bvh + " of its nodes and blocks of triangles, and " + kd_sah + " with kd-sah";
  return text + "; each takes up to a third longer in kd-sah";
}

std::string DescribeStructure(const core::TreeRecord& record, const core::MeshFacts& mesh) {
  const std::string triangles = std::to_string(mesh.triangles) + " triangles";
  std::optional<core::BuildKind> build = record.id.build;
  if (!build && record.tree) build = record.tree->build;
  if (!build && core::NeedsNoTree(static_cast<std::size_t>(mesh.triangles))) {
    build = core::BuildKind::kBox;
  }
  if (!build) return "Build auto means bvh or kd-sah for " + triangles + ": it is being chosen. ";

  const core::BuildKindWords words = core::WordsFor(*build);
  std::string text(words.structure);
  text += " (";
  text += words.name;
  if (record.id.build) {
    text += ", as asked)";
  } else if (*build == core::BuildKind::kBox) {
    text += "): " + triangles + " need no tree";
  } else {
    text += "), the choice of auto for " + triangles;
    text += record.choice ? ": " + DescribeChoice(*record.choice, *build) : " in an older version";
  }
  return text + ". ";
}

std::string DescribeVertices(const core::MeshFacts& mesh) {
  std::string text = mesh.double_vertices
                         ? "Vertices are kept as doubles (24 bytes), because floats cannot hold "
                           "all of them exactly"
                         : "Vertices are kept as floats (12 bytes), which hold all of them exactly";
  const core::Vec3d& o = mesh.frame.origin;
  text += ", in units of 2^" + std::to_string(mesh.frame.exponent);
  if (o != core::Vec3d{}) {
    text += " around the local origin (" + api::NumberText(o.x) + ", " + api::NumberText(o.y) +
            ", " + api::NumberText(o.z) + ")";
  }
  text += ". ";
  if (mesh.wider_than_declared) {
    text +=
        "The file calls its coordinates floats, but writes numbers with more digits than floats "
        "have; they are read as doubles. ";
  }
  if (mesh.rounded_vertices) {
    // Half of 2^-1074 local units, of which double may hold only 0: an exponent says it.
    text += "Some coordinates are so small beside the largest that they are rounded, by up to 2^" +
            std::to_string(mesh.frame.exponent - 1075) + ": exact answers for the rounded ones. ";
  }
  return text;
}

std::string DescribePrecision(const core::MeshFacts& mesh) {
  const core::Precision precision = core::AutoPrecision(mesh.double_vertices, mesh.shortest_edge);
  if (precision == core::Precision::kWatertight) {
    return "Precision auto means watertight: single precision resolves every edge of this mesh. ";
  }
  std::string text = "Precision auto means ";
  text += core::Name(precision);
  text += mesh.double_vertices ? ": the vertices need it. "
                               : ": the shortest edges are too short for single precision. ";
  if (mesh.double_vertices) {
    // Local coordinates lie in [-1, 1], where a float is off by 2^-25 at most.
    text += "With watertight and fast, rays are answered on vertices rounded to float, by up to " +
            api::NumberText(core::ScaleByPowerOfTwo(0x1p-25, mesh.frame.exponent)) +
            " on each axis. ";
  }
  return text;
}

std::string DescribeClosedness(const core::MeshHealth& health) {
  if (health.closed) {
    return "The mesh is closed, so rays from inside always hit it, except in fast.";
  }
  std::string text = "The mesh is not closed";
  if (health.open_edges != 0 || health.non_manifold_edges != 0) {
    text += " (" + std::to_string(health.open_edges) + " open and " +
            std::to_string(health.non_manifold_edges) + " non-manifold edges)";
  }
  return text + ", so watertightness is not guaranteed.";
}

}  // namespace

std::string DescribePlan(const core::TreeRecord& record) {
  if (!record.mesh) return "The mesh is being read.";
  const core::MeshFacts& mesh = *record.mesh;
  return DescribeStructure(record, mesh) + DescribeVertices(mesh) + DescribePrecision(mesh) +
         DescribeClosedness(mesh.health);
}

}  // namespace kdray::server
