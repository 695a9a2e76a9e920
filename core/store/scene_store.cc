// SPDX-License-Identifier: Apache-2.0
#include "core/store/scene_store.h"

#include <algorithm>
#include <utility>

#include "core/store/checked_file.h"
#include "core/store/parsed_mesh_file.h"

namespace kdray::core {
namespace {

// A mesh file is marked as used at most this often; after a restart the order of use may be
// approximate.
constexpr std::chrono::minutes kTouchEvery{1};

std::string TreeFileName(const Sha256Digest& mesh, BuildKind build) {
  return TreeId{mesh, build}.ToString();
}

Error DamagedMesh() {
  return Error{ErrorCode::kCorrupt, "the stored mesh is damaged or cannot be read"};
}

// Reads a file whose bytes must have the digest, piece by piece: place(n) is where the next n bytes
// go. kCorrupt when they have another, or cannot be read.
template <class Place>
Status ReadHashed(const ReadableFile& file, const Sha256Digest& digest, const CancelToken& cancel,
                  const Place& place) {
  Sha256 hash;
  for (std::uint64_t offset = 0; offset < file.size();) {
    if (cancel.ShouldStop()) return cancel.ToError();
    const std::span<std::byte> piece = place(
        static_cast<std::size_t>(std::min<std::uint64_t>(kFilePieceBytes, file.size() - offset)));
    if (!file.ReadAt(offset, piece).ok()) return DamagedMesh();
    hash.Update(piece);
    offset += piece.size();
  }
  if (hash.Finish() != digest) return DamagedMesh();
  return {};
}

Error DiskFull(std::uint64_t bytes, std::uint64_t free) {
  return Error{ErrorCode::kStoreFull, "the disk has no room for " + std::to_string(bytes) +
                                          " bytes; " + std::to_string(free) + " are free"};
}

}  // namespace

SceneStore::SceneStore(const Options& options)
    : file_system_(options.file_system),
      directory_(options.directory),
      cache_of_(options.cache_of),
      blobs_{BlobStore(file_system_, directory_ / kFolders[0]),
             BlobStore(file_system_, directory_ / kFolders[1]),
             BlobStore(file_system_, directory_ / kFolders[2]),
             BlobStore(file_system_, directory_ / kFolders[3]),
             BlobStore(file_system_, directory_ / kFolders[4])},
      catalog_(file_system_, directory_ / kCatalogFolder),
      usage_(options.limit_bytes) {}

Result<std::unique_ptr<SceneStore>> SceneStore::Open(const Options& options) {
  std::unique_ptr<SceneStore> store(new SceneStore(options));
  if (Status made = store->file_system_->MakeDirectory(store->directory_); !made.ok()) {
    return std::move(made).error();
  }
  Result<std::unique_ptr<FileLock>> lock = store->file_system_->Lock(store->directory_ / "lock");
  if (!lock.ok()) return std::move(lock).error();
  store->lock_ = *std::move(lock);
  if (Status status = store->CheckCacheMark(); !status.ok()) return std::move(status).error();
  return store;
}

// Without memory for its name the file stays, and counts as before.
void SceneStore::RemoveDerived(FileGroup group, const std::string& name) {
  DiskUsage::Note note(name, usage_.BytesOf(group, name));
  if (!usage_.Drop(group, name)) return;
  try {
    (void)Blobs(group).Remove(name);
  } catch (...) {
    usage_.Set(group, std::move(note));
    throw;
  }
}

bool SceneStore::RemoveOldestDerived() {
  for (const FileGroup group : {FileGroup::kTrees, FileGroup::kParsed, FileGroup::kMeasured}) {
    if (const std::optional<std::string> name = usage_.Oldest(group)) {
      RemoveDerived(group, *name);
      return true;
    }
  }
  return false;
}

std::optional<DiskRoom> SceneStore::MakeRoom(std::uint64_t bytes) {
  for (;;) {
    if (std::optional<DiskRoom> room = usage_.TryReserve(bytes)) return room;
    if (!RemoveOldestDerived()) return std::nullopt;
  }
}

std::optional<Sha256Digest> SceneStore::OldestMesh(const std::set<std::string>& except) const {
  Sha256Digest digest;
  const std::optional<std::string> name = usage_.Oldest(FileGroup::kMeshes, except);
  if (!name || !ParseSha256Hex(*name, &digest)) return std::nullopt;
  return digest;
}

std::optional<Sha256Digest> SceneStore::OldestUnrecordedMesh() const {
  Sha256Digest digest;
  const std::optional<std::string> name = usage_.Oldest(FileGroup::kUnrecorded);
  if (!name || !ParseSha256Hex(*name, &digest)) return std::nullopt;
  return digest;
}

void SceneStore::MarkUnrecorded(const Sha256Digest& mesh) {
  usage_.Move(FileGroup::kMeshes, FileGroup::kUnrecorded, mesh.ToHex());
}

Result<NewMesh> SceneStore::BeginMesh(std::uint64_t bytes) {
  // Checks now, not after the client has sent everything.
  const Result<std::uint64_t> free = file_system_->FreeBytes(directory_);
  const std::uint64_t derived = usage_.derived();
  if (free.ok() && bytes > *free && bytes - *free > derived) return DiskFull(bytes, *free);
  Result<NewBlob> blob = Blobs(FileGroup::kMeshes).Create();
  if (!blob.ok()) return std::move(blob).error();
  return NewMesh(this, *std::move(blob), usage_.BeginArrival());
}

Status NewMesh::Append(std::span<const std::byte> bytes) {
  if (Status status = store_->MakeRoomForArrived(bytes.size(), &room_); !status.ok()) {
    return status;
  }
  hash_.Update(bytes);
  return blob_.Append(bytes);
}

// Evicts derived files for bytes that have arrived, for the limit and for the disk.
Status SceneStore::MakeRoomForArrived(std::uint64_t bytes, ArrivingRoom* room) {
  if (!room->Grow(bytes)) {
    return Error{ErrorCode::kStoreFull, "the uploads under way are as large as the store"};
  }
  while (!usage_.IsWithinLimit() && RemoveOldestDerived()) {
  }
  for (;;) {
    const Result<std::uint64_t> free = file_system_->FreeBytes(directory_);
    if (!free.ok() || *free >= bytes) return {};
    if (!RemoveOldestDerived()) return DiskFull(bytes, *free);
  }
}

Status SceneStore::Commit(const Sha256Digest& mesh, NewMesh file, DiskRoom /*room*/) {
  const std::string name = mesh.ToHex();
  DiskUsage::Note note(name, file.bytes());
  if (Status status = file.blob_.Commit(name); !status.ok()) return status;
  usage_.Drop(FileGroup::kUnrecorded, name);
  usage_.Set(FileGroup::kMeshes, std::move(note));
  return {};
}

Result<std::unique_ptr<ReadableFile>> SceneStore::OpenCounted(FileGroup group,
                                                              const std::string& name) {
  Result<std::unique_ptr<ReadableFile>> file = Blobs(group).Read(name);
  if (!file.ok()) {
    CountDamage(file.error());
    if (file.error().code == ErrorCode::kNotFound) usage_.Drop(group, name);
  }
  return file;
}

void SceneStore::CountDamage(const Error& error) {
  // The others say nothing about the file.
  if (error.code == ErrorCode::kCorrupt || error.code == ErrorCode::kIo) ++damaged_;
}

Result<std::unique_ptr<ReadableFile>> SceneStore::OpenMesh(const Sha256Digest& mesh,
                                                           const CancelToken& cancel) {
  Result<std::unique_ptr<ReadableFile>> file = Blobs(FileGroup::kMeshes).Read(mesh.ToHex());
  Status status = DamagedMesh();
  if (file.ok() && sound_meshes_.Has(mesh, (*file)->version())) {
    status = {};
  } else if (file.ok()) {
    std::vector<std::byte> piece;
    status = ReadHashed(**file, mesh, cancel, [&](std::size_t bytes) {
      piece.resize(bytes);
      return std::span(piece);
    });
    if (status.ok()) sound_meshes_.Note(mesh, (*file)->version());
  }
  if (status.ok()) return sound_meshes_.HashWhileRead(*std::move(file), mesh);
  CountDamage(status.error());
  return std::move(status).error();
}

Result<std::vector<std::byte>> SceneStore::ReadMesh(const Sha256Digest& mesh,
                                                    const CancelToken& cancel) {
  const auto file = Blobs(FileGroup::kMeshes).Read(mesh.ToHex());
  std::vector<std::byte> all;
  Status status = DamagedMesh();
  if (file.ok()) {
    all.reserve(static_cast<std::size_t>((*file)->size()));
    status = ReadHashed(**file, mesh, cancel, [&](std::size_t bytes) {
      all.resize(all.size() + bytes);
      return std::span(all).last(bytes);
    });
  }
  if (status.ok()) return all;
  CountDamage(status.error());
  return std::move(status).error();
}

Status SceneStore::RemoveMesh(const Sha256Digest& mesh) {
  const std::string name = mesh.ToHex();
  RemoveDerived(FileGroup::kParsed, name);
  for (const BuildKind build : kAllBuildKinds) RemoveTree(mesh, build);
  (void)RemoveTradeoff(mesh);
  Status status = Blobs(FileGroup::kMeshes).Remove(name);
  if (status.ok()) {
    usage_.Drop(FileGroup::kMeshes, name);
    usage_.Drop(FileGroup::kUnrecorded, name);
  } else {
    MarkUnrecorded(mesh);
  }
  sound_meshes_.Forget(mesh);
  const std::lock_guard lock(touched_mutex_);
  touched_.erase(mesh);
  return status;
}

void SceneStore::UseMesh(const Sha256Digest& mesh) {
  const std::string name = mesh.ToHex();
  usage_.Use(FileGroup::kMeshes, name);
  if (!usage_.limit()) return;
  {
    const auto now = std::chrono::steady_clock::now();
    const std::lock_guard lock(touched_mutex_);
    const auto [entry, is_new] = touched_.try_emplace(mesh, now);
    if (!is_new && now - entry->second < kTouchEvery) return;
    entry->second = now;
  }
  (void)Blobs(FileGroup::kMeshes).Touch(name);
}

std::uint64_t SceneStore::ParsedFileBytes(const Sha256Digest& mesh) const {
  return usage_.BytesOf(FileGroup::kParsed, mesh.ToHex());
}

Result<ParsedMesh> SceneStore::ReadParsed(const Sha256Digest& mesh, const CancelToken& cancel) {
  const std::string name = mesh.ToHex();
  Result<std::unique_ptr<ReadableFile>> file = OpenCounted(FileGroup::kParsed, name);
  if (!file.ok()) return std::move(file).error();
  Result<ParsedMesh> parsed = ReadParsedMeshFile(mesh, *std::move(file), cancel);
  if (parsed.ok()) {
    usage_.Use(FileGroup::kParsed, name);
  } else {
    CountDamage(parsed.error());
  }
  return parsed;
}

std::uint64_t SceneStore::TreeFileBytes(const Sha256Digest& mesh, BuildKind build) const {
  return usage_.BytesOf(FileGroup::kTrees, TreeFileName(mesh, build));
}

Result<Tree> SceneStore::ReadTree(const TreeFileKey& key, const CancelToken& cancel) {
  const std::string name = TreeFileName(key.mesh, key.build);
  Result<std::unique_ptr<ReadableFile>> file = OpenCounted(FileGroup::kTrees, name);
  if (!file.ok()) return std::move(file).error();
  Result<Tree> tree = ReadTreeFile(key, *std::move(file), cancel);
  if (tree.ok()) {
    usage_.Use(FileGroup::kTrees, name);
  } else {
    CountDamage(tree.error());
  }
  return tree;
}

template <class Write>
void SceneStore::WriteDerived(FileGroup group, const std::string& name,
                              std::uint64_t bytes_expected, const Write& write) {
  // Does not evict files for one that cannot fit, nor meshes for derived files.
  if (!usage_.FitsBesideMeshes(bytes_expected)) return;
  const std::optional<DiskRoom> room = MakeRoom(bytes_expected);
  if (!room) return;
  Result<NewBlob> blob = Blobs(group).Create();
  if (!blob.ok()) return;
  Result<NewBlob> written = write(*std::move(blob));
  if (!written.ok()) return;
  DiskUsage::Note note(name, written->bytes());
  try {
    if (!written->Commit(name).ok()) return;
  } catch (...) {
    usage_.Set(group, std::move(note));  // it may have its name already
    throw;
  }
  usage_.Set(group, std::move(note));
}

void SceneStore::WriteParsed(const Sha256Digest& mesh, const ParsedMesh& parsed,
                             const CancelToken& cancel) {
  WriteDerived(FileGroup::kParsed, mesh.ToHex(), parsed.facts.memory_bytes, [&](NewBlob blob) {
    return WriteParsedMeshFile(mesh, parsed, std::move(blob), cancel);
  });
}

void SceneStore::WriteTree(const TreeFileKey& key, const Tree& tree, const CancelToken& cancel) {
  WriteDerived(FileGroup::kTrees, TreeFileName(key.mesh, key.build), tree.bytes(),
               [&](NewBlob blob) { return WriteTreeFile(key, tree, std::move(blob), cancel); });
}

Result<MeasuredTradeoff> SceneStore::ReadTradeoff(const Sha256Digest& mesh) {
  const std::string name = mesh.ToHex();
  if (!HasTradeoff(mesh)) {
    return Error{ErrorCode::kNotFound, "nothing was measured"};
  }
  Result<std::unique_ptr<ReadableFile>> file = OpenCounted(FileGroup::kMeasured, name);
  if (!file.ok()) return std::move(file).error();
  Result<MeasuredTradeoff> measured = ReadTradeoffFile(mesh, *std::move(file));
  if (!measured.ok()) CountDamage(measured.error());
  return measured;
}

void SceneStore::WriteTradeoff(const Sha256Digest& mesh, const MeasuredTradeoff& measured) {
  WriteDerived(FileGroup::kMeasured, mesh.ToHex(), kTradeoffFileBytes,
               [&](NewBlob blob) { return WriteTradeoffFile(mesh, measured, std::move(blob)); });
}

bool SceneStore::HasTradeoff(const Sha256Digest& mesh) const {
  return usage_.BytesOf(FileGroup::kMeasured, mesh.ToHex()) != 0;
}

Status SceneStore::RemoveTradeoff(const Sha256Digest& mesh) {
  const std::string name = mesh.ToHex();
  if (!HasTradeoff(mesh)) return {};
  Status removed = Blobs(FileGroup::kMeasured).Remove(name);
  if (removed.ok()) usage_.Drop(FileGroup::kMeasured, name);
  return removed;
}

Result<std::unique_ptr<ReadableFile>> SceneStore::OpenTree(const Sha256Digest& mesh,
                                                           BuildKind build) const {
  return Blobs(FileGroup::kTrees).Read(TreeFileName(mesh, build));
}

Status SceneStore::StoreTree(const Sha256Digest& mesh, BuildKind build, std::uint64_t bytes,
                             const std::function<Status(NewBlob*)>& fill) {
  Status filled;
  WriteDerived(FileGroup::kTrees, TreeFileName(mesh, build), bytes,
               [&](NewBlob blob) -> Result<NewBlob> {
                 filled = fill(&blob);
                 if (!filled.ok()) return filled.error();
                 return blob;
               });
  return filled;
}

void SceneStore::RemoveTree(const Sha256Digest& mesh, BuildKind build) {
  RemoveDerived(FileGroup::kTrees, TreeFileName(mesh, build));
}

}  // namespace kdray::core
