// SPDX-License-Identifier: Apache-2.0
// The server's description of a tree in words. Missing fields are omitted, so descriptions of older
// and newer servers work too.
#pragma once

#include <string>
#include <vector>

#include "kdray/client.h"

namespace kdray::client {

/// One line: "69,451 triangles, kd-sah: 143,851 nodes, built in 312 ms".
std::string SummaryOf(const Document& description);

/// Several lines, name and value: what `kdray show` prints.
std::string DetailsOf(const Document& description);

/// The cells of a row of `kdray list`, in the order of ListHeader().
std::vector<std::string> ListRowOf(const Tree& tree, bool full_id);
std::vector<std::string> ListHeader();

}  // namespace kdray::client
