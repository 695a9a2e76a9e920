// SPDX-License-Identifier: Apache-2.0
// The connection of a request without a socket.
#pragma once

#include <algorithm>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "server/http/message.h"

namespace kdray::test {

class FakePeer final : public server::HttpPeer {
 public:
  explicit FakePeer(std::string body = {}) : body_(std::move(body)), size_(body_.size()) {}

  /// Declares a length that differs from the number of bytes.
  void Declare(std::uint64_t size) { size_ = size; }
  /// Declares no length: a chunked body.
  void DeclareNothing() { size_ = std::nullopt; }
  bool was_read() const { return was_read_; }

  std::optional<std::uint64_t> body_size() const override { return size_; }
  api::Outcome<std::size_t> ReadBody(std::span<std::byte> out) override {
    was_read_ = true;
    const std::size_t count = std::min(out.size(), body_.size() - taken_);
    if (count == 0 && taken_ < size_.value_or(0)) {
      return api::Problem{.code = api::ErrorCode::kMalformedRequest, .detail = "ended early"};
    }
    std::memcpy(out.data(), body_.data() + taken_, count);
    taken_ += count;
    return count;
  }
  std::shared_ptr<void> CancelWhenGone(const core::CancelToken&) override { return nullptr; }

 private:
  std::string body_;
  std::optional<std::uint64_t> size_;
  std::size_t taken_ = 0;
  bool was_read_ = false;
};

}  // namespace kdray::test
