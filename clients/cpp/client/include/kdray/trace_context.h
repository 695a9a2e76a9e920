// SPDX-License-Identifier: Apache-2.0
// The trace that requests belong to (W3C Trace Context), which the caller's tracing began.
#pragma once

#include <string_view>

namespace kdray::client {

/// Whether a text is a `traceparent` of version 00, such as
/// 00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01, and has no id of zeros.
bool IsTraceparent(std::string_view text);

}  // namespace kdray::client
