// SPDX-License-Identifier: Apache-2.0
// The viewer page at /: the files of clients/page, built into the daemon.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace kdray::server {

struct ViewerFile {
  std::string path;               ///< in URLs: `/` for index.html, `/NAME` for the others
  std::string_view content_type;  ///< by the name's ending
  std::string_view bytes;
  std::string etag;
};

/// All files; their text is static.
std::span<const ViewerFile> ViewerFiles();

/// The Content-Security-Policy of the page: scripts, styles, pictures and requests only from this
/// server.
inline constexpr std::string_view kViewerPolicy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

}  // namespace kdray::server
