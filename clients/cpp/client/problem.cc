// SPDX-License-Identifier: Apache-2.0
#include "kdray/problem.h"

#include <array>
#include <charconv>

#include "kdray/document.h"

namespace kdray::client {
namespace {

std::string NumberText(double number) {
  std::array<char, 32> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), number).ptr};
}

}  // namespace

Problem ParseProblem(int status, std::string_view body, std::string_view request_id) {
  Problem problem;
  problem.status = status;
  problem.request_id = request_id;
  const Document document = Document::Parse(body).value_or(Document());
  const auto text = [&](const char* name) { return document[name].Text().value_or(""); };
  problem.code = text("code");
  if (problem.code.empty()) {
    problem.detail = "the server answered HTTP " + std::to_string(status) +
                     " without saying why (is it a kdray server, or a proxy before it?)";
    return problem;
  }
  problem.detail = text("detail");
  if (problem.detail.empty()) problem.detail = text("title");
  if (auto id = text("request_id"); !id.empty()) problem.request_id = std::move(id);
  if (auto name = text("parameter"); !name.empty()) problem.parameter = std::move(name);
  problem.limit = document["limit"].Number();
  problem.actual = document["actual"].Number();
  problem.line = document["line"].Count();
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
