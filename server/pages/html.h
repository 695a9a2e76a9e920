// SPDX-License-Identifier: Apache-2.0
// Simple HTML pages: the frame and the escaping.
#pragma once

#include <string>
#include <string_view>

namespace kdray::server {

/// Text for an element or a quoted attribute.
std::string EscapeHtml(std::string_view text);

/// A complete document around `body`, which must be HTML. Loads no other files.
std::string TextPage(std::string_view title, std::string_view body);

}  // namespace kdray::server
