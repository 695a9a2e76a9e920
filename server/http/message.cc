// SPDX-License-Identifier: Apache-2.0
#include "server/http/message.h"

#include <algorithm>
#include <iterator>

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
  *this = Static(*owned);
  owner_ = std::move(owned);
}

HttpBody::HttpBody(std::vector<std::byte> bytes) {
  auto owned = std::make_shared<const std::vector<std::byte>>(std::move(bytes));
  *this = Static({reinterpret_cast<const char*>(owned->data()), owned->size()});
  owner_ = std::move(owned);
}

HttpBody::HttpBody(std::vector<api::ByteBlock> pieces, std::shared_ptr<const void> owner) {
  // Destroyed from the last to the first: the bytes before their charge.
  using Owned = std::pair<std::shared_ptr<const void>, std::vector<api::ByteBlock>>;
  auto owned = std::make_shared<const Owned>(std::move(owner), std::move(pieces));
  for (const api::ByteBlock& piece : owned->second) {
    pieces_.push_back({size_, piece.view()});
    size_ += piece.size();
  }
  owner_ = std::move(owned);
}

HttpBody HttpBody::Static(std::string_view bytes) {
  HttpBody body;
  body.pieces_ = {{0, bytes}};
  body.size_ = bytes.size();
  return body;
}

HttpBody HttpBody::Streamed(std::uint64_t size, Reader reader) {
  HttpBody body;
  body.size_ = size;
  body.reader_ = std::move(reader);
  return body;
}

HttpBody HttpBody::Of(const std::vector<std::string_view>& pieces,
                      std::shared_ptr<const void> owner) {
  HttpBody body;
  for (const std::string_view piece : pieces) {
    body.pieces_.push_back({body.size_, piece});
    body.size_ += piece.size();
  }
  body.owner_ = std::move(owner);
  return body;
}

void HttpBody::Own(std::shared_ptr<const void> owner) {
  using Both = std::pair<std::shared_ptr<const void>, std::shared_ptr<const void>>;
  // Destroyed from the last to the first: the bytes before their charge.
  owner_ = std::make_shared<const Both>(std::move(owner), std::move(owner_));
}

std::string_view HttpBody::BytesFrom(std::uint64_t offset) const {
  const auto after =
      std::upper_bound(pieces_.begin(), pieces_.end(), offset,
                       [](std::uint64_t at, const Piece& piece) { return at < piece.offset; });
  if (after == pieces_.begin()) return {};
  const Piece& piece = *std::prev(after);
  return piece.bytes.substr(static_cast<std::size_t>(offset - piece.offset));
}

}  // namespace kdray::server
