// SPDX-License-Identifier: Apache-2.0
#include "kdray/upload.h"

#include <chrono>
#include <thread>

#include "kdray/error.h"

namespace kdray::client {
namespace {

constexpr int kFirstWaitMs = 100;  // small meshes are built within it, without a flashing bar
constexpr int kPollWaitMs = 200;   // the server answers earlier if the tree is ready

// The tree if it is known and its build has not failed. A failed build answers its problem for a
// while; an upload tries again and gives the current problem.
std::optional<Tree> FindUsable(Client& client, const std::string& id) {
  try {
    return client.FindTree(id);
  } catch (const Refusal& refusal) {
    if (refusal.problem.status == 401) throw;
    return std::nullopt;
  }
}

// A server that rejects an upload early may close the connection before the client has read the
// reason. So the limit is checked first.
void CheckSize(Client& client, const Payload& mesh) {
  const auto limit = client.ServiceInfo()["limits"]["max_upload_bytes"].Count();
  if (!limit || mesh.size() <= *limit) return;
  throw Refusal(
      {.status = 413,
       .code = "mesh_too_large",
       .detail = mesh.name() + " has more bytes than this server accepts; nothing was sent",
       .request_id = {},
       .limit = static_cast<double>(*limit),
       .actual = static_cast<double>(mesh.size())});
}

Tree WaitUntilReady(Client& client, Tree tree, const UploadWatcher& watcher) {
  const bool is_new = tree.is_new;
  while (!tree.ready) {
    if (watcher.on_build) watcher.on_build(tree.progress);
    const auto asked = std::chrono::steady_clock::now();
    tree = client.GetTree(tree.id, kPollWaitMs);
    // Avoids a tight loop with a server that does not wait.
    if (!tree.ready)
      std::this_thread::sleep_until(asked + std::chrono::milliseconds(kPollWaitMs / 2));
  }
  if (watcher.on_build) watcher.on_build(1);
  tree.is_new = is_new;
  return tree;
}

}  // namespace

UploadResult UploadMesh(Client& client, const Payload& mesh, const std::string& build,
                        const UploadWatcher& watcher) {
  const std::string sha256 = mesh.Sha256(watcher.on_hashed);
  const std::string id = TreeIdOf(sha256, build);
  UploadResult result;

  std::optional<Tree> tree = FindUsable(client, id);
  if (tree && tree->ready) {
    result.was_ready = true;
    result.tree = *std::move(tree);
    return result;
  }
  if (!tree) tree = client.CreateTreeOfStoredMesh(sha256, build, kFirstWaitMs);
  if (!tree) {
    CheckSize(client, mesh);
    tree = client.CreateTree(mesh, build, kFirstWaitMs, watcher.on_sent, sha256);
    result.was_sent = true;
  }
  if (tree->id != id)
    throw LocalFileError(mesh.name() + ": changed while it was sent; the server now has tree " +
                         tree->id);
  result.tree = WaitUntilReady(client, *std::move(tree), watcher);
  return result;
}

}  // namespace kdray::client
