// SPDX-License-Identifier: Apache-2.0
// The ending of an output file's name decides what is written.
#pragma once

#include <string>
#include <vector>

namespace kdray::client {

/// The ending of `path` in lower case, one of `endings` (without dots). For `-` and for an existing
/// file that is not regular (/dev/null, a pipe) the first of them. Throws UsageError for any other
/// ending; the text names the path and the endings.
std::string TypeOfOutput(const std::string& path, const std::vector<std::string>& endings);

/// Whether `path` ends in `.ending`, in any case.
bool EndsIn(const std::string& path, const std::string& ending);

/// ".png, .npy or .json".
std::string EndingsText(const std::vector<std::string>& endings);

}  // namespace kdray::client
