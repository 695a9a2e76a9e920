// SPDX-License-Identifier: Apache-2.0
#include "server/plan.h"

#include "api/json_text.h"
#include "core/accel/build_kind.h"
#include "core/geometry/power_of_two.h"
#include "core/intersect/precision.h"

namespace kdray::server {
namespace {

std::string DescribeStructure(const core::TreeRecord& record, const core::MeshFacts& mesh,
                              core::BuildKind build) {
  const core::BuildKindWords words = core::WordsFor(build);
  std::string text(words.structure);
  text += " (";
  text += words.name;
  if (record.id.build) {
    text += ", as asked)";
  } else if (build == core::BuildKind::kBox) {
    text += "): " + std::to_string(mesh.triangles) + " triangles need no tree";
  } else {
    text += "), the choice of auto for " + std::to_string(mesh.triangles) + " triangles";
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
  const core::BuildKind build =
      record.id.build.value_or(core::AutoBuildKind(static_cast<std::size_t>(mesh.triangles)));
  return DescribeStructure(record, mesh, build) + DescribeVertices(mesh) + DescribePrecision(mesh) +
         DescribeClosedness(mesh.health);
}

}  // namespace kdray::server
