// SPDX-License-Identifier: Apache-2.0
// The cost by which trees over one mesh are compared (core/accel/auto_choice.h).
#pragma once

#include "core/accel/tree.h"
#include "core/base/cancel.h"
#include "core/base/result.h"

namespace kdray::core {

/// The nodes and blocks of the wide tree that a random line through its bounds is expected to meet,
/// by the areas of their boxes (MacDonald and Booth 1990); a node counts as much as a block. 0 for
/// an empty tree. It ranks trees over one mesh by the time of a ray. Depends on the tree alone: the
/// same on every machine. O(nodes + blocks). Errors: kCancelled, kDeadlineExceeded.
Result<double> ExpectedCost(const Tree& tree, const CancelToken& cancel = {});

}  // namespace kdray::core
