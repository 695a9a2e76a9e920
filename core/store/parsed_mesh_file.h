// SPDX-License-Identifier: Apache-2.0
// A parsed mesh on disk, so a restart reads numbers instead of parsing text. Derived from the mesh
// file's bytes: if damaged or lost, it is made again.
#pragma once

#include <memory>

#include "core/base/cancel.h"
#include "core/base/hash.h"
#include "core/base/result.h"
#include "core/catalog/parsed_mesh.h"
#include "core/store/blob_store.h"

namespace kdray::core {

/// Writes everything; the result only needs its name (NewBlob::Commit). `mesh` is the hash of the
/// mesh file's bytes. Errors: those of FileSystem, kCancelled, kDeadlineExceeded.
Result<NewBlob> WriteParsedMeshFile(const Sha256Digest& mesh, const ParsedMesh& parsed,
                                    NewBlob blob, const CancelToken& cancel = {});

/// The same mesh, bit for bit. kCorrupt for a file that is damaged, of another version or byte
/// order, or of another mesh; kCancelled, kDeadlineExceeded.
Result<ParsedMesh> ReadParsedMeshFile(const Sha256Digest& mesh, std::unique_ptr<ReadableFile> file,
                                      const CancelToken& cancel = {});

}  // namespace kdray::core
