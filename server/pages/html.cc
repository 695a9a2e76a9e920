// SPDX-License-Identifier: Apache-2.0
#include "server/pages/html.h"

#include "server/pages/embedded_page.h"

namespace kdray::server {
namespace {

/// Inside the page, because a page with a token cannot load a style sheet that needs the token too.
std::string_view Style() {
  for (const auto& [name, bytes] : kEmbeddedPage) {
    if (name == "text.css") return bytes;
  }
  return {};
}

}  // namespace

std::string EscapeHtml(std::string_view text) {
  std::string escaped;
  escaped.reserve(text.size());
  for (const char c : text) {
    switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      case '\'':
        escaped += "&#39;";
        break;
      default:
        escaped += c;
    }
  }
  return escaped;
}

std::string TextPage(std::string_view title, std::string_view body) {
  std::string page =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width\">\n<title>";
  page += EscapeHtml(title);
  page += "</title>\n<style>";
  page += Style();
  page += "</style>\n</head>\n<body>\n";
  page += body;
  page += "</body>\n</html>\n";
  return page;
}

}  // namespace kdray::server
