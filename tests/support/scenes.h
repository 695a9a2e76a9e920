// SPDX-License-Identifier: Apache-2.0
// Scenes for tests: a mesh and one tree over it.
#pragma once

#include <memory>
#include <stdexcept>
#include <utility>

#include "core/geometry/triangle_mesh.h"
#include "core/scene/scene.h"

namespace kdray::test {

/// Throws std::runtime_error if core rejects the mesh.
inline core::Scene MakeScene(const core::MeshData& data,
                             core::BuildKind kind = core::BuildKind::kKdSah) {
  core::Result<core::TriangleMesh> mesh = core::TriangleMesh::Create(data);
  if (!mesh.ok()) throw std::runtime_error(mesh.error().message);
  core::Scene scene;
  scene.mesh = std::make_shared<const core::TriangleMesh>(*std::move(mesh));
  core::Result<core::Tree> tree = core::BuildTree(*scene.mesh, kind);
  if (!tree.ok()) throw std::runtime_error(tree.error().message);
  scene.tree = std::make_shared<const core::Tree>(*std::move(tree));
  return scene;
}

}  // namespace kdray::test
