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

/// All of them; they live as long as the program.
std::span<const ViewerFile> ViewerFiles();

/// The Content-Security-Policy of the page: its own scripts and styles, pictures and requests from
/// this server only.
inline constexpr std::string_view kViewerPolicy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

}  // namespace kdray::server
