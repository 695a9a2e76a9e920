// SPDX-License-Identifier: Apache-2.0
// Two libraries on one store get the same uploads, deletions and queries in random order, while the
// store fails at random and libraries start again: against a model of what was acknowledged.
#include <gtest/gtest.h>

#include <cstdlib>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "tests/support/seed.h"
#include "tests/unit/core/library/shared_fixture.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::ErrorCode;
using core::TreeId;
using Fault = MemoryObjectStore::Fault;
using Call = MemoryObjectStore::Call;

std::vector<std::byte> TetrahedronBytes(int number) {
  const std::string x = std::to_string(1 + number);
  return Bytes("OFF\n4 4 0\n0 0 0\n" + x + " 0 0\n0 1 0\n0 0 1\n" +
               "3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n");
}

// What must be true of an id.
enum class Is { kAbsent, kThere, kUnknown };

class SharedModelTest : public SharedLibraryTest {
 protected:
  static constexpr int kMeshes = 4;

  SharedModelTest() {
    OpenBoth();
    for (int mesh = 0; mesh < kMeshes; ++mesh) {
      meshes_.push_back(TetrahedronBytes(mesh));
      for (const auto build : {std::optional<BuildKind>(), std::optional(BuildKind::kBvh)}) {
        ids_.push_back({DigestOf(meshes_.back()), build});
        model_[ids_.back()] = Is::kAbsent;
      }
    }
    // What a library without a store answers.
    SimulatedDisk disk;
    core::LibraryOptions options;
    options.data_dir = "data";
    options.file_system = &disk;
    auto alone = core::TreeLibrary::Open(options);
    for (std::size_t i = 0; i < ids_.size(); ++i) {
      EXPECT_TRUE(Upload(alone->get(), meshes_[i / 2], ids_[i].build).ok());
      expected_[ids_[i]] = AnswersOf(alone->get(), ids_[i]);
    }
  }

  // A write that failed may be carried out, now or later; here now at the latest.
  void NoteFailure(const TreeId& id, const core::Error& error) {
    ASSERT_TRUE(has_faults_) << error.message;
    model_[id] = Is::kUnknown;
    objects_.set_faults(nullptr);
    objects_.DeliverLate(id.mesh.ToHex());
  }

  void UploadAt(std::size_t library_index, std::size_t i) {
    const TreeId& id = ids_[i];
    const auto added = Upload(&library(library_index), meshes_[i / 2], id.build);
    if (!added.ok()) return NoteFailure(id, added.error());
    EXPECT_EQ(added->id, id);
    if (model_[id] != Is::kUnknown && !has_faults_) {
      EXPECT_EQ(added->existed, model_[id] == Is::kThere);
    }
    model_[id] = Is::kThere;
  }
  void BuildAt(std::size_t library_index, std::size_t i) {
    const TreeId& id = ids_[i];
    const Is other = model_[ids_[i ^ 1]];
    const auto added = library(library_index).AddBuild(id.mesh, id.build);
    if (added.ok()) {
      EXPECT_FALSE(model_[id] == Is::kAbsent && other == Is::kAbsent);
      model_[id] = Is::kThere;
    } else if (added.error().code == ErrorCode::kNotFound) {
      EXPECT_NE(model_[id], Is::kThere);
      EXPECT_NE(other, Is::kThere);
    } else {
      NoteFailure(id, added.error());
    }
  }
  void DeleteAt(std::size_t library_index, std::size_t i) {
    const TreeId& id = ids_[i];
    const core::Status deleted = library(library_index).Delete(id);
    if (deleted.ok()) {
      EXPECT_NE(model_[id], Is::kAbsent);
    } else if (deleted.error().code == ErrorCode::kNotFound) {
      // Of a deletion whose answers were lost, the repetition may find nothing.
      EXPECT_TRUE(model_[id] != Is::kThere || has_faults_);
    } else {
      return NoteFailure(id, deleted.error());
    }
    model_[id] = Is::kAbsent;
  }
  void QueryAt(std::size_t library_index, std::size_t i) {
    const TreeId& id = ids_[i];
    const auto scene = library(library_index).Load(id, Soon());
    if (scene.ok()) {
      // While the store is away, known trees are served.
      EXPECT_TRUE(model_[id] != Is::kAbsent || has_faults_) << "deleted, and still served";
      EXPECT_EQ(Answers(*scene), expected_[id]);
    } else if (scene.error().code == ErrorCode::kNotFound) {
      EXPECT_NE(model_[id], Is::kThere) << "an acknowledged mesh is lost";
    } else {
      EXPECT_TRUE(has_faults_) << scene.error().message;
    }
  }
  void ListAt(std::size_t library_index) {
    const auto trees = library(library_index).ListAll(std::nullopt, std::nullopt, 100);
    if (!trees.ok()) {
      EXPECT_TRUE(has_faults_) << trees.error().message;
      return;
    }
    std::map<TreeId, int> listed;
    for (const core::TreeInfo& info : *trees) ++listed[info.record.id];
    for (const TreeId& id : ids_) {
      if (model_[id] == Is::kAbsent) {
        EXPECT_EQ(listed[id], 0);
      } else if (model_[id] == Is::kThere) {
        EXPECT_EQ(listed[id], 1);
      }
    }
  }
  void SetFaults(std::uint64_t seed) {
    has_faults_ = true;
    objects_.set_faults([random = std::make_shared<std::mt19937_64>(seed),
                         mutex = std::make_shared<std::mutex>()](Call call, std::string_view) {
      const std::lock_guard lock(*mutex);
      const bool is_write = call == Call::kPut || call == Call::kDelete;
      switch ((*random)() % 12) {
        case 0:
        case 1:
          return Fault::kAway;
        case 2:
          return Fault::kLostAnswer;
        case 3:
          return is_write ? Fault::kLate : Fault::kAltered;
        case 4:
          return Fault::kTruncated;
        default:
          return Fault::kNone;
      }
    });
  }

  std::vector<std::vector<std::byte>> meshes_;
  std::vector<TreeId> ids_;  // two of each mesh
  std::map<TreeId, std::vector<core::Hit>> expected_;
  std::map<TreeId, Is> model_;
  bool has_faults_ = false;
};

TEST_F(SharedModelTest, NoAnswerIsWrongAndNoAcknowledgedMeshIsLost) {
  const char* const text = std::getenv("KDRAY_STEPS");
  const int steps = text != nullptr ? std::atoi(text) : 10'000;
  std::mt19937_64 random = RandomEngine(77);
  for (int step = 0; step < steps && !HasFailure(); ++step) {
    SCOPED_TRACE("step " + std::to_string(step));
    has_faults_ = false;
    objects_.set_faults(nullptr);
    if (random() % 4 == 0) SetFaults(random());
    const std::size_t at = random() % kLibraries;
    const std::size_t i = random() % ids_.size();
    switch (random() % 16) {
      case 0:
      case 1:
      case 2:
        UploadAt(at, i);
        break;
      case 3:
        BuildAt(at, i);
        break;
      case 4:
      case 5:
      case 6:
        DeleteAt(at, i);
        break;
      case 7:
        ListAt(at);
        break;
      case 8:
        if (random() % 20 == 0) {
          Open(at);
        } else if (random() % 4 == 0) {
          objects_.DeliverLate();  // of calls whose repetition succeeded
        }
        break;
      default:
        QueryAt(at, i);
        break;
    }
  }
  has_faults_ = false;
  objects_.set_faults(nullptr);
  objects_.DeliverLate();
  for (std::size_t at = 0; at < kLibraries; ++at) {
    for (std::size_t i = 0; i < ids_.size(); ++i) QueryAt(at, i);
    ListAt(at);
  }
}

}  // namespace
}  // namespace kdray::test
