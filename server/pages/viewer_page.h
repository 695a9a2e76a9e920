// The page at /: the viewer of clients/page, built into the daemon.
#pragma once

#include <string_view>

namespace kdray::server {

std::string_view ViewerPage();
/// Its Content-Security-Policy.
std::string_view ViewerPagePolicy();

}  // namespace kdray::server
