// Plain HTML pages of text: the frame and the escaping.
#pragma once

#include <string>
#include <string_view>

namespace kdray::server {

/// Text for an element or a quoted attribute.
std::string EscapeHtml(std::string_view text);

/// A whole document around `body`, which is HTML already. Needs nothing from elsewhere.
std::string TextPage(std::string_view title, std::string_view body);

}  // namespace kdray::server
