#include "server/http/message.h"

#include <algorithm>

namespace kdray::server {
namespace {

char Lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

}  // namespace

bool EqualsIgnoringCase(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](char x, char y) { return Lower(x) == Lower(y); });
}

void HttpHeaders::Add(std::string_view name, std::string_view value) {
  fields_.emplace_back(name, value);
}

void HttpHeaders::Set(std::string_view name, std::string_view value) {
  Remove(name);
  Add(name, value);
}

void HttpHeaders::Remove(std::string_view name) {
  std::erase_if(fields_,
                [name](const auto& field) { return EqualsIgnoringCase(field.first, name); });
}

std::optional<std::string_view> HttpHeaders::Find(std::string_view name) const {
  for (const auto& [field, value] : fields_) {
    if (EqualsIgnoringCase(field, name)) return value;
  }
  return std::nullopt;
}

std::size_t HttpHeaders::Count(std::string_view name) const {
  return static_cast<std::size_t>(
      std::count_if(fields_.begin(), fields_.end(),
                    [name](const auto& field) { return EqualsIgnoringCase(field.first, name); }));
}

HttpBody::HttpBody(std::string text) {
  auto owned = std::make_shared<const std::string>(std::move(text));
  data_ = owned->data();
  size_ = owned->size();
  owner_ = std::move(owned);
}

HttpBody::HttpBody(std::vector<std::byte> bytes) {
  auto owned = std::make_shared<const std::vector<std::byte>>(std::move(bytes));
  data_ = reinterpret_cast<const char*>(owned->data());
  size_ = owned->size();
  owner_ = std::move(owned);
}

HttpBody HttpBody::Static(std::string_view bytes) {
  HttpBody body;
  body.data_ = bytes.data();
  body.size_ = bytes.size();
  return body;
}

HttpBody HttpBody::Streamed(std::uint64_t size, Reader reader) {
  HttpBody body;
  body.size_ = size;
  body.reader_ = std::move(reader);
  return body;
}

}  // namespace kdray::server
