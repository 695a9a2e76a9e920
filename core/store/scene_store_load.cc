// SPDX-License-Identifier: Apache-2.0
// The start of SceneStore. It inspects everything before it changes anything, so a failed start
// leaves the data directory unchanged.
#include <algorithm>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>

#include "core/store/scene_store.h"

namespace kdray::core {
namespace {

bool IsDigest(const std::string& name) {
  Sha256Digest digest;
  return ParseSha256Hex(name, &digest);
}

// Whether a file of this group can have the name; other files are not ours and stay.
bool IsOurs(FileGroup group, const std::string& name) {
  return group == FileGroup::kTrees ? ParseTreeId(name).has_value() : IsDigest(name);
}

std::string DigestPart(const std::string& name) { return name.substr(0, 64); }

Error Refusal(const std::string& why) {
  return Error{ErrorCode::kCorrupt, why + "; nothing was changed"};
}

Error RefusalOf(std::string_view folder, const Error& error) {
  return Refusal("the folder " + std::string(folder) + ": " + error.message);
}

std::string Count(std::uint64_t count, const std::string& noun, const char* plural = "s") {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : plural);
}

constexpr FileGroup kGroupsOnDisk[] = {FileGroup::kMeshes, FileGroup::kParsed, FileGroup::kTrees,
                                       FileGroup::kMeasured};

constexpr std::string_view kCacheMark = "cache-of";
constexpr std::uint64_t kMostMarkBytes = 4096;

std::size_t IndexOf(FileGroup group) { return static_cast<std::size_t>(group); }

// One damaged file is possible; if most are missing, the disk or the owner is wrong.
bool IsTooMany(std::uint64_t unreadable, std::uint64_t all) {
  return unreadable >= 2 && unreadable > all - unreadable;
}

}  // namespace

Result<std::set<std::string_view>> SceneStore::MissingFolders() const {
  std::set<std::string_view> missing;
  std::set<std::string_view> folders(kFolders.begin(), kFolders.end());
  folders.insert(kCatalogFolder);
  for (const std::string_view folder : folders) {
    const Result<FolderInfo> info = file_system_->Examine(directory_ / folder);
    if (!info.ok() && info.error().code == ErrorCode::kNotFound) {
      missing.insert(folder);
    } else if (!info.ok()) {
      return RefusalOf(folder, info.error());
    } else if (info->owner != info->user) {
      return Refusal("the folder " + std::string(folder) + " belongs to user " +
                     std::to_string(info->owner) + ", but this process runs as user " +
                     std::to_string(info->user));
    }
  }
  return missing;
}

// The trees of a cache that are not in its store are taken for deleted. So a directory is the cache
// of one store from its first use on, and nothing else.
Status SceneStore::CheckCacheMark() {
  const auto file = file_system_->Open(directory_ / kCacheMark);
  if (!file.ok() && file.error().code == ErrorCode::kNotFound) return {};
  if (!file.ok()) return file.error();
  if ((*file)->size() > kMostMarkBytes) return Refusal("the file cache-of is too long");
  std::string name(static_cast<std::size_t>((*file)->size()), '\0');
  if (Status read = (*file)->ReadAt(0, std::as_writable_bytes(std::span(name))); !read.ok()) {
    return read;
  }
  is_marked_as_cache_ = true;
  if (name == cache_of_) return {};
  return Error{ErrorCode::kInvalidArgument,
               "it is the cache of the store " + name + ", not " +
                   (cache_of_.empty() ? "a store of its own" : "of " + cache_of_)};
}

Status SceneStore::MarkAsCache() {
  BlobStore root(file_system_, directory_);
  Result<NewBlob> blob = root.Create();
  if (!blob.ok()) return std::move(blob).error();
  if (Status written = blob->Append(std::as_bytes(std::span(cache_of_))); !written.ok()) {
    return written;
  }
  return blob->Commit(kCacheMark);
}

std::optional<std::string> SceneStore::WhyUnreadable(const Sha256Digest& mesh,
                                                     std::uint64_t bytes) const {
  const auto file = Blobs(FileGroup::kMeshes).Read(mesh.ToHex());
  if (!file.ok()) {
    return file.error().code == ErrorCode::kNotFound ? "it is missing" : file.error().message;
  }
  const std::uint64_t size = (*file)->size();
  if (bytes != 0 && size != bytes) {
    return "it has " + Count(size, "byte") + " instead of " + std::to_string(bytes);
  }
  return std::nullopt;
}

// The size of each mesh by its records; 0 if none of them can be read.
SceneStore::RecordedMeshes SceneStore::RecordedIn(const Catalog::Contents& catalog) {
  RecordedMeshes recorded;
  for (const TreeRecord& record : catalog.records) {
    std::uint64_t& bytes = recorded[record.id.mesh];
    bytes = std::max(bytes, record.mesh_bytes);
  }
  return recorded;
}

// A size that no record has is that of the file.
void SceneStore::CompleteSizes(const std::vector<FileInfo>& meshes, RecordedMeshes* recorded) {
  for (const FileInfo& file : meshes) {
    Sha256Digest mesh;
    if (!ParseSha256Hex(file.name, &mesh)) continue;
    const auto found = recorded->find(mesh);
    if (found != recorded->end() && found->second == 0) found->second = file.bytes;
  }
}

Result<std::set<Sha256Digest>> SceneStore::UnreadableMeshes(const RecordedMeshes& recorded) const {
  std::set<Sha256Digest> unreadable;
  std::string example;
  for (const auto& [mesh, bytes] : recorded) {
    const std::optional<std::string> why = WhyUnreadable(mesh, bytes);
    if (!why) continue;
    if (unreadable.empty()) example = mesh.ToHex() + ": " + *why;
    unreadable.insert(mesh);
  }
  if (IsTooMany(unreadable.size(), recorded.size())) {
    return Refusal(std::to_string(unreadable.size()) + " of " +
                   Count(recorded.size(), "recorded mesh", "es") + " cannot be read, among them " +
                   example);
  }
  return unreadable;
}

Result<SceneStore::Contents> SceneStore::Load() {
  const Result<std::set<std::string_view>> missing = MissingFolders();
  if (!missing.ok()) return missing.error();
  Catalog::Contents catalog;
  if (!missing->contains(kCatalogFolder)) {
    Result<Catalog::Contents> loaded = catalog_.Load();
    if (!loaded.ok()) return RefusalOf(kCatalogFolder, loaded.error());
    catalog = *std::move(loaded);
  }
  Files files;
  for (const FileGroup group : kGroupsOnDisk) {
    const std::string_view folder = kFolders[IndexOf(group)];
    if (missing->contains(folder)) continue;
    Result<std::vector<FileInfo>> listed = Blobs(group).List();
    if (!listed.ok()) return RefusalOf(folder, listed.error());
    files[IndexOf(group)] = *std::move(listed);
  }

  RecordedMeshes recorded = RecordedIn(catalog);
  if (!missing->empty() && !recorded.empty()) {
    const std::string_view folder = *missing->begin();
    const bool is_derived = folder != kFolders[IndexOf(FileGroup::kMeshes)];
    return Refusal(
        "the folder " + std::string(folder) + " is missing, but the catalog names " +
        Count(recorded.size(), "mesh", "es") +
        (is_derived ? " (its files can be made again; make an empty folder in its place)" : ""));
  }
  const std::vector<FileInfo>& meshes = files[IndexOf(FileGroup::kMeshes)];
  CompleteSizes(meshes, &recorded);
  const auto stored = static_cast<std::uint64_t>(std::count_if(
      meshes.begin(), meshes.end(), [](const FileInfo& file) { return IsDigest(file.name); }));
  if (missing->contains(kCatalogFolder) && stored != 0) {
    return Refusal("the folder " + std::string(kCatalogFolder) +
                   " is missing, but the folder meshes holds " + Count(stored, "file") +
                   " (an empty folder in its place starts without records)");
  }
  if (IsTooMany(catalog.unreadable, catalog.records.size())) {
    return Refusal(std::to_string(catalog.unreadable) + " of " +
                   Count(catalog.records.size(), "record") + " in the folder " +
                   std::string(kCatalogFolder) + " cannot be read");
  }
  Result<std::set<Sha256Digest>> unreadable = UnreadableMeshes(recorded);
  if (!unreadable.ok()) return std::move(unreadable).error();

  if (!cache_of_.empty() && !is_marked_as_cache_) {
    if (!recorded.empty() || stored != 0) {
      return Error{ErrorCode::kInvalidArgument,
                   "it has meshes that are not in the store, so it cannot become its cache; use an "
                   "empty directory, and upload the meshes again"};
    }
    if (Status marked = MarkAsCache(); !marked.ok()) return std::move(marked).error();
  }

  // Everything is accounted for. From here on files are made and removed.
  for (const FileGroup group : kGroupsOnDisk) {
    if (Status opened = Blobs(group).Open(); !opened.ok()) {
      return RefusalOf(kFolders[IndexOf(group)], opened.error());
    }
  }
  if (Status opened = catalog_.Open(); !opened.ok()) {
    return RefusalOf(kCatalogFolder, opened.error());
  }
  damaged_ += catalog.damaged + unreadable->size();
  for (TreeRecord& record : catalog.records) record.mesh_bytes = recorded.at(record.id.mesh);
  TakeStock(recorded, std::move(files));
  return Contents{std::move(catalog.records), *std::move(unreadable)};
}

// Adds the files on disk to the bookkeeping, oldest use first. Removes derived files without a
// mesh, which a deletion interrupted by a crash left. Without any record, nothing is known of this
// directory, and all files stay.
void SceneStore::TakeStock(const RecordedMeshes& recorded, Files files) {
  std::set<std::string> wanted;
  for (const auto& [mesh, bytes] : recorded) wanted.insert(mesh.ToHex());
  std::set<std::string> stored;
  for (const FileInfo& file : files[IndexOf(FileGroup::kMeshes)]) {
    stored.insert(file.name);
  }
  for (const FileGroup group : kGroupsOnDisk) {
    std::vector<FileInfo>& list = files[IndexOf(group)];
    std::sort(list.begin(), list.end(), [](const FileInfo& a, const FileInfo& b) {
      return std::tie(a.modified_ms, a.name) < std::tie(b.modified_ms, b.name);
    });
    for (const FileInfo& file : list) {
      if (!file.readable || !IsOurs(group, file.name)) continue;
      const std::string mesh = DigestPart(file.name);
      if (wanted.contains(mesh)) {
        usage_.Set(group, file.name, file.bytes);
      } else if (group == FileGroup::kMeshes) {
        usage_.Set(FileGroup::kUnrecorded, file.name, file.bytes);
      } else if (stored.contains(mesh) || recorded.empty()) {
        usage_.Set(group, file.name, file.bytes);
      } else {
        (void)Blobs(group).Remove(file.name);
      }
    }
  }
}

}  // namespace kdray::core
