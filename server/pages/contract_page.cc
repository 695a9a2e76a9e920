#include "server/pages/contract_page.h"

#include <nlohmann/json.hpp>

#include "api/errors.h"
#include "server/pages/html.h"

namespace kdray::server {
namespace {

using Json = nlohmann::ordered_json;

class ContractPage {
 public:
  explicit ContractPage(std::string_view openapi_json) : document_(Json::parse(openapi_json)) {}

  std::string Make() {
    const Json& info = document_.at("info");
    const std::string title = Text(info, "title") + " " + Text(info, "version");
    out_ = "<h1>" + EscapeHtml(title) + "</h1>\n" + Paragraphs(Text(info, "description"));
    out_ += "<p>The same for programs: <a href=\"/openapi.json\">/openapi.json</a></p>\n";
    for (const auto& [path, item] : document_.at("paths").items()) {
      for (const char* method : {"get", "post", "delete"}) {
        if (item.contains(method)) AddOperation(method, path, item, item.at(method));
      }
    }
    AddProblems();
    return TextPage(title, out_);
  }

 private:
  /// Follows a `$ref` inside the document.
  const Json& Resolve(const Json& value) const {
    const auto reference = value.find("$ref");
    if (reference == value.end()) return value;
    return document_.at(Json::json_pointer(reference->get<std::string>().substr(1)));
  }

  static std::string Text(const Json& value, const char* key) {
    const auto found = value.find(key);
    if (found == value.end()) return {};
    return found->is_string() ? found->get<std::string>() : found->dump();
  }

  /// Blank lines part paragraphs; nothing else is marked up.
  static std::string Paragraphs(const std::string& text) {
    std::string html;
    for (std::size_t begin = 0; begin < text.size();) {
      const auto end = std::min(text.find("\n\n", begin), text.size());
      html += "<p>" + EscapeHtml(text.substr(begin, end - begin)) + "</p>\n";
      begin = text.find_first_not_of('\n', end);
      if (begin == std::string::npos) break;
    }
    return html;
  }

  std::string Kind(const Json& schema_or_reference) const {
    const Json& schema = Resolve(schema_or_reference);
    std::string kind;
    if (schema.contains("enum")) {
      for (const Json& value : schema.at("enum")) {
        if (!kind.empty()) kind += ", ";
        kind += value.is_string() ? value.get<std::string>() : value.dump();
      }
    } else {
      kind = Text(schema, "type");
    }
    for (const auto& [key, label] : {std::pair("minimum", "from "), std::pair("maximum", "to "),
                                     std::pair("default", "default ")}) {
      if (schema.contains(key)) kind += std::string("; ") + label + Text(schema, key);
    }
    return kind;
  }

  void AddOperation(const std::string& method, const std::string& path, const Json& item,
                    const Json& operation) {
    std::string name = method;
    for (char& c : name) c = static_cast<char>(c - 'a' + 'A');
    out_ += "<h2><code>" + name + " " + EscapeHtml(path) + "</code></h2>\n";
    out_ += "<p><strong>" + EscapeHtml(Text(operation, "summary")) + "</strong></p>\n";
    out_ += Paragraphs(Text(operation, "description"));

    std::string rows;
    for (const Json* owner : {&item, &operation}) {
      if (owner->contains("parameters")) {
        for (const Json& parameter : owner->at("parameters")) rows += ParameterRow(parameter);
      }
    }
    AddTable({"parameter", "in", "value", "meaning"}, rows);
    AddBody(operation);
    rows.clear();
    if (operation.contains("responses")) {
      for (const auto& [status, response] : operation.at("responses").items()) {
        rows += Row({"<code>" + EscapeHtml(status) + "</code>",
                     EscapeHtml(Text(Resolve(response), "description"))});
      }
    }
    AddTable({"status", "answer"}, rows);
  }

  void AddBody(const Json& operation) {
    const auto found = operation.find("requestBody");
    if (found == operation.end()) return;
    const Json& body = Resolve(*found);
    out_ += "<p>Body: " + EscapeHtml(Text(body, "description"));
    if (body.contains("content")) {
      out_ += " (";
      bool first = true;
      for (const auto& [type, media] : body.at("content").items()) {
        if (!first) out_ += ", ";
        first = false;
        out_ += "<code>" + EscapeHtml(type) + "</code>";
      }
      out_ += ")";
    }
    out_ += "</p>\n";
  }

  std::string ParameterRow(const Json& parameter_or_reference) const {
    const Json& parameter = Resolve(parameter_or_reference);
    std::string kind;
    std::string meaning = Text(parameter, "description");
    if (parameter.contains("schema")) {
      kind = Kind(parameter.at("schema"));
      meaning += " " + Text(Resolve(parameter.at("schema")), "description");
    }
    return Row({"<code>" + EscapeHtml(Text(parameter, "name")) + "</code>",
                EscapeHtml(Text(parameter, "in")), EscapeHtml(kind), EscapeHtml(meaning)});
  }

  void AddProblems() {
    out_ += "<h2 id=\"problems\">Problems</h2>\n";
    std::string rows;
    for (const api::ErrorRow& row : api::ErrorTable()) {
      const std::string name = EscapeHtml(api::Name(row.code));
      rows += Row({std::to_string(row.status),
                   "<a href=\"/problems/" + name + "\"><code>" + name + "</code></a>",
                   EscapeHtml(row.title), EscapeHtml(row.meaning)});
    }
    AddTable({"status", "code", "title", "meaning"}, rows);
  }

  /// Cells are HTML already.
  static std::string Row(std::initializer_list<std::string> cells) {
    std::string row = "<tr>";
    for (const std::string& cell : cells) row += "<td>" + cell + "</td>";
    return row + "</tr>\n";
  }

  void AddTable(std::initializer_list<const char*> head, const std::string& rows) {
    if (rows.empty()) return;
    out_ += "<table>\n<tr>";
    for (const char* name : head) out_ += std::string("<th>") + name + "</th>";
    out_ += "</tr>\n" + rows + "</table>\n";
  }

  const Json document_;
  std::string out_;
};

}  // namespace

std::string MakeContractPage(std::string_view openapi_json) {
  return ContractPage(openapi_json).Make();
}

}  // namespace kdray::server
