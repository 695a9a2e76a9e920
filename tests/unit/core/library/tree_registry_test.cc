// SPDX-License-Identifier: Apache-2.0
// The state machine of trees, event by event, without disk, threads or waiting.
#include "core/library/tree_registry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <map>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/triangle_mesh.h"

namespace kdray::core {
namespace {

using std::chrono::minutes;
using std::chrono::seconds;
using testing::ElementsAre;
using testing::IsEmpty;

Sha256Digest MeshOf(int number) {
  Sha256Digest mesh;
  mesh.bytes[0] = static_cast<std::uint8_t>(number);
  return mesh;
}

// A registry with a clock that the test moves, and tasks that are not run.
class TreeRegistryTest : public testing::Test {
 protected:
  using Need = TreeRegistry::Need;
  using Clock = TreeRegistry::Clock;

  TreeRegistryTest() { Reset(); }
  void Reset() {
    started_.clear();
    now_ = Clock::time_point(minutes(1000));
    TreeRegistry::Rules rules;
    rules.keep_failure = minutes(10);
    rules.retry_after = seconds(10);
    rules.max_failures = 3;
    registry_ = std::make_unique<TreeRegistry>(
        rules,
        [this](const std::shared_ptr<TreeTask>& task) {
          if (refuse_start_) throw std::bad_alloc();
          started_.push_back(task);
        },
        [this] { return now_; });
  }

  static TreeRecord DueRecord(const TreeId& id) {
    TreeRecord record;
    record.id = id;
    record.created_ms = 1000;
    record.mesh_bytes = 77;
    return record;
  }
  static TreeRecord ReadyRecord(const TreeId& id) {
    TreeRecord record = DueRecord(id);
    record.mesh = MeshFacts{};
    record.mesh->triangles = 100;
    record.tree = TreeFacts{};
    record.tree->build = id.build.value_or(BuildKind::kKdSah);
    return record;
  }
  void Add(const TreeId& id, MemoryCharge admission = {}) {
    registry_->Add(TreeRegistry::NewTree(DueRecord(id)), std::move(admission));
  }
  const TreeTask& LastTask() { return *started_.back(); }
  static LoadedScene Loaded(bool was_built, BuildKind build = BuildKind::kBvh) {
    LoadedScene loaded;
    MeshData data;
    data.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    data.triangles = {{0, 1, 2}};
    ParsedMesh parsed{MeshFacts{}, TriangleMesh::Create(data).value()};
    parsed.facts.triangles = 100;
    loaded.parsed = std::make_shared<const ParsedMesh>(std::move(parsed));
    loaded.scene.tree = std::make_shared<Tree>();
    loaded.tree.build = build;
    loaded.tree.build_ms = 5;
    loaded.was_built = was_built;
    return loaded;
  }
  // As TreeBuilder does.
  bool Fail(const TreeTask& task, ErrorCode code) {
    auto failure = registry_->Judge(task, Error{code, "why"});
    if (!failure) return false;
    const TreeId id = task.id;
    if (failure->is_for_good()) {
      Error told = failure->TakeError();
      registry_->FailForGood(*std::move(failure));
      EXPECT_TRUE(registry_->Remove(id, std::move(told)).has_value());
    } else {
      registry_->FailForNow(task, *std::move(failure));
    }
    return true;
  }

  // Brings kId into a state, by events alone.
  void Reach(const std::string& state) {
    Reset();
    if (state == "absent") return;
    if (state == "failed") {
      Add(kId);
      ASSERT_TRUE(Fail(LastTask(), ErrorCode::kInvalidMesh));
    } else if (state == "due") {
      TreeRecord record = DueRecord(kId);
      record.resumed = 2;
      registry_->Adopt({record}, {});
    } else if (state == "building") {
      Add(kId);
    } else if (state == "due, failed") {
      Add(kId);
      ASSERT_TRUE(Fail(LastTask(), ErrorCode::kMemoryFull));
    } else if (state == "ready" || state == "loading" || state == "ready, failed") {
      registry_->Adopt({ReadyRecord(kId)}, {});
      if (state == "ready") return;
      ASSERT_TRUE(registry_->Ask(kId, Need::kInMemory).ok());
      if (state == "loading") return;
      ASSERT_TRUE(Fail(LastTask(), ErrorCode::kMemoryFull));
    }
  }
  // The state of kId. Asks at last, which may start a task: call it once.
  std::string State() {
    const auto recorded = registry_->FindRecord(kId);
    if (!recorded) {
      return registry_->Check(kId).error().code == ErrorCode::kNotFound ? "absent" : "failed";
    }
    const bool is_ready = recorded->record.tree.has_value();
    if (registry_->IsAnyUnderWay()) return is_ready ? "loading" : "building";
    const std::string state = is_ready ? "ready" : "due";
    return registry_->Ask(kId, Need::kInMemory).ok() ? state : state + ", failed";
  }

  // What an event answers.
  std::string Do(const std::string& event) {
    if (event == "ask for the tree" || event == "ask for it in memory") {
      const std::size_t before = started_.size();
      const auto task =
          registry_->Ask(kId, event == "ask for the tree" ? Need::kReady : Need::kInMemory);
      if (!task.ok()) {
        return task.error().code == ErrorCode::kNotFound ? "not found" : "the failure";
      }
      if (*task == nullptr) return "ready";
      return started_.size() > before ? "a new task" : "the task";
    }
    if (event == "upload again") {
      if (registry_->FindRecord(kId)) {
        registry_->AddAgain(kId, {});
      } else {
        Add(kId);
      }
      return "";
    }
    if (event == "remove") {
      // As TreeLibrary::Delete does.
      if (registry_->ForgetFailure(kId)) return "forgotten";
      return registry_->Remove(kId, Error{ErrorCode::kNotFound, "gone"}) ? "removed" : "not found";
    }
    if (event == "the task succeeds") {
      return registry_->Succeed(LastTask(), Loaded(true)) ? "taken" : "refused";
    }
    if (event == "the task fails for now") {
      return Fail(LastTask(), ErrorCode::kMemoryFull) ? "taken" : "refused";
    }
    if (event == "the task fails for good") {
      return Fail(LastTask(), ErrorCode::kInvalidMesh) ? "taken" : "refused";
    }
    if (event == "10 seconds pass") {
      now_ += seconds(10);
      return "";
    }
    if (event == "10 minutes pass") {
      now_ += minutes(10);
      return "";
    }
    ADD_FAILURE() << "no event " << event;
    return "";
  }

  const TreeId kId{MeshOf(1), BuildKind::kBvh};
  bool refuse_start_ = false;
  Clock::time_point now_;
  std::vector<std::shared_ptr<TreeTask>> started_;
  std::unique_ptr<TreeRegistry> registry_;
};

TEST_F(TreeRegistryTest, EachStateIsReachedByEvents) {
  for (const char* state : {"absent", "failed", "due", "building", "due, failed", "ready",
                            "loading", "ready, failed"}) {
    Reach(state);
    EXPECT_EQ(State(), state);
  }
}

TEST_F(TreeRegistryTest, EachEventInEachStateHasOneOutcome) {
  struct Row {
    const char* state;
    const char* event;
    const char* answer;
    const char* next;
  };
  const Row rows[] = {
      {"absent", "ask for the tree", "not found", "absent"},
      {"absent", "upload again", "", "building"},
      {"absent", "remove", "not found", "absent"},

      {"failed", "ask for the tree", "the failure", "failed"},
      {"failed", "ask for it in memory", "the failure", "failed"},
      {"failed", "upload again", "", "building"},
      {"failed", "remove", "forgotten", "absent"},
      {"failed", "10 seconds pass", "", "failed"},
      {"failed", "10 minutes pass", "", "absent"},

      {"due", "ask for the tree", "a new task", "building"},
      {"due", "ask for it in memory", "a new task", "building"},
      {"due", "upload again", "", "building"},
      {"due", "remove", "removed", "absent"},

      {"building", "ask for the tree", "the task", "building"},
      {"building", "ask for it in memory", "the task", "building"},
      {"building", "upload again", "", "building"},
      {"building", "remove", "removed", "absent"},
      {"building", "the task succeeds", "taken", "ready"},
      {"building", "the task fails for now", "taken", "due, failed"},
      {"building", "the task fails for good", "taken", "failed"},

      {"due, failed", "ask for the tree", "the failure", "due, failed"},
      {"due, failed", "ask for it in memory", "the failure", "due, failed"},
      {"due, failed", "upload again", "", "building"},
      {"due, failed", "remove", "removed", "absent"},
      {"due, failed", "10 seconds pass", "", "due"},
      {"due, failed", "the task succeeds", "refused", "due, failed"},
      {"due, failed", "the task fails for good", "refused", "due, failed"},

      {"ready", "ask for the tree", "ready", "ready"},
      {"ready", "ask for it in memory", "a new task", "loading"},
      {"ready", "upload again", "", "ready"},
      {"ready", "remove", "removed", "absent"},

      {"loading", "ask for the tree", "ready", "loading"},
      {"loading", "ask for it in memory", "the task", "loading"},
      {"loading", "upload again", "", "loading"},
      {"loading", "remove", "removed", "absent"},
      {"loading", "the task succeeds", "taken", "ready"},
      {"loading", "the task fails for now", "taken", "ready, failed"},
      {"loading", "the task fails for good", "taken", "ready, failed"},

      {"ready, failed", "ask for the tree", "ready", "ready, failed"},
      {"ready, failed", "ask for it in memory", "the failure", "ready, failed"},
      {"ready, failed", "upload again", "", "ready"},
      {"ready, failed", "10 seconds pass", "", "ready"},
  };
  for (const Row& row : rows) {
    SCOPED_TRACE(std::string(row.state) + ": " + row.event);
    Reach(row.state);
    EXPECT_EQ(Do(row.event), row.answer);
    EXPECT_EQ(State(), row.next);
  }
}

TEST_F(TreeRegistryTest, EveryEndOfATaskIsToldToThoseWhoWait) {
  struct Row {
    const char* event;
    std::optional<ErrorCode> error;
  };
  for (const Row& row : {Row{"the task succeeds", std::nullopt},
                         Row{"the task fails for now", ErrorCode::kMemoryFull},
                         Row{"the task fails for good", ErrorCode::kInvalidMesh},
                         Row{"remove", ErrorCode::kNotFound}}) {
    SCOPED_TRACE(row.event);
    Reach("building");
    const auto waits = registry_->Ask(kId, Need::kReady).value();
    EXPECT_FALSE(waits->Wait(std::chrono::steady_clock::now(), {}));
    Do(row.event);
    ASSERT_TRUE(waits->Wait(std::chrono::steady_clock::now(), {}));
    EXPECT_EQ(waits->scene().has_value(), !row.error.has_value());
    ASSERT_EQ(waits->error().has_value(), row.error.has_value());
    if (row.error) {
      EXPECT_EQ(waits->error()->code, *row.error);
    }
  }
}

TEST_F(TreeRegistryTest, EventsOfATaskThatWasEndedChangeNothing) {
  Reach("building");
  const std::shared_ptr<TreeTask> old = started_.back();
  registry_->Remove(kId, Error{ErrorCode::kNotFound, "gone"});
  EXPECT_TRUE(old->watch.cancel.ShouldStop());
  Add(kId);
  MeshFacts facts;
  facts.triangles = 5;
  registry_->NoteParsed(*old, facts);
  EXPECT_FALSE(registry_->Info(kId)->record.mesh.has_value());
  EXPECT_FALSE(registry_->RecordOf(*old).has_value());
  EXPECT_FALSE(registry_->NoteResumed(*old, 9));
  EXPECT_FALSE(registry_->NoteResumeRefused(*old));
  EXPECT_FALSE(registry_->Succeed(*old, Loaded(true)));
  registry_->GiveUp(*old, Error{ErrorCode::kInternal, "why"});
  EXPECT_EQ(registry_->FindRecord(kId)->record.resumed, 0u);
  EXPECT_EQ(State(), "building");
}

TEST_F(TreeRegistryTest, AfterAShutdownNothingStarts) {
  Reach("building");
  const std::shared_ptr<TreeTask> task = started_.back();
  registry_->Shutdown();
  ASSERT_TRUE(task->Wait(std::chrono::steady_clock::now(), {}));
  EXPECT_EQ(task->error()->code, ErrorCode::kCancelled);
  EXPECT_TRUE(task->watch.cancel.ShouldStop());
  EXPECT_EQ(registry_->Ask(kId, Need::kReady).error().code, ErrorCode::kCancelled);
  registry_->AddAgain(kId, {});
  Add({MeshOf(2), std::nullopt});
  EXPECT_EQ(started_.size(), 1u);
  EXPECT_EQ(registry_->counts().trees, 2u) << "what was recorded is there";
}

TEST_F(TreeRegistryTest, ATaskThatCannotBeHandedOverIsNotUnderWay) {
  Reach("due");
  refuse_start_ = true;
  EXPECT_THROW((void)registry_->Ask(kId, Need::kReady), std::bad_alloc);
  EXPECT_THROW(Add({MeshOf(2), std::nullopt}), std::bad_alloc);
  EXPECT_FALSE(registry_->IsAnyUnderWay());
  EXPECT_EQ(registry_->counts().trees, 2u) << "its record is on disk";
  refuse_start_ = false;
  EXPECT_EQ(State(), "due");
}

TEST_F(TreeRegistryTest, AnAdmissionIsGivenBackWhenItsTaskEnds) {
  for (const char* event :
       {"the task succeeds", "the task fails for now", "the task fails for good", "remove"}) {
    MemoryBudget budget(100);
    Reset();
    Add(kId, *budget.TryReserve(60));
    EXPECT_EQ(budget.used(), 60u);
    Do(event);
    EXPECT_EQ(budget.used(), 0u) << event;
  }
}

TEST_F(TreeRegistryTest, AStartResumesWhatIsDueUntilTwoStartsHaveTried) {
  for (std::uint32_t resumed = 0; resumed < 4; ++resumed) {
    Reset();
    TreeRecord record = DueRecord(kId);
    record.resumed = resumed;
    registry_->Adopt({record, ReadyRecord({MeshOf(2), BuildKind::kBox})}, {});
    ASSERT_EQ(started_.size(), resumed < 2 ? 1u : 0u);
    if (resumed < 2) {
      EXPECT_EQ(LastTask().kind, TreeTask::Kind::kResume);
    }
  }
}

TEST_F(TreeRegistryTest, AResumedBuildWithoutANoteGoesOnOnlyForThoseWhoAsk) {
  for (const char* event : {"", "ask for the tree", "ask for it in memory", "upload again"}) {
    Reset();
    registry_->Adopt({DueRecord(kId)}, {});
    if (*event != 0) Do(event);
    EXPECT_EQ(registry_->NoteResumeRefused(LastTask()), *event != 0) << event;
    EXPECT_EQ(registry_->IsAnyUnderWay(), *event != 0);
    EXPECT_EQ(State(), *event != 0 ? "building" : "due");
  }
}

TEST_F(TreeRegistryTest, ATreeThatIsReadyWasResumedByNobody) {
  TreeRecord record = DueRecord(kId);
  record.resumed = 1;
  registry_->Adopt({record}, {});
  EXPECT_TRUE(registry_->NoteResumed(LastTask(), 2));
  EXPECT_EQ(registry_->FindRecord(kId)->record.resumed, 2u);
  EXPECT_TRUE(registry_->Succeed(LastTask(), Loaded(true)));
  EXPECT_EQ(registry_->FindRecord(kId)->record.resumed, 0u);
}

TEST_F(TreeRegistryTest, ATooLargeMeshGoesOnlyIfItIsNew) {
  Reach("building");
  EXPECT_TRUE(Fail(LastTask(), ErrorCode::kMeshTooLarge));
  EXPECT_EQ(State(), "failed");
  Reset();
  registry_->Adopt({DueRecord(kId)}, {});
  EXPECT_TRUE(Fail(LastTask(), ErrorCode::kMeshTooLarge));
  EXPECT_EQ(State(), "due, failed") << "the limit may have been lowered";
}

TEST_F(TreeRegistryTest, ARebuildIsABuildOfWhatWasReady) {
  Reach("building");
  registry_->Succeed(LastTask(), Loaded(true));
  EXPECT_EQ(registry_->counts().rebuilds, 0u);
  ASSERT_TRUE(registry_->Ask(kId, Need::kInMemory).ok());
  registry_->Succeed(LastTask(), Loaded(false));
  EXPECT_EQ(registry_->counts().rebuilds, 0u);
  ASSERT_TRUE(registry_->Ask(kId, Need::kInMemory).ok());
  registry_->Succeed(LastTask(), Loaded(true));
  EXPECT_EQ(registry_->counts().rebuilds, 1u);
}

TEST_F(TreeRegistryTest, ATreeThatWasThereUnderAnotherIdTellsItsBuildTime) {
  const TreeId automatic{kId.mesh, std::nullopt};
  TreeRecord ready = ReadyRecord(kId);
  ready.tree->build_ms = 42;
  registry_->Adopt({ready}, {});
  Add(automatic);
  registry_->Succeed(LastTask(), Loaded(false, BuildKind::kBvh));
  EXPECT_EQ(registry_->Info(automatic)->record.tree->build_ms, 42);
}

TEST_F(TreeRegistryTest, RemovingSaysWhatNoOtherTreeNeeds) {
  const TreeId automatic{kId.mesh, std::nullopt};
  const TreeId same{kId.mesh, BuildKind::kKdSah};
  registry_->Adopt({ReadyRecord(kId), ReadyRecord(automatic), ReadyRecord(same)}, {kId.mesh});
  const Error gone{ErrorCode::kNotFound, "gone"};
  auto removed = registry_->Remove(automatic, gone);
  EXPECT_FALSE(removed->mesh_too);
  EXPECT_EQ(removed->build, std::nullopt) << "kd-sah has the same tree";
  removed = registry_->Remove(same, gone);
  EXPECT_FALSE(removed->mesh_too);
  EXPECT_EQ(removed->build, BuildKind::kKdSah);
  EXPECT_TRUE(registry_->WantedOf(kId.mesh).Has(BuildKind::kBvh));
  EXPECT_FALSE(registry_->WantedOf(kId.mesh).Has(BuildKind::kKdSah));
  EXPECT_EQ(registry_->counts().damaged_meshes, 1u);
  removed = registry_->Remove(kId, gone);
  EXPECT_TRUE(removed->mesh_too);
  EXPECT_FALSE(registry_->HasMesh(kId.mesh));
  EXPECT_EQ(registry_->counts().damaged_meshes, 0u);
}

TEST_F(TreeRegistryTest, ARecordIsInDoubtFromTheBeginningOfARemovalUntilItIsWritten) {
  Reach("ready");
  EXPECT_EQ(registry_->BeginRemoval(kId), ReadyRecord(kId));
  EXPECT_TRUE(registry_->FindRecord(kId)->is_in_doubt);
  registry_->EndRemoval(kId, true);
  EXPECT_TRUE(registry_->FindRecord(kId)->is_in_doubt);
  registry_->AddAgain(kId, {});
  EXPECT_FALSE(registry_->FindRecord(kId)->is_in_doubt);
  (void)registry_->BeginRemoval(kId);
  registry_->EndRemoval(kId, false);
  EXPECT_FALSE(registry_->FindRecord(kId)->is_in_doubt);
  EXPECT_EQ(registry_->BeginRemoval({MeshOf(2), std::nullopt}), std::nullopt);
}

TEST_F(TreeRegistryTest, MeshesAreKnownByTheirTrees) {
  EXPECT_FALSE(registry_->FindMesh(kId.mesh).has_value());
  EXPECT_FALSE(registry_->NoteMeshDamaged(kId.mesh));
  Reach("ready");
  EXPECT_TRUE(registry_->HasSoundMesh(kId.mesh));
  EXPECT_EQ(registry_->FindMesh(kId.mesh)->bytes, 77u);
  EXPECT_TRUE(registry_->NoteMeshDamaged(kId.mesh));
  EXPECT_TRUE(registry_->HasMesh(kId.mesh));
  EXPECT_FALSE(registry_->HasSoundMesh(kId.mesh));
  registry_->NoteMeshStored(kId.mesh, 78);
  EXPECT_TRUE(registry_->HasSoundMesh(kId.mesh));
  EXPECT_EQ(registry_->FindMesh(kId.mesh)->bytes, 78u);
}

TEST_F(TreeRegistryTest, AMeshIsIdleWhenNoTaskOfItsTreesIsUnderWay) {
  const TreeId other{kId.mesh, BuildKind::kBox};
  registry_->Adopt({ReadyRecord(kId), ReadyRecord(other)}, {});
  EXPECT_EQ(registry_->IdleTreesOf(kId.mesh)->size(), 2u);
  EXPECT_TRUE(registry_->IdleTreesOf(MeshOf(2))->empty());
  EXPECT_THAT(registry_->MeshesUnderWay(), IsEmpty());
  ASSERT_TRUE(registry_->Ask(other, Need::kInMemory).ok());
  EXPECT_EQ(registry_->IdleTreesOf(kId.mesh), std::nullopt);
  EXPECT_THAT(registry_->MeshesUnderWay(), ElementsAre(kId.mesh));
}

TEST_F(TreeRegistryTest, ListsTheNewestFirstAndGoesOnAfterAPosition) {
  std::vector<TreeRecord> records;
  for (int i = 1; i <= 5; ++i) {
    records.push_back(ReadyRecord({MeshOf(i), BuildKind::kBvh}));
    records.back().created_ms = i / 2;  // two at one time
  }
  registry_->Adopt(records, {});
  std::vector<TreeId> all;
  std::optional<TreePosition> after;
  for (;;) {
    const auto page = registry_->List(std::nullopt, after, 2);
    if (page.empty()) break;
    for (const TreeInfo& info : page) all.push_back(info.record.id);
    after = TreePosition{page.back().record.created_ms, page.back().record.id};
  }
  ASSERT_EQ(all.size(), 5u);
  for (std::size_t i = 0; i < 5; ++i) EXPECT_EQ(all[i].mesh, MeshOf(static_cast<int>(5 - i)));
  EXPECT_EQ(registry_->List(MeshOf(3), std::nullopt, 9).size(), 1u);
}

TEST_F(TreeRegistryTest, KeepsABoundedNumberOfFailures) {
  for (int i = 1; i <= 5; ++i) {
    Add({MeshOf(i), std::nullopt});
    EXPECT_TRUE(Fail(LastTask(), ErrorCode::kInvalidMesh));
  }
  int kept = 0;
  for (int i = 1; i <= 5; ++i) {
    kept += registry_->Check({MeshOf(i), std::nullopt}).error().code == ErrorCode::kInvalidMesh;
  }
  EXPECT_EQ(kept, 3);
  EXPECT_EQ(registry_->Check({MeshOf(5), std::nullopt}).error().code, ErrorCode::kInvalidMesh)
      << "the latest is kept";
}

}  // namespace
}  // namespace kdray::core
