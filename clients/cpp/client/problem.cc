#include "clients/cpp/client/problem.h"

#include <array>
#include <charconv>
#include <nlohmann/json.hpp>

namespace kdray::client {
namespace {

using Json = nlohmann::json;

std::string StringField(const Json& document, const char* name) {
  const auto field = document.find(name);
  return field != document.end() && field->is_string() ? field->get<std::string>() : std::string();
}

std::optional<double> NumberField(const Json& document, const char* name) {
  const auto field = document.find(name);
  if (field == document.end() || !field->is_number()) return std::nullopt;
  return field->get<double>();
}

std::string NumberText(double number) {
  std::array<char, 32> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), number).ptr};
}

}  // namespace

Problem ParseProblem(int status, std::string_view body, std::string_view request_id) {
  Problem problem;
  problem.status = status;
  problem.request_id = request_id;
  const Json document = Json::parse(body, nullptr, /*allow_exceptions=*/false);
  if (!document.is_object() || StringField(document, "code").empty()) {
    problem.detail = "the server answered HTTP " + std::to_string(status) +
                     " without saying why (is it a kdray server, or a proxy before it?)";
    return problem;
  }
  problem.code = StringField(document, "code");
  problem.detail = StringField(document, "detail");
  if (problem.detail.empty()) problem.detail = StringField(document, "title");
  if (const auto id = StringField(document, "request_id"); !id.empty()) problem.request_id = id;
  if (auto name = StringField(document, "parameter"); !name.empty())
    problem.parameter = std::move(name);
  problem.limit = NumberField(document, "limit");
  problem.actual = NumberField(document, "actual");
  if (const auto line = document.find("line"); line != document.end() && line->is_number_unsigned())
    problem.line = line->get<std::uint64_t>();
  return problem;
}

std::string FormatProblem(const Problem& problem) {
  std::string text = problem.code.empty() ? problem.detail : problem.code + ": " + problem.detail;
  text += "\n  HTTP " + std::to_string(problem.status);
  if (problem.line) text += ", line " + std::to_string(*problem.line);
  if (problem.parameter) text += ", parameter " + *problem.parameter;
  if (problem.limit) text += ", limit " + NumberText(*problem.limit);
  if (problem.actual) text += ", sent " + NumberText(*problem.actual);
  if (!problem.request_id.empty()) text += ", request " + problem.request_id;
  return Printable(text);
}

std::string Printable(std::string_view text) {
  std::string out(text);
  for (char& c : out) {
    const auto byte = static_cast<unsigned char>(c);
    if ((byte < 0x20 && c != '\n') || byte == 0x7f) c = '?';
  }
  return out;
}

}  // namespace kdray::client
