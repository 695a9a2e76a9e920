#include "clients/cpp/client/document.h"

#include <nlohmann/json.hpp>

namespace kdray::client {
namespace {

using Json = nlohmann::json;

constexpr int kIndentation = 2;

std::shared_ptr<const Json> Null() {
  static const auto null = std::make_shared<const Json>();
  return null;
}

}  // namespace

Document::Document() : value_(Null()) {}

std::optional<Document> Document::Parse(std::string_view text) {
  Json value = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (value.is_discarded()) return std::nullopt;
  return Document(std::make_shared<const Json>(std::move(value)));
}

bool Document::IsObject() const { return value_->is_object(); }

Document Document::operator[](const char* name) const {
  if (!value_->is_object()) return {};
  const auto member = value_->find(name);
  if (member == value_->end()) return {};
  return Document(std::shared_ptr<const Json>(value_, &*member));
}

std::vector<Document> Document::Items() const {
  std::vector<Document> items;
  if (!value_->is_array()) return items;
  for (const Json& item : *value_)
    items.push_back(Document(std::shared_ptr<const Json>(value_, &item)));
  return items;
}

std::optional<std::string> Document::Text() const {
  if (!value_->is_string()) return std::nullopt;
  return value_->get<std::string>();
}

std::optional<double> Document::Number() const {
  if (!value_->is_number()) return std::nullopt;
  return value_->get<double>();
}

std::optional<std::uint64_t> Document::Count() const {
  if (!value_->is_number_unsigned()) return std::nullopt;
  return value_->get<std::uint64_t>();
}

std::optional<bool> Document::Flag() const {
  if (!value_->is_boolean()) return std::nullopt;
  return value_->get<bool>();
}

std::vector<double> Document::Numbers() const {
  std::vector<double> numbers;
  for (const Document& item : Items())
    if (const auto number = item.Number()) numbers.push_back(*number);
  return numbers;
}

Document Document::ArrayOf(const std::vector<Document>& items) {
  auto array = std::make_shared<Json>(Json::array());
  for (const Document& item : items) array->push_back(*item.value_);
  return Document(std::move(array));
}

std::string Document::Indented() const { return value_->dump(kIndentation); }

}  // namespace kdray::client
