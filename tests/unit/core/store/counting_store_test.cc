// SPDX-License-Identifier: Apache-2.0
#include "core/store/counting_store.h"

#include <gtest/gtest.h>

#include <numeric>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/memory_object_store.h"
#include "tests/support/mesh_files.h"

namespace kdray::test {
namespace {

using core::CancelToken;
using core::CountingStore;
using core::ErrorCode;
using core::PutMode;
using core::StoreCounts;
using core::StoreOperation;
using Fault = MemoryObjectStore::Fault;
using Call = MemoryObjectStore::Call;

class CountingStoreTest : public testing::Test {
 protected:
  StoreCounts::Requests Of(StoreOperation operation) const {
    return store_.counts().requests[static_cast<std::size_t>(operation)];
  }
  void SetFault(Fault fault) {
    objects_.set_faults([fault](Call, std::string_view) { return fault; });
  }

  MemoryObjectStore objects_;
  CountingStore store_{&objects_};
};

TEST_F(CountingStoreTest, CountsAnswersByOperationAndTheBytesOfObjects) {
  std::vector<std::byte> out(3);
  EXPECT_TRUE(store_.Put("a", Bytes("bytes"), PutMode::kReplace, {}).ok());
  EXPECT_TRUE(store_.Get("a", 1, out, {}).ok());
  EXPECT_EQ(out, Bytes("yte"));
  EXPECT_TRUE(store_.Head("a", {}).ok());
  EXPECT_EQ(store_.Head("b", {}).error().code, ErrorCode::kNotFound) << "an answer too";
  EXPECT_EQ(store_.List("", "", 10, {})->objects.size(), 1u);
  EXPECT_TRUE(store_.Delete("a", {}).ok());
  EXPECT_EQ(Of(StoreOperation::kPut).answered, 1u);
  EXPECT_EQ(Of(StoreOperation::kGet).answered, 1u);
  EXPECT_EQ(Of(StoreOperation::kHead).answered, 2u);
  EXPECT_EQ(Of(StoreOperation::kList).answered, 1u);
  EXPECT_EQ(Of(StoreOperation::kDelete).answered, 1u);
  for (const StoreCounts::Requests& requests : store_.counts().requests) {
    EXPECT_EQ(requests.failed, 0u);
  }
  EXPECT_EQ(store_.counts().sent_bytes, 5u);
  EXPECT_EQ(store_.counts().received_bytes, 3u);
}

TEST_F(CountingStoreTest, PartsAreWritesAndTheirEndByAnErrorIsADeletion) {
  const auto upload = store_.BeginParts("a", {});
  ASSERT_TRUE(upload.ok());
  const auto tag = store_.PutPart("a", *upload, 1, Bytes("part"), {});
  ASSERT_TRUE(tag.ok());
  EXPECT_TRUE(store_.FinishParts("a", *upload, std::vector{*tag}, PutMode::kReplace, {}).ok());
  EXPECT_EQ(objects_.Contents("a"), Bytes("part"));
  EXPECT_TRUE(store_.AbortParts("a", "other", {}).ok());
  EXPECT_EQ(Of(StoreOperation::kPut).answered, 3u);
  EXPECT_EQ(Of(StoreOperation::kDelete).answered, 1u);
  EXPECT_EQ(store_.counts().sent_bytes, 4u);
}

TEST_F(CountingStoreTest, WhatGetsNoRightAnswerHasFailedAndMovedNoBytes) {
  std::vector<std::byte> out(3);
  int failed = 0;
  for (const Fault fault : {Fault::kAway, Fault::kRefused, Fault::kTruncated}) {
    SetFault(fault);
    EXPECT_FALSE(store_.Get("a", 0, out, {}).ok());
    EXPECT_FALSE(store_.Put("a", Bytes("bytes"), PutMode::kKeep, {}).ok());
    ++failed;
    EXPECT_EQ(Of(StoreOperation::kGet).failed, static_cast<std::uint64_t>(failed));
    EXPECT_EQ(Of(StoreOperation::kPut).failed, static_cast<std::uint64_t>(failed));
  }
  EXPECT_EQ(store_.counts().sent_bytes + store_.counts().received_bytes, 0u);
}

TEST_F(CountingStoreTest, ACancelledRequestIsNotCounted) {
  const CancelToken cancel = CancelToken::Cancellable();
  cancel.Cancel();
  EXPECT_EQ(store_.Head("a", cancel).error().code, ErrorCode::kCancelled);
  EXPECT_EQ(Of(StoreOperation::kHead).answered + Of(StoreOperation::kHead).failed, 0u);
}

TEST_F(CountingStoreTest, EachRequestIsInTheClassOfItsTime) {
  objects_.set_faults([](Call call, std::string_view) {
    if (call == Call::kHead) std::this_thread::sleep_for(std::chrono::milliseconds(30));
    return Fault::kNone;
  });
  (void)store_.Head("a", {});
  (void)store_.List("", "", 1, {});
  const StoreCounts counts = store_.counts();
  EXPECT_EQ(std::accumulate(counts.by_time.begin(), counts.by_time.end(), 0u), 2u);
  EXPECT_EQ(counts.by_time[0] + counts.by_time[1], 1u) << "the list";
  EXPECT_GE(counts.seconds, 0.03);
}

}  // namespace
}  // namespace kdray::test
