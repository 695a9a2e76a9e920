// SPDX-License-Identifier: Apache-2.0
#include "core/store/shared_store.h"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <limits>
#include <random>
#include <set>
#include <utility>

#include "core/store/catalog.h"

namespace kdray::core {
namespace {

constexpr std::string_view kDeleted = "-deleted";
constexpr std::size_t kPage = 1000;
// Records have about a kilobyte.
constexpr std::uint64_t kMostRecordBytes = std::uint64_t{1} << 20;
constexpr std::size_t kDigitsOfTime = 12;  // of hexadecimal milliseconds
constexpr std::size_t kDigitsOfGeneration = 28;
// The age of a deletion after which no request can still be on its way: S3 refuses requests that
// are older than a quarter of an hour.
constexpr std::int64_t kKeepDeletionMs = 24LL * 3600 * 1000;

std::string Hex(std::uint64_t value, std::size_t digits) {
  std::string text(digits, '0');
  for (std::size_t i = digits; i-- > 0; value >>= 4) text[i] = "0123456789abcdef"[value & 15];
  return text;
}

std::optional<std::uint64_t> ParseHex(std::string_view text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, 16);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

// The time and 64 random bits.
std::string NewGeneration(std::int64_t now_ms) {
  std::random_device random;
  const std::uint64_t bits = (std::uint64_t{random()} << 32) ^ random();
  return Hex(static_cast<std::uint64_t>(now_ms), kDigitsOfTime) +
         Hex(bits, kDigitsOfGeneration - kDigitsOfTime);
}

bool IsGeneration(std::string_view text) {
  return text.size() == kDigitsOfGeneration && ParseHex(text.substr(0, kDigitsOfTime)) &&
         ParseHex(text.substr(kDigitsOfTime));
}

std::int64_t TimeOf(std::string_view generation) {
  return static_cast<std::int64_t>(ParseHex(generation.substr(0, kDigitsOfTime)).value_or(0));
}

std::string CatalogPrefix(const TreeId& id) { return "catalog/" + id.ToString() + "/"; }
std::string RecordKey(const TreeId& id, std::string_view generation) {
  return CatalogPrefix(id) + std::string(generation);
}
std::string DeletionKey(const TreeId& id, std::string_view generation) {
  return RecordKey(id, generation) + std::string(kDeleted);
}
std::string MeshPrefix(const Sha256Digest& mesh) { return "meshes/" + mesh.ToHex() + "/"; }
std::string MeshKey(const Sha256Digest& mesh, std::string_view generation) {
  return MeshPrefix(mesh) + std::string(generation);
}

// Newest first: keys are listed in ascending order.
constexpr std::string_view kByAge = "by-age/";
std::string AgePrefix(std::int64_t created_ms, const TreeId& id) {
  const std::uint64_t all = (std::uint64_t{1} << (4 * kDigitsOfTime)) - 1;
  return std::string(kByAge) +
         Hex(all - (static_cast<std::uint64_t>(created_ms) & all), kDigitsOfTime) + "/" +
         id.ToString();
}
std::string AgeKey(const TreeId& id, std::string_view generation) {
  return AgePrefix(TimeOf(generation), id) + "/" + std::string(generation);
}

// nullopt for a foreign object.
std::optional<SharedStore::Listed> ParseAgeKey(std::string_view key) {
  key.remove_prefix(std::min(key.size(), kByAge.size() + kDigitsOfTime + 1));
  const std::size_t slash = key.find('/');
  if (slash == std::string_view::npos) return std::nullopt;
  const std::optional<TreeId> id = ParseTreeId(key.substr(0, slash));
  const std::string_view generation = key.substr(slash + 1);
  if (!id || !IsGeneration(generation)) return std::nullopt;
  return SharedStore::Listed{TimeOf(generation), *id, std::string(generation)};
}

Error Corrupt(const char* what) {
  return Error{ErrorCode::kCorrupt, std::string("an object of the store ") + what};
}

}  // namespace

Status SharedStore::Check(const CancelToken& cancel) {
  const Result<ObjectPage> page = store_->List("catalog/", "", 1, cancel);
  return page.ok() ? Status() : Status(page.error());
}

Result<std::vector<ObjectInfo>> SharedStore::ListAll(std::string_view prefix,
                                                     const CancelToken& cancel) {
  std::vector<ObjectInfo> all;
  for (;;) {
    Result<ObjectPage> page =
        store_->List(prefix, all.empty() ? std::string_view() : all.back().key, kPage, cancel);
    if (!page.ok()) return std::move(page).error();
    std::move(page->objects.begin(), page->objects.end(), std::back_inserter(all));
    if (!page->has_more || page->objects.empty()) return all;
  }
}

Result<SharedStore::Generations> SharedStore::GenerationsOf(const TreeId& id,
                                                            const CancelToken& cancel) {
  const std::string prefix = CatalogPrefix(id);
  Generations generations;
  generations.seen = Clock::now();
  const Result<std::vector<ObjectInfo>> objects = ListAll(prefix, cancel);
  if (!objects.ok()) return objects.error();
  std::set<std::string, std::less<>> deleted;
  for (const ObjectInfo& object : *objects) {
    std::string_view name = std::string_view(object.key).substr(prefix.size());
    if (!name.ends_with(kDeleted)) continue;
    name.remove_suffix(kDeleted.size());
    deleted.emplace(name);
    if (IsGeneration(name) && store_->NowMs() - object.modified_ms > kKeepDeletionMs) {
      generations.old.emplace_back(name);
    }
  }
  for (const ObjectInfo& object : *objects) {
    const std::string_view name = std::string_view(object.key).substr(prefix.size());
    if (IsGeneration(name) && !deleted.contains(name))
      generations.live.push_back({std::string(name), object.bytes});
  }
  return generations;
}

Result<bool> SharedStore::Exists(const TreeId& id, const CancelToken& cancel) {
  const Result<Generations> generations = GenerationsOf(id, cancel);
  if (!generations.ok()) return generations.error();
  return !generations->live.empty();
}

Result<TreeRecord> SharedStore::ReadRecord(const TreeId& id, const std::string& generation,
                                           const CancelToken& cancel) {
  const Result<Generations> generations = GenerationsOf(id, cancel);
  if (!generations.ok()) return generations.error();
  // Two libraries may have uploaded the same at the same time: the first generation counts.
  if (generations->live.empty() || generations->live.front().generation != generation) {
    return Error{ErrorCode::kNotFound, "the tree was deleted"};
  }
  return ReadLive(id, generations->live.front(), cancel);
}

Result<TreeRecord> SharedStore::ReadLive(const TreeId& id, const Live& live,
                                         const CancelToken& cancel) {
  const std::string key = RecordKey(id, live.generation);
  std::uint64_t size = live.bytes;
  Result<TreeRecord> record = Corrupt("is no record");
  // A second time, because bytes may change on their way, and the record may be replaced by one of
  // another size.
  for (int attempt = 0; attempt < 2 && !record.ok(); ++attempt) {
    if (attempt != 0) {
      const Result<ObjectInfo> now = store_->Head(key, cancel);
      if (!now.ok()) return now.error();
      size = now->bytes;
    }
    if (size == 0 || size > kMostRecordBytes) continue;
    std::vector<std::byte> bytes(static_cast<std::size_t>(size));
    const Status got = store_->Get(key, 0, bytes, cancel);
    if (!got.ok() && got.error().code != ErrorCode::kCorrupt) return got.error();
    if (got.ok()) record = DecodeRecord(id, std::move(bytes));
  }
  if (!record.ok()) return record;
  record->created_ms = TimeOf(live.generation);
  record->resumed = 0;
  return record;
}

Result<std::optional<SharedStore::Found>> SharedStore::Find(const TreeId& id,
                                                            const CancelToken& cancel) {
  const Result<Generations> generations = GenerationsOf(id, cancel);
  if (!generations.ok()) return generations.error();
  for (const Live& live : generations->live) {
    Result<TreeRecord> record = ReadLive(id, live, cancel);
    if (!record.ok() && record.error().code == ErrorCode::kNotFound) continue;  // deleted meanwhile
    if (!record.ok()) return std::move(record).error();
    return std::optional<Found>(Found{*std::move(record), live.generation, generations->seen});
  }
  return std::optional<Found>();
}

Result<std::vector<TreeId>> SharedStore::IdsOf(const Sha256Digest& mesh,
                                               const CancelToken& cancel) {
  const std::string prefix = "catalog/" + mesh.ToHex() + "-";
  const Result<std::vector<ObjectInfo>> objects = ListAll(prefix, cancel);
  if (!objects.ok()) return objects.error();
  std::set<std::string, std::less<>> keys;
  for (const ObjectInfo& object : *objects) keys.insert(object.key);
  std::set<TreeId> ids;
  for (const std::string& key : keys) {
    const std::string_view path = std::string_view(key).substr(std::strlen("catalog/"));
    const std::size_t slash = path.find('/');
    if (slash == std::string_view::npos || !IsGeneration(path.substr(slash + 1))) continue;
    if (keys.contains(key + std::string(kDeleted))) continue;
    if (const std::optional<TreeId> id = ParseTreeId(path.substr(0, slash))) ids.insert(*id);
  }
  return std::vector<TreeId>(ids.begin(), ids.end());
}

Result<SharedStore::Published> SharedStore::Publish(TreeRecord record, const ReadableFile& mesh,
                                                    std::span<std::byte> buffer,
                                                    const CancelToken& cancel) {
  const TreeId id = record.id;
  Result<Generations> before = GenerationsOf(id, cancel);
  if (!before.ok()) return std::move(before).error();
  Forget(id, *before, cancel);
  for (const Live& live : before->live) {
    const std::string& generation = live.generation;
    Result<TreeRecord> found = ReadLive(id, live, cancel);
    if (!found.ok() && found.error().code == ErrorCode::kNotFound) continue;
    // The upload repairs a damaged record as it repairs a damaged mesh.
    if (!found.ok() && found.error().code != ErrorCode::kCorrupt) return std::move(found).error();
    if (Status status = RepairMesh(id, generation, mesh, buffer, cancel); !status.ok()) {
      return std::move(status).error();
    }
    if (!found.ok()) {
      Status status =
          store_->Put(RecordKey(id, generation), EncodeRecord(record), PutMode::kReplace, cancel);
      if (!status.ok()) return std::move(status).error();
      record.created_ms = TimeOf(generation);
      found = record;
    }
    return Published{{*std::move(found), generation, before->seen}, true};
  }

  const std::int64_t now_ms = store_->NowMs();
  const std::string generation = NewGeneration(now_ms);
  record.created_ms = now_ms;
  Status status = PutFile(MeshKey(id.mesh, generation), mesh, buffer, PutMode::kReplace, cancel);
  // Before the record: a tree that exists is in the list.
  if (status.ok()) status = store_->Put(AgeKey(id, generation), {}, PutMode::kReplace, cancel);
  const Clock::time_point seen = Clock::now();
  if (status.ok()) {
    status =
        store_->Put(RecordKey(id, generation), EncodeRecord(record), PutMode::kReplace, cancel);
  }
  if (!status.ok()) return std::move(status).error();
  // Another library may have done the same meanwhile. Then both generations stay until the tree is
  // deleted: to withdraw one is not safe beside a deletion of the other.
  return Published{{std::move(record), generation, seen}, false};
}

// Whoever uploads a mesh again may do so because its copy is lost.
Status SharedStore::RepairMesh(const TreeId& id, const std::string& generation,
                               const ReadableFile& mesh, std::span<std::byte> buffer,
                               const CancelToken& cancel) {
  const std::string key = MeshKey(id.mesh, generation);
  const Result<ObjectInfo> stored = store_->Head(key, cancel);
  if (stored.ok() && stored->bytes == mesh.size()) return {};
  if (!stored.ok() && stored.error().code != ErrorCode::kNotFound) return stored.error();
  return PutFile(key, mesh, buffer, PutMode::kReplace, cancel);
}

Status SharedStore::Withdraw(const TreeId& id, const std::string& generation,
                             const CancelToken& cancel) {
  Status status = store_->Put(DeletionKey(id, generation), {}, PutMode::kReplace, cancel);
  if (status.ok()) Clean(id, generation, cancel);
  return status;
}

Result<bool> SharedStore::Remove(const TreeId& id, const CancelToken& cancel) {
  const Result<Generations> generations = GenerationsOf(id, cancel);
  if (!generations.ok()) return generations.error();
  Forget(id, *generations, cancel);
  for (const Live& live : generations->live) {
    if (Status status = Withdraw(id, live.generation, cancel); !status.ok()) {
      return std::move(status).error();
    }
  }
  if (!generations->live.empty()) CleanTrees(id.mesh, cancel);
  return !generations->live.empty();
}

// Removes what belongs to a deleted generation. What remains after a failure is in nobody's way.
void SharedStore::Clean(const TreeId& id, const std::string& generation,
                        const CancelToken& cancel) {
  (void)store_->Delete(AgeKey(id, generation), cancel);
  (void)store_->Delete(RecordKey(id, generation), cancel);
  (void)store_->Delete(MeshKey(id.mesh, generation), cancel);
}

// Derived files, so it does not matter that another replica may just need them.
void SharedStore::CleanTrees(const Sha256Digest& mesh, const CancelToken& cancel) {
  const Result<std::vector<TreeId>> ids = IdsOf(mesh, cancel);
  if (!ids.ok() || !ids->empty()) return;
  for (const BuildKind build : kAllBuildKinds) (void)store_->Delete(TreeKey(mesh, build), cancel);
}

// Removes deletions of long ago, with what may have come back since.
void SharedStore::Forget(const TreeId& id, const Generations& generations,
                         const CancelToken& cancel) {
  for (const std::string& generation : generations.old) {
    Clean(id, generation, cancel);
    (void)store_->Delete(DeletionKey(id, generation), cancel);
  }
}

Result<bool> SharedStore::Update(TreeRecord record, const CancelToken& cancel) {
  const Result<Generations> generations = GenerationsOf(record.id, cancel);
  if (!generations.ok()) return generations.error();
  if (generations->live.empty()) return false;
  const std::string& generation = generations->live.front().generation;
  record.created_ms = TimeOf(generation);
  record.resumed = 0;
  Status status = store_->Put(RecordKey(record.id, generation), EncodeRecord(record),
                              PutMode::kReplace, cancel);
  if (!status.ok()) return std::move(status).error();
  return true;
}

Result<SharedStore::ListedPage> SharedStore::List(
    const std::optional<std::pair<std::int64_t, TreeId>>& after, std::size_t limit,
    const CancelToken& cancel) {
  // After all generations of that id: '0' follows '/'.
  std::string position = after ? AgePrefix(after->first, after->second) + "0" : "";
  ListedPage listed;
  for (;;) {
    const Result<ObjectPage> page =
        store_->List(kByAge, position, std::clamp<std::size_t>(limit, 1, kPage), cancel);
    if (!page.ok()) return page.error();
    for (const ObjectInfo& object : page->objects) {
      if (listed.trees.size() == limit) {
        listed.has_more = true;
        return listed;
      }
      std::optional<Listed> entry = ParseAgeKey(object.key);
      if (entry) listed.trees.push_back(*std::move(entry));
      position = object.key;
    }
    if (!page->has_more || page->objects.empty()) return listed;
  }
}

}  // namespace kdray::core
