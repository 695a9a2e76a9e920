// SPDX-License-Identifier: Apache-2.0
#include "kdray/document.h"

#include <cmath>
#include <nlohmann/json.hpp>

namespace kdray::client {

// ordered_json keeps the order of an answer's members, which is the order that people read.
using Json = nlohmann::ordered_json;

// The library's values have no common name in its versions, so this type stands for them. A Node is
// never made: its pointers are those of Json values.
struct Document::Node {
  static std::shared_ptr<const Node> Of(std::shared_ptr<const Json> value) {
    const auto* const node = reinterpret_cast<const Node*>(value.get());
    return {std::move(value), node};
  }
  const Json& json() const { return *reinterpret_cast<const Json*>(this); }
};

namespace {

constexpr int kIndentation = 2;

const std::shared_ptr<const Json>& Null() {
  static const auto null = std::make_shared<const Json>();
  return null;
}

}  // namespace

Document::Document() : Document(Node::Of(Null())) {}
Document::Document(std::string text)
    : Document(Node::Of(std::make_shared<const Json>(std::move(text)))) {}
Document::Document(double number)
    : Document(Node::Of(std::isfinite(number) ? std::make_shared<const Json>(number) : Null())) {}
Document::Document(std::uint64_t count) : Document(Node::Of(std::make_shared<const Json>(count))) {}
Document::Document(bool flag) : Document(Node::Of(std::make_shared<const Json>(flag))) {}

std::optional<Document> Document::Parse(std::string_view text) {
  Json value = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (value.is_discarded()) return std::nullopt;
  return Document(Node::Of(std::make_shared<const Json>(std::move(value))));
}

bool Document::IsObject() const { return node_->json().is_object(); }

Document Document::operator[](const char* name) const {
  const Json& value = node_->json();
  if (!value.is_object()) return {};
  const auto member = value.find(name);
  if (member == value.end()) return {};
  return Document(Node::Of(std::shared_ptr<const Json>(node_, &*member)));
}

std::vector<Document> Document::Items() const {
  std::vector<Document> items;
  if (!node_->json().is_array()) return items;
  for (const Json& item : node_->json()) {
    items.push_back(Document(Node::Of(std::shared_ptr<const Json>(node_, &item))));
  }
  return items;
}

std::optional<std::string> Document::Text() const {
  if (!node_->json().is_string()) return std::nullopt;
  return node_->json().get<std::string>();
}

std::optional<double> Document::Number() const {
  if (!node_->json().is_number()) return std::nullopt;
  return node_->json().get<double>();
}

std::optional<std::uint64_t> Document::Count() const {
  if (!node_->json().is_number_unsigned()) return std::nullopt;
  return node_->json().get<std::uint64_t>();
}

std::optional<bool> Document::Flag() const {
  if (!node_->json().is_boolean()) return std::nullopt;
  return node_->json().get<bool>();
}

std::vector<double> Document::Numbers() const {
  std::vector<double> numbers;
  for (const Document& item : Items()) {
    if (const auto number = item.Number()) numbers.push_back(*number);
  }
  return numbers;
}

Document Document::ArrayOf(const std::vector<Document>& items) {
  auto array = std::make_shared<Json>(Json::array());
  for (const Document& item : items) array->push_back(item.node_->json());
  return Document(Node::Of(std::move(array)));
}

Document Document::ObjectOf(const std::vector<std::pair<std::string, Document>>& members) {
  auto object = std::make_shared<Json>(Json::object());
  for (const auto& [name, member] : members) (*object)[name] = member.node_->json();
  return Document(Node::Of(std::move(object)));
}

std::string Document::Indented() const {
  // A text that is not UTF-8 (a file's name) must not throw.
  return node_->json().dump(kIndentation, ' ', false, Json::error_handler_t::replace);
}

}  // namespace kdray::client
