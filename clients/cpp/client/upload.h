// A mesh file becomes a tree on the server, with as little sent as can be.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "clients/cpp/client/client.h"

namespace kdray::client {

/// Told what goes on; every member may be empty.
struct UploadWatcher {
  SendProgress on_sent;                           ///< bytes of the file sent so far
  std::function<void(double progress)> on_build;  ///< 0..1
};

struct UploadResult {
  Tree tree;               ///< ready
  bool was_ready = false;  ///< the server had this very tree; nothing was sent or built
  bool was_sent = false;   ///< the mesh bytes went over the wire
};

/// Asks for the tree by its id (the digest is computed here), then for another build of a mesh that
/// the server may have, and only then sends the bytes; afterwards waits until the tree is built.
/// Throws as Client does, with Refusal for a mesh that the server cannot build, and LocalFileError
/// when the file changed on the way.
UploadResult UploadMesh(Client& client, const LocalFile& mesh, const std::string& build,
                        const UploadWatcher& watcher);

}  // namespace kdray::client
