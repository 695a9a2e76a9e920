// SPDX-License-Identifier: Apache-2.0
#include "server/pages/contract_page.h"

#include "api/errors.h"
#include "server/pages/embedded_contract.h"
#include "server/pages/html.h"

namespace kdray::server {

std::string MakeContractPage() {
  std::string body(kEmbeddedContract[0].second);
  body += "<h2 id=\"problems\"><a href=\"#problems\">Problems</a></h2>\n<table>\n";
  body += "<tr><th>status</th><th>code</th><th>title</th><th>meaning</th></tr>\n";
  for (const api::ErrorRow& row : api::ErrorTable()) {
    const std::string name = EscapeHtml(api::Name(row.code));
    body += "<tr><td data-label=\"status\">" + std::to_string(row.status) +
            "</td><td data-label=\"code\"><a href=\"problems/" + name + "\"><code>" + name +
            "</code></a></td><td data-label=\"title\">" + EscapeHtml(row.title) +
            "</td><td data-label=\"meaning\">" + EscapeHtml(row.meaning) + "</td></tr>\n";
  }
  body += "</table>\n</main>\n";
  return TextPage("The contract of kdray", body);
}

}  // namespace kdray::server
