// SPDX-License-Identifier: Apache-2.0
#include "core/store/shared_store.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "core/store/memory_file.h"
#include "core/store/retrying_store.h"
#include "tests/support/memory_object_store.h"
#include "tests/support/mesh_files.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::CancelToken;
using core::ErrorCode;
using core::MemoryFile;
using core::Result;
using core::SharedStore;
using core::TreeId;
using core::TreeRecord;
using std::chrono::milliseconds;
using Fault = MemoryObjectStore::Fault;
using Call = MemoryObjectStore::Call;

constexpr std::int64_t kDayMs = 24LL * 3600 * 1000;

TreeId IdOf(const std::vector<std::byte>& mesh, std::optional<BuildKind> build = std::nullopt) {
  return {core::HashBytes(mesh), build};
}

class SharedStoreTest : public testing::Test {
 protected:
  Result<SharedStore::Published> Publish(const std::vector<std::byte>& mesh,
                                         std::optional<BuildKind> build = std::nullopt) {
    TreeRecord record;
    record.id = IdOf(mesh, build);
    record.mesh_bytes = mesh.size();
    std::vector<std::byte> buffer(SharedStore::BufferBytes(mesh.size()));
    return shared_.Publish(record, MemoryFile(mesh), buffer, {});
  }
  bool Exists(const TreeId& id) {
    const Result<bool> exists = shared_.Exists(id, {});
    EXPECT_TRUE(exists.ok());
    return exists.ok() && *exists;
  }
  std::vector<std::byte> ReadMesh(const std::vector<std::byte>& mesh) {
    const auto copies = shared_.CopiesOf(core::HashBytes(mesh), mesh.size(), {});
    EXPECT_TRUE(copies.ok());
    if (!copies.ok() || copies->empty()) return {};
    std::vector<std::byte> all, buffer(100);
    const auto append = [&](std::span<const std::byte> piece) {
      all.insert(all.end(), piece.begin(), piece.end());
      return core::Status();
    };
    EXPECT_TRUE(shared_.Read(copies->front(), mesh.size(), buffer, append, {}).ok());
    return all;
  }

  MemoryObjectStore objects_;
  core::RetryingStore retrying_{&objects_,
                                {.attempts = 3,
                                 .first_backoff = milliseconds(0),
                                 .most_backoff = milliseconds(0),
                                 .first_pause = milliseconds(0),
                                 .most_pause = milliseconds(0)},
                                nullptr};
  SharedStore shared_{&retrying_};
  const std::vector<std::byte> mesh_ = Bytes("the bytes of a mesh");
  const TreeId id_ = IdOf(mesh_);
};

TEST_F(SharedStoreTest, WhatIsPublishedIsFoundByAnotherAndHasItsMesh) {
  EXPECT_FALSE(Exists(id_));
  const auto published = Publish(mesh_);
  ASSERT_TRUE(published.ok());
  EXPECT_FALSE(published->existed);
  EXPECT_GT(published->record.created_ms, 0);
  SharedStore other(&objects_);
  const auto found = other.Find(id_, {});
  ASSERT_TRUE(found.ok() && *found);
  EXPECT_EQ((*found)->record, published->record);
  EXPECT_EQ((*found)->generation, published->generation);
  EXPECT_EQ(ReadMesh(mesh_), mesh_);
}

TEST_F(SharedStoreTest, TheSameUploadAgainMakesNothing) {
  const auto first = Publish(mesh_);
  ASSERT_TRUE(first.ok());
  const std::vector<std::string> keys = objects_.Keys();
  const auto second = Publish(mesh_);
  ASSERT_TRUE(second.ok());
  EXPECT_TRUE(second->existed);
  EXPECT_EQ(second->generation, first->generation);
  EXPECT_EQ(objects_.Keys(), keys);
}

TEST_F(SharedStoreTest, AnUploadRepairsALostOrCutMeshAndADamagedRecord) {
  ASSERT_TRUE(Publish(mesh_).ok());
  const std::string mesh_key = objects_.Keys("meshes/").at(0);
  const std::string record_key = objects_.Keys("catalog/").at(0);
  objects_.Erase(mesh_key);
  ASSERT_TRUE(Publish(mesh_).ok());
  EXPECT_EQ(objects_.Contents(mesh_key), mesh_);
  objects_.SetContents(mesh_key, Bytes("the bytes"));
  ASSERT_TRUE(Publish(mesh_).ok());
  EXPECT_EQ(objects_.Contents(mesh_key), mesh_);
  objects_.SetContents(record_key, Bytes("no record"));
  EXPECT_EQ(shared_.Find(id_, {}).error().code, ErrorCode::kCorrupt);
  const auto again = Publish(mesh_);
  ASSERT_TRUE(again.ok());
  EXPECT_TRUE(again->existed);
  EXPECT_TRUE(shared_.Find(id_, {}).ok());
}

TEST_F(SharedStoreTest, ADeletionTakesOneIdAndLeavesTheOthersOfItsMesh) {
  ASSERT_TRUE(Publish(mesh_).ok());
  ASSERT_TRUE(Publish(mesh_, BuildKind::kBvh).ok());
  const auto both = shared_.IdsOf(id_.mesh, {});
  ASSERT_TRUE(both.ok());
  EXPECT_EQ(*both, (std::vector<TreeId>{id_, IdOf(mesh_, BuildKind::kBvh)}));
  auto removed = shared_.Remove(id_, {});
  ASSERT_TRUE(removed.ok());
  EXPECT_TRUE(*removed);
  EXPECT_FALSE(Exists(id_));
  EXPECT_TRUE(Exists(IdOf(mesh_, BuildKind::kBvh)));
  EXPECT_EQ(ReadMesh(mesh_), mesh_);
  removed = shared_.Remove(id_, {});
  ASSERT_TRUE(removed.ok());
  EXPECT_FALSE(*removed);
  ASSERT_TRUE(shared_.Remove(IdOf(mesh_, BuildKind::kBvh), {}).ok());
  EXPECT_TRUE(objects_.Keys("meshes/").empty());
  EXPECT_TRUE(objects_.Keys("by-age/").empty());
}

TEST_F(SharedStoreTest, ALateDeletionDoesNotTakeWhatWasUploadedSince) {
  ASSERT_TRUE(Publish(mesh_).ok());
  // Every first attempt of a write is carried out after everything else.
  objects_.set_faults([count = 0](Call call, std::string_view) mutable {
    return (call == Call::kPut || call == Call::kDelete) && count++ % 2 == 0 ? Fault::kLate
                                                                             : Fault::kNone;
  });
  ASSERT_TRUE(shared_.Remove(id_, {}).ok());
  EXPECT_FALSE(Exists(id_));
  const auto again = Publish(mesh_);
  ASSERT_TRUE(again.ok());
  EXPECT_FALSE(again->existed);
  objects_.set_faults(nullptr);
  objects_.DeliverLate();
  EXPECT_TRUE(Exists(id_));
  EXPECT_EQ(ReadMesh(mesh_), mesh_);
  ASSERT_TRUE(shared_.Remove(id_, {}).ok());
  EXPECT_FALSE(Exists(id_));
}

TEST_F(SharedStoreTest, ALateUploadDoesNotBringBackWhatWasDeletedSince) {
  objects_.set_faults([count = 0](Call call, std::string_view) mutable {
    return call == Call::kPut && count++ % 2 == 0 ? Fault::kLate : Fault::kNone;
  });
  ASSERT_TRUE(Publish(mesh_).ok());
  objects_.set_faults(nullptr);
  ASSERT_TRUE(shared_.Remove(id_, {}).ok());
  objects_.DeliverLate();
  EXPECT_FALSE(Exists(id_));
  const auto found = shared_.Find(id_, {});
  ASSERT_TRUE(found.ok());
  EXPECT_FALSE(*found);
}

TEST_F(SharedStoreTest, DeletionsOfADayAgoAreForgottenWithWhatCameBack) {
  const auto published = Publish(mesh_);
  ASSERT_TRUE(published.ok());
  ASSERT_TRUE(shared_.Remove(id_, {}).ok());
  objects_.SetContents("meshes/" + id_.mesh.ToHex() + "/" + published->generation, mesh_);
  EXPECT_EQ(objects_.Keys("catalog/").size(), 1u);
  ASSERT_TRUE(Publish(mesh_).ok());
  EXPECT_EQ(objects_.Keys("catalog/").size(), 2u) << "a new deletion stays";
  ASSERT_TRUE(shared_.Remove(id_, {}).ok());
  objects_.Age(2 * kDayMs);
  EXPECT_FALSE(*shared_.Remove(id_, {}));
  EXPECT_TRUE(objects_.Keys().empty());
}

TEST_F(SharedStoreTest, TimesAreThoseOfTheStoresClock) {
  for (const std::int64_t ahead_ms : {-30 * kDayMs, 30 * kDayMs}) {
    objects_.SetClock(ahead_ms);
    const auto published = Publish(mesh_);
    ASSERT_TRUE(published.ok());
    EXPECT_LT(std::abs(published->record.created_ms - objects_.NowMs()), 60'000);
    ASSERT_TRUE(shared_.Remove(id_, {}).ok());
    EXPECT_FALSE(Exists(id_));
    ASSERT_FALSE(*shared_.Remove(id_, {}));
    EXPECT_EQ(objects_.Keys("catalog/").size(), 1u)
        << "a clock that is off does not make the deletion one of a day ago";
    objects_.Age(2 * kDayMs);
    ASSERT_FALSE(*shared_.Remove(id_, {}));
    EXPECT_TRUE(objects_.Keys().empty());
  }
}

TEST_F(SharedStoreTest, AFailureAtAnyCallOfAnUploadLeavesEitherNothingOrAWholeTree) {
  for (const Fault fault : {Fault::kAway, Fault::kLostAnswer, Fault::kRefused}) {
    for (std::uint64_t first = 0; first < 20; ++first) {
      MemoryObjectStore objects;
      SharedStore shared(&objects);
      objects.set_faults([&, start = objects.calls()](Call, std::string_view) {
        return objects.calls() > start + first ? fault : Fault::kNone;
      });
      TreeRecord record;
      record.id = id_;
      record.mesh_bytes = mesh_.size();
      std::vector<std::byte> buffer(mesh_.size());
      const auto published = shared.Publish(record, MemoryFile(mesh_), buffer, {});
      objects.set_faults(nullptr);
      const auto found = shared.Find(id_, {});
      ASSERT_TRUE(found.ok());
      EXPECT_TRUE(*found || !published.ok()) << "an acknowledged mesh is lost";
      if (*found) {
        ASSERT_EQ(shared.CopiesOf(id_.mesh, mesh_.size(), {})->size(), 1u)
            << "a record without its mesh";
      }
      const auto list = shared.List(std::nullopt, 10, {});
      ASSERT_TRUE(list.ok());
      EXPECT_TRUE(!*found || list->trees.size() == 1) << "a tree that no list has";
    }
  }
}

TEST_F(SharedStoreTest, ManyWhoUploadAndDeleteAtTheSameTimeAgree) {
  for (int round = 0; round < 20; ++round) {
    std::vector<std::thread> threads;
    for (int i = 0; i < 4; ++i) {
      threads.emplace_back([&] { EXPECT_TRUE(Publish(mesh_).ok()); });
    }
    for (std::thread& thread : threads) thread.join();
    EXPECT_TRUE(Exists(id_));
    EXPECT_EQ(ReadMesh(mesh_), mesh_);
    const auto list = shared_.List(std::nullopt, 100, {});
    ASSERT_TRUE(list.ok());
    int shown = 0;
    for (const auto& entry : list->trees) {
      shown += shared_.ReadRecord(entry.id, entry.generation, {}).ok() ? 1 : 0;
    }
    EXPECT_EQ(shown, 1);
    EXPECT_TRUE(*shared_.Remove(id_, {}));
    EXPECT_FALSE(Exists(id_));
    EXPECT_TRUE(objects_.Keys("meshes/").empty());
  }
}

TEST_F(SharedStoreTest, AnUpdateChangesTheRecordAndNothingElse) {
  const auto published = Publish(mesh_);
  ASSERT_TRUE(published.ok());
  TreeRecord record = published->record;
  record.mesh.emplace().triangles = 12;
  record.resumed = 3;
  EXPECT_TRUE(*shared_.Update(record, {}));
  const auto found = shared_.Find(id_, {});
  ASSERT_TRUE(found.ok() && *found);
  ASSERT_TRUE((*found)->record.mesh);
  EXPECT_EQ((*found)->record.mesh->triangles, 12u);
  EXPECT_EQ((*found)->record.resumed, 0u) << "the resumes of one library say nothing to others";
  ASSERT_TRUE(shared_.Remove(id_, {}).ok());
  EXPECT_FALSE(*shared_.Update(record, {}));
  EXPECT_FALSE(Exists(id_));
}

TEST_F(SharedStoreTest, ListsPageThroughAllTreesNewestFirst) {
  std::vector<TreeId> newest_first;
  for (int i = 0; i < 7; ++i) {
    const auto mesh = Bytes("mesh " + std::to_string(i));
    ASSERT_TRUE(Publish(mesh).ok());
    newest_first.insert(newest_first.begin(), IdOf(mesh));
    std::this_thread::sleep_for(milliseconds(2));
  }
  objects_.SetContents("by-age/a-foreign-object", {});
  std::vector<TreeId> listed;
  std::optional<std::pair<std::int64_t, TreeId>> after;
  for (bool has_more = true; has_more;) {
    const auto page = shared_.List(after, 3, {});
    ASSERT_TRUE(page.ok());
    ASSERT_LE(page->trees.size(), 3u);
    for (const auto& entry : page->trees) listed.push_back(entry.id);
    has_more = page->has_more;
    if (has_more) after.emplace(page->trees.back().created_ms, page->trees.back().id);
  }
  EXPECT_EQ(listed, newest_first);
}

TEST_F(SharedStoreTest, ALargeMeshGoesInPartsAndALostPartIsNotMissed) {
  std::vector<std::byte> mesh(3 * SharedStore::kPieceBytes + 12345);
  for (std::size_t i = 0; i < mesh.size(); i += 97) mesh[i] = static_cast<std::byte>(i * 31);
  for (const Fault fault : {Fault::kNone, Fault::kAway, Fault::kLostAnswer}) {
    objects_.set_faults([fault, count = 0](Call call, std::string_view) mutable {
      const bool is_part = call == Call::kPutPart || call == Call::kFinishParts;
      return is_part && ++count % 2 == 1 ? fault : Fault::kNone;
    });
    ASSERT_TRUE(Publish(mesh).ok());
    objects_.set_faults(nullptr);
    EXPECT_EQ(ReadMesh(mesh), mesh);
    ASSERT_TRUE(shared_.Remove(IdOf(mesh), {}).ok());
  }
  EXPECT_GE(objects_.calls(Call::kPutPart), 12u);
}

TEST_F(SharedStoreTest, AnUploadInPartsThatIsRefusedGivesItsSpaceBack) {
  const std::vector<std::byte> mesh(2 * SharedStore::kPieceBytes);
  objects_.set_faults([count = 0](Call call, std::string_view) mutable {
    return call == Call::kPutPart && ++count == 2 ? Fault::kRefused : Fault::kNone;
  });
  const auto published = Publish(mesh);
  ASSERT_FALSE(published.ok());
  EXPECT_EQ(published.error().code, ErrorCode::kStoreFull);
  EXPECT_EQ(objects_.unfinished_uploads(), 0u);
  EXPECT_FALSE(Exists(IdOf(mesh)));
}

TEST_F(SharedStoreTest, BuffersHaveNoMorePartsThanAStoreTakes) {
  EXPECT_EQ(SharedStore::BufferBytes(0), 0u);
  EXPECT_EQ(SharedStore::BufferBytes(100), 100u);
  EXPECT_EQ(SharedStore::BufferBytes(SharedStore::kPieceBytes + 1), SharedStore::kPieceBytes);
  const std::uint64_t large = std::uint64_t{4} << 40;
  const std::uint64_t part = SharedStore::BufferBytes(large);
  EXPECT_LE((large + part - 1) / part, core::ObjectStore::kMostParts);
}

}  // namespace
}  // namespace kdray::test
