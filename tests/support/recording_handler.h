// SPDX-License-Identifier: Apache-2.0
// What the handlers of tests of the HTTP adaptor share.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "server/http/message.h"
#include "tests/support/wait_until.h"

namespace kdray::test {

/// Keeps the records of the answers. The body of a refusal is the name of its error code.
class RecordingHandler : public server::HttpHandler {
 public:
  server::HttpResponse Refuse(const server::HttpRequest&, const api::Problem& problem) override {
    server::HttpResponse response;
    response.status = api::RowOf(problem.code).status;
    response.error_code = api::Name(problem.code);
    response.body = std::string(api::Name(problem.code));
    return response;
  }

  void Answered(const server::HttpRecord& record) noexcept override {
    const std::lock_guard lock(mutex_);
    records_.push_back(record);
  }

  /// The records that were not taken yet, in the order of the answers' ends.
  std::vector<server::HttpRecord> Records() {
    const std::lock_guard lock(mutex_);
    return records_;
  }

  /// Takes the oldest record, which may be written a moment after its answer.
  server::HttpRecord NextRecord() {
    return TakeRecord([](const server::HttpRecord&) { return true; });
  }

  /// Takes the oldest record of a request to `path`.
  server::HttpRecord RecordOf(const std::string& path) {
    return TakeRecord([&](const server::HttpRecord& record) { return record.path == path; });
  }

  void WaitUntilWorking(int count = 1) const {
    ASSERT_TRUE(WaitUntil([&] { return working == count; })) << working << " at work";
  }

  std::atomic<int> working{0};  ///< requests that are in WorkUntilLetGo()
  std::atomic<bool> let_go{false};

 protected:
  /// Appends the rest of the request's body. Returns why it cannot be read.
  static std::optional<api::Problem> ReadBody(const server::HttpRequest& request,
                                              std::string* text) {
    std::vector<std::byte> piece(1000);
    for (;;) {
      const auto count = request.peer->ReadBody(piece);
      if (!count) return count.problem();
      if (*count == 0) return std::nullopt;
      text->append(reinterpret_cast<const char*>(piece.data()), *count);
    }
  }

  /// Works until `let_go` is set or the client has left. False if it has left.
  bool WorkUntilLetGo(const server::HttpRequest& request) {
    const auto cancel = core::CancelToken::Cancellable();
    const auto watch = request.peer->CancelWhenGone(cancel);
    ++working;
    const bool ended = WaitUntil([&] { return cancel.ShouldStop() || let_go; });
    --working;
    return ended && !cancel.ShouldStop();
  }

 private:
  template <class Wanted>
  server::HttpRecord TakeRecord(const Wanted& wanted) {
    std::optional<server::HttpRecord> taken;
    EXPECT_TRUE(WaitUntil([&] {
      const std::lock_guard lock(mutex_);
      const auto found = std::find_if(records_.begin(), records_.end(), wanted);
      if (found == records_.end()) return false;
      taken = *found;
      records_.erase(found);
      return true;
    })) << "no record";
    return taken.value_or(server::HttpRecord());
  }

  std::mutex mutex_;
  std::vector<server::HttpRecord> records_;
};

}  // namespace kdray::test
