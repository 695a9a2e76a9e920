#include "server/pages/viewer_page.h"

namespace kdray::server {

std::string_view ViewerPage() {
  return "<!DOCTYPE html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<title>kdray</title>\n"
         "<h1>kdray</h1>\n<p><a href=\"/docs\">The contract</a></p>\n</html>\n";
}

std::string_view ViewerPagePolicy() {
  return "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
}

}  // namespace kdray::server
