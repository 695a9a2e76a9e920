// SPDX-License-Identifier: Apache-2.0
#include "core/store/retrying_store.h"

#include <gtest/gtest.h>

#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/memory_object_store.h"
#include "tests/support/mesh_files.h"

namespace kdray::test {
namespace {

using core::CancelToken;
using core::ErrorCode;
using core::PutMode;
using core::RetryingStore;
using std::chrono::milliseconds;
using Fault = MemoryObjectStore::Fault;
using Call = MemoryObjectStore::Call;

RetryingStore::Rule Quick() {
  return {.attempts = 3,
          .first_backoff = milliseconds(1),
          .most_backoff = milliseconds(2),
          .first_pause = milliseconds(40),
          .most_pause = milliseconds(80)};
}

class RetryingStoreTest : public testing::Test {
 protected:
  // The next `count` calls have the fault.
  void Fail(int count, Fault fault) {
    left_ = count;
    objects_.set_faults(
        [this, fault](Call, std::string_view) { return left_-- > 0 ? fault : Fault::kNone; });
  }
  core::Status Put() { return store_.Put("key", Bytes("body"), PutMode::kReplace, {}); }

  MemoryObjectStore objects_;
  std::atomic<int> left_{0};
  std::vector<std::string> changes_;
  RetryingStore store_{&objects_, Quick(), [this](bool is_away, const std::string& why) {
                         changes_.push_back(is_away ? "away: " + why : "back");
                       }};
};

TEST_F(RetryingStoreTest, RepeatsWhatFailsForAPassingReason) {
  for (const Fault fault : {Fault::kAway, Fault::kLostAnswer, Fault::kTruncated}) {
    Fail(2, fault);
    EXPECT_TRUE(Put().ok());
    EXPECT_EQ(objects_.Contents("key"), Bytes("body"));
  }
  EXPECT_EQ(store_.counts().retries, 6u);
  EXPECT_EQ(store_.counts().failures, 0u);
  EXPECT_TRUE(changes_.empty());
}

TEST_F(RetryingStoreTest, DoesNotRepeatWhatIsRefusedOrMissing) {
  Fail(1, Fault::kRefused);
  const core::Status put = Put();
  ASSERT_FALSE(put.ok());
  EXPECT_EQ(put.error().code, ErrorCode::kStoreFull);
  EXPECT_EQ(store_.Head("other", {}).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(objects_.calls(), 2u);
}

TEST_F(RetryingStoreTest, AnAnswerThatStaysWrongIsCorruptAndTheStoreIsNotAway) {
  Fail(1000, Fault::kTruncated);
  EXPECT_EQ(store_.Head("key", {}).error().code, ErrorCode::kCorrupt);
  EXPECT_EQ(objects_.calls(), 3u);
  EXPECT_FALSE(store_.IsAway());
}

TEST_F(RetryingStoreTest, FailsAtOnceWhileTheStoreIsAwayAndRecoversByItself) {
  Fail(1000, Fault::kAway);
  EXPECT_TRUE(IsStoreAway(Put().error()));
  EXPECT_TRUE(store_.IsAway());
  const std::uint64_t calls = objects_.calls();
  EXPECT_EQ(calls, 3u);
  EXPECT_TRUE(IsStoreAway(Put().error()));
  EXPECT_EQ(objects_.calls(), calls) << "in the pause nothing is sent";
  std::this_thread::sleep_for(milliseconds(50));
  EXPECT_FALSE(store_.IsAway());
  EXPECT_FALSE(Put().ok());
  EXPECT_EQ(objects_.calls(), calls + 1) << "one attempt after the pause";
  EXPECT_TRUE(store_.IsAway());
  std::this_thread::sleep_for(milliseconds(50));
  EXPECT_TRUE(store_.IsAway()) << "the second pause is longer";
  left_ = 0;
  std::this_thread::sleep_for(milliseconds(40));
  EXPECT_TRUE(Put().ok());
  EXPECT_EQ(changes_, (std::vector<std::string>{"away: the store does not answer", "back"}));
}

TEST_F(RetryingStoreTest, OneCallTriesAfterAPauseAndTheOthersDoNotWaitForIt) {
  Fail(1000, Fault::kAway);
  EXPECT_FALSE(Put().ok());
  EXPECT_TRUE(store_.counts().is_away);
  std::this_thread::sleep_for(milliseconds(50));
  std::atomic<bool> is_stuck{true}, is_asked{false};
  objects_.set_faults([&](Call, std::string_view) {
    is_asked = true;
    while (is_stuck) std::this_thread::sleep_for(milliseconds(1));
    return Fault::kNone;
  });
  std::thread first([this] { EXPECT_TRUE(Put().ok()); });
  while (!is_asked) std::this_thread::sleep_for(milliseconds(1));
  EXPECT_TRUE(store_.IsAway());
  EXPECT_TRUE(IsStoreAway(Put().error()));
  std::this_thread::sleep_for(milliseconds(50));
  EXPECT_FALSE(store_.IsAway()) << "the first one has not ended, so another one may try";
  is_stuck = false;
  first.join();
  EXPECT_FALSE(store_.counts().is_away);
}

TEST_F(RetryingStoreTest, AFailureThatBeganBeforeAnotherCallsAnswerDoesNotMakeTheStoreAway) {
  std::atomic<bool> is_stuck{true}, is_asked{false};
  objects_.set_faults([&](Call call, std::string_view) {
    if (call != Call::kPut) return Fault::kNone;
    is_asked = true;
    while (is_stuck) std::this_thread::sleep_for(milliseconds(1));
    return Fault::kAway;
  });
  RetryingStore once(&objects_, {.attempts = 1}, nullptr);
  std::thread slow([&] { EXPECT_FALSE(once.Put("a", {}, PutMode::kReplace, {}).ok()); });
  while (!is_asked) std::this_thread::sleep_for(milliseconds(1));
  EXPECT_TRUE(once.List("", "", 1, {}).ok());
  is_stuck = false;
  slow.join();
  EXPECT_FALSE(once.counts().is_away);
  EXPECT_FALSE(once.Put("a", {}, PutMode::kReplace, {}).ok());
  EXPECT_TRUE(once.counts().is_away);
}

TEST_F(RetryingStoreTest, EndsSoonAfterItsCancellation) {
  MemoryObjectStore objects;
  objects.set_faults([](Call, std::string_view) { return Fault::kAway; });
  RetryingStore slow(&objects,
                     {.attempts = 1'000'000,
                      .first_backoff = std::chrono::hours(1),
                      .most_backoff = std::chrono::hours(1)},
                     nullptr);
  const auto start = std::chrono::steady_clock::now();
  const auto cancel = CancelToken::WithDeadline(start + milliseconds(30));
  EXPECT_EQ(slow.Head("key", cancel).error().code, ErrorCode::kDeadlineExceeded);
  EXPECT_LT(std::chrono::steady_clock::now() - start, milliseconds(280));
  EXPECT_FALSE(slow.IsAway()) << "a cancelled call says nothing";
}

}  // namespace
}  // namespace kdray::test
