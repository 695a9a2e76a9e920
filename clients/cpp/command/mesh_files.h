// SPDX-License-Identifier: Apache-2.0
// The mesh files that arguments of `kdray upload` name.
#pragma once

#include <string>
#include <vector>

namespace kdray::client {

/// Endings of the mesh formats, without dots.
extern const std::vector<std::string> kMeshEndings;

/// A file stands for itself, whatever its ending (the server looks at the content), and `-` for
/// standard input; a directory for all mesh files below it, sorted; any other text is a pattern as
/// the shell has them (`scans/*.ply`). Throws LocalFileError if a directory or pattern has no mesh
/// file, or a directory cannot be read.
std::vector<std::string> ExpandMeshFiles(const std::vector<std::string>& arguments);

}  // namespace kdray::client
