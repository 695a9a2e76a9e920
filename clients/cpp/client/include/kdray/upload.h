// SPDX-License-Identifier: Apache-2.0
// Creates the tree of a mesh on the server, sending as little as possible.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "kdray/client.h"

namespace kdray::client {

/// Called with the progress; every member may be empty.
struct UploadWatcher {
  ByteProgress on_hashed;                         ///< bytes hashed so far, before anything is sent
  ByteProgress on_sent;                           ///< bytes sent so far
  std::function<void(double progress)> on_build;  ///< 0..1
};

struct UploadResult {
  Tree tree;               ///< ready
  bool was_ready = false;  ///< the server had this tree; nothing was sent or built
  bool was_sent = false;   ///< the mesh bytes were sent
};

/// Requests the tree by its id (the hash is computed here), then another build of the stored mesh;
/// sends the bytes only if the server does not have them. Then waits until the tree is built.
/// Throws as Client does, Refusal for a mesh that the server cannot build, and LocalFileError if
/// the file changed meanwhile.
UploadResult UploadMesh(Client& client, const Payload& mesh, const std::string& build = "auto",
                        const UploadWatcher& watcher = {});

}  // namespace kdray::client
