// SPDX-License-Identifier: Apache-2.0
// Lists of the trees of all libraries.
#include <algorithm>
#include <chrono>
#include <iterator>
#include <utility>

#include "core/library/shared_trees.h"

namespace kdray::core {
namespace {

// Poll interval; a CancelToken has no notification.
constexpr std::chrono::milliseconds kLookAgain{50};
constexpr std::size_t kPage = 1000;

}  // namespace

Result<std::vector<TreeInfo>> SharedTrees::List(const std::optional<Sha256Digest>& mesh,
                                                const std::optional<TreePosition>& after,
                                                std::size_t limit) {
  if (mesh) {
    Result<std::vector<TreeInfo>> trees = ListOf(*mesh);
    if (!trees.ok()) return trees;
    const auto is_before = [&](const TreeInfo& info) {
      return after && std::pair(-info.record.created_ms, info.record.id) <=
                          std::pair(-after->created_ms, after->id);
    };
    std::erase_if(*trees, is_before);
    if (trees->size() > limit) trees->resize(limit);
    return trees;
  }
  std::vector<TreeInfo> trees;
  std::optional<TreePosition> position = after;
  for (bool has_more = true; has_more && trees.size() < limit;) {
    Result<std::vector<SharedStore::Listed>> page =
        ListPage(position, std::min(kPage, limit - trees.size()), &has_more);
    if (!page.ok()) return Unanswered(page.error());
    if (page->empty()) break;
    position = TreePosition{page->back().created_ms, page->back().id};
    Result<std::vector<TreeInfo>> described = Describe(*std::move(page));
    if (!described.ok()) return Unanswered(described.error());
    std::move(described->begin(), described->end(), std::back_inserter(trees));
  }
  return trees;
}

Result<std::vector<SharedStore::Listed>> SharedTrees::ListPage(
    const std::optional<TreePosition>& after, std::size_t limit, bool* has_more) {
  std::optional<std::pair<std::int64_t, TreeId>> position;
  if (after) position.emplace(after->created_ms, after->id);
  Result<SharedStore::ListedPage> page = shared_.List(position, limit, stop_);
  if (!page.ok()) return std::move(page).error();
  *has_more = page->has_more;
  return std::move(page->trees);
}

// Reads the records side by side, because each takes the time of a request.
Result<std::vector<TreeInfo>> SharedTrees::Describe(std::vector<SharedStore::Listed> entries) {
  struct Answers {
    std::vector<SharedStore::Listed> entries;
    std::vector<std::optional<Result<TreeRecord>>> records;
    std::size_t pending = 0;
  };
  const auto answers = std::make_shared<Answers>();
  answers->entries = std::move(entries);
  answers->records.resize(answers->entries.size());
  answers->pending = answers->entries.size();
  for (std::size_t i = 0; i < answers->entries.size(); ++i) {
    lookup_queue_.Submit(answers->entries[i].id.mesh, WorkQueue::Lane::kBuild, [this, answers, i] {
      Result<TreeRecord> record = Error{ErrorCode::kMemoryFull, "out of memory"};
      try {
        record = shared_.ReadRecord(answers->entries[i].id, answers->entries[i].generation, stop_);
      } catch (...) {
      }
      const std::lock_guard lock(mutex_);
      answers->records[i] = std::move(record);
      --answers->pending;
      changed_.notify_all();
    });
  }
  {
    std::unique_lock lock(mutex_);
    while (answers->pending != 0) {
      if (stop_.ShouldStop()) return stop_.ToError();
      changed_.wait_for(lock, kLookAgain);
    }
  }
  std::vector<TreeInfo> trees;
  for (std::optional<Result<TreeRecord>>& record : answers->records) {
    if (!record->ok() && record->error().code == ErrorCode::kNotFound) continue;  // deleted
    if (!record->ok()) return record->error();
    // This library knows more of a build that it runs.
    TreeInfo info;
    info.record = std::move(record->value());
    const Result<TreeInfo> here = parts_.registry->Info(info.record.id);
    info.progress = info.ready() ? 1 : 0;
    if (!info.ready() && here.ok()) {
      info.progress = here->progress;
      info.record.mesh = here->record.mesh;
      info.record.tree = here->record.tree;
    }
    trees.push_back(std::move(info));
  }
  return trees;
}

Result<std::vector<TreeInfo>> SharedTrees::ListOf(const Sha256Digest& mesh) {
  const Result<std::vector<TreeId>> ids = shared_.IdsOf(mesh, stop_);
  if (!ids.ok()) return Unanswered(ids.error());
  std::vector<SharedStore::Listed> entries;
  for (const TreeId& id : *ids) {
    const auto found = shared_.Find(id, stop_);
    if (!found.ok()) return Unanswered(found.error());
    if (*found) entries.push_back({(*found)->record.created_ms, id, (*found)->generation});
  }
  using Listed = SharedStore::Listed;
  std::sort(entries.begin(), entries.end(), [](const Listed& a, const Listed& b) {
    return std::pair(-a.created_ms, a.id) < std::pair(-b.created_ms, b.id);
  });
  Result<std::vector<TreeInfo>> trees = Describe(std::move(entries));
  if (!trees.ok()) return Unanswered(trees.error());
  return trees;
}

}  // namespace kdray::core
