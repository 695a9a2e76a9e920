// SPDX-License-Identifier: Apache-2.0
#include "server/pages/viewer_files.h"

#include <utility>
#include <vector>

#include "core/base/hash.h"
#include "server/pages/embedded_page.h"

namespace kdray::server {
namespace {

std::string_view ContentType(std::string_view name) {
  if (name.ends_with(".html")) return "text/html; charset=utf-8";
  if (name.ends_with(".css")) return "text/css; charset=utf-8";
  if (name.ends_with(".js")) return "text/javascript; charset=utf-8";
  if (name.ends_with(".svg")) return "image/svg+xml";
  return "application/octet-stream";
}

std::vector<ViewerFile> MakeFiles() {
  std::vector<ViewerFile> files;
  for (const auto& [name, bytes] : kEmbeddedPage) {
    ViewerFile file;
    file.path = "/";
    if (name != "index.html") file.path += name;
    file.content_type = ContentType(name);
    file.bytes = bytes;
    file.etag = "\"";
    file.etag += core::HashBytes(std::as_bytes(std::span(bytes))).ToHex().substr(0, 32);
    file.etag += '"';
    files.push_back(std::move(file));
  }
  return files;
}

}  // namespace

std::span<const ViewerFile> ViewerFiles() {
  static const std::vector<ViewerFile> files = MakeFiles();
  return files;
}

}  // namespace kdray::server
