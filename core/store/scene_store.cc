#include "core/store/scene_store.h"

#include <algorithm>
#include <tuple>
#include <utility>

#include "core/store/mesh_file.h"

namespace kdray::core {
namespace {

// A mesh's file is marked as used at most this often: the order of use only has to survive a
// restart roughly.
constexpr std::chrono::minutes kTouchEvery{1};

std::string TreeFileName(const Sha256Digest& mesh, BuildKind build) {
  return TreeId{mesh, build}.ToString();
}

bool IsDigest(const std::string& name) {
  Sha256Digest digest;
  return ParseSha256Hex(name, &digest);
}

// Whether a file of this group can have the name: others are somebody else's and stay.
bool IsOurs(FileGroup group, const std::string& name) {
  return group == FileGroup::kTrees ? ParseTreeId(name).has_value() : IsDigest(name);
}

std::string DigestPart(const std::string& name) { return name.substr(0, 64); }

Error DiskFull(std::uint64_t bytes, std::uint64_t free) {
  return Error{ErrorCode::kStoreFull, "the disk has no room for " + std::to_string(bytes) +
                                          " bytes; " + std::to_string(free) + " are free"};
}

Error DamagedMesh() { return Error{ErrorCode::kCorrupt, "the stored mesh is damaged"}; }

}  // namespace

SceneStore::SceneStore(const Options& options)
    : file_system_(options.file_system),
      directory_(options.directory),
      blobs_{BlobStore(file_system_, directory_ / "meshes"),
             BlobStore(file_system_, directory_ / "parsed"),
             BlobStore(file_system_, directory_ / "trees"),
             BlobStore(file_system_, directory_ / "measured")},
      catalog_(file_system_, directory_ / "catalog"),
      usage_(options.limit_bytes) {}

Result<std::unique_ptr<SceneStore>> SceneStore::Open(const Options& options) {
  std::unique_ptr<SceneStore> store(new SceneStore(options));
  if (Status made = store->file_system_->MakeDirectory(store->directory_); !made.ok()) {
    return std::move(made).error();
  }
  Result<std::unique_ptr<FileLock>> lock = store->file_system_->Lock(store->directory_ / "lock");
  if (!lock.ok()) return std::move(lock).error();
  store->lock_ = *std::move(lock);
  for (BlobStore& blobs : store->blobs_) {
    if (Status opened = blobs.Open(); !opened.ok()) return std::move(opened).error();
  }
  if (Status opened = store->catalog_.Open(); !opened.ok()) return std::move(opened).error();
  return store;
}

Result<std::vector<TreeRecord>> SceneStore::Load() {
  // All lists first: with one of them missing, nothing must be swept.
  Result<Catalog::Contents> catalog = catalog_.Load();
  if (!catalog.ok()) return std::move(catalog).error();
  std::array<std::vector<FileInfo>, kFileGroups> files;
  for (std::size_t group = 0; group < kFileGroups; ++group) {
    Result<std::vector<FileInfo>> listed = blobs_[group].List();
    if (!listed.ok()) return std::move(listed).error();
    files[group] = *std::move(listed);
  }
  damaged_ += catalog->damaged;

  std::map<std::string, std::uint64_t> mesh_bytes;
  for (const FileInfo& file : files[static_cast<std::size_t>(FileGroup::kMeshes)]) {
    if (file.readable && IsDigest(file.name)) mesh_bytes[file.name] = file.bytes;
  }
  std::vector<TreeRecord> records;
  std::set<std::string> wanted;
  for (TreeRecord& record : catalog->records) {
    const auto mesh = mesh_bytes.find(record.id.mesh.ToHex());
    if (mesh == mesh_bytes.end()) {
      ++damaged_;
      (void)catalog_.Remove(record.id);
      continue;
    }
    record.mesh_bytes = mesh->second;
    wanted.insert(mesh->first);
    records.push_back(std::move(record));
  }
  for (std::size_t group = 0; group < kFileGroups; ++group) {
    Sweep(wanted, static_cast<FileGroup>(group), std::move(files[group]));
  }
  return records;
}

// What no record names belongs to an upload or a deletion that a crash cut off.
void SceneStore::Sweep(const std::set<std::string>& wanted, FileGroup group,
                       std::vector<FileInfo> files) {
  std::sort(files.begin(), files.end(), [](const FileInfo& a, const FileInfo& b) {
    return std::tie(a.modified_ms, a.name) < std::tie(b.modified_ms, b.name);
  });
  for (const FileInfo& file : files) {
    if (!file.readable || !IsOurs(group, file.name)) continue;
    if (wanted.contains(DigestPart(file.name))) {
      usage_.Set(group, file.name, file.bytes);
    } else {
      (void)Blobs(group).Remove(file.name);
    }
  }
}

bool SceneStore::RemoveOldestDerived() {
  for (const FileGroup group : {FileGroup::kTrees, FileGroup::kParsed, FileGroup::kMeasured}) {
    if (const std::optional<std::string> name = usage_.Oldest(group)) {
      usage_.Drop(group, *name);
      (void)Blobs(group).Remove(*name);
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

Result<NewMesh> SceneStore::BeginMesh(std::uint64_t bytes) {
  // Better to know now than after the client has sent everything.
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

// Derived files give way to bytes that are there, within the limit as on the disk.
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
  if (Status status = file.blob_.Commit(name); !status.ok()) return status;
  usage_.Set(FileGroup::kMeshes, name, file.bytes());
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
  if (error.code != ErrorCode::kNotFound) ++damaged_;
}

Result<std::unique_ptr<ReadableFile>> SceneStore::OpenMesh(const Sha256Digest& mesh) {
  Result<std::unique_ptr<ReadableFile>> file = OpenCounted(FileGroup::kMeshes, mesh.ToHex());
  if (!file.ok()) return file;
  constexpr std::uint64_t kPiece = 1 << 20;
  std::vector<std::byte> piece(kPiece);
  Sha256 hash;
  for (std::uint64_t offset = 0; offset < (*file)->size(); offset += piece.size()) {
    piece.resize(static_cast<std::size_t>(std::min(kPiece, (*file)->size() - offset)));
    if (Status status = (*file)->ReadAt(offset, piece); !status.ok()) {
      CountDamage(status.error());
      return std::move(status).error();
    }
    hash.Update(piece);
  }
  if (hash.Finish() != mesh) {
    ++damaged_;
    return DamagedMesh();
  }
  return file;
}

Result<std::vector<std::byte>> SceneStore::ReadMesh(const Sha256Digest& mesh) {
  Result<std::unique_ptr<ReadableFile>> file = OpenCounted(FileGroup::kMeshes, mesh.ToHex());
  if (!file.ok()) return std::move(file).error();
  std::vector<std::byte> bytes(static_cast<std::size_t>((*file)->size()));
  Status status = (*file)->ReadAt(0, bytes);
  if (status.ok() && HashBytes(bytes) != mesh) status = DamagedMesh();
  if (!status.ok()) {
    CountDamage(status.error());
    return std::move(status).error();
  }
  return bytes;
}

Status SceneStore::RemoveMesh(const Sha256Digest& mesh) {
  const std::string name = mesh.ToHex();
  Status status = Blobs(FileGroup::kMeshes).Remove(name);
  if (status.ok()) usage_.Drop(FileGroup::kMeshes, name);
  if (usage_.Drop(FileGroup::kParsed, name)) (void)Blobs(FileGroup::kParsed).Remove(name);
  for (const BuildKind build : kAllBuildKinds) RemoveTree(mesh, build);
  RemoveTradeoff(mesh);
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

std::uint64_t SceneStore::PreparedFileBytes(const Sha256Digest& mesh) const {
  return usage_.BytesOf(FileGroup::kParsed, mesh.ToHex());
}

Result<PreparedMesh> SceneStore::ReadPrepared(const Sha256Digest& mesh) {
  const std::string name = mesh.ToHex();
  Result<std::unique_ptr<ReadableFile>> file = OpenCounted(FileGroup::kParsed, name);
  if (!file.ok()) return std::move(file).error();
  Result<PreparedMesh> prepared = ReadMeshFile(mesh, *std::move(file));
  if (prepared.ok()) {
    usage_.Use(FileGroup::kParsed, name);
  } else {
    CountDamage(prepared.error());
  }
  return prepared;
}

std::uint64_t SceneStore::TreeFileBytes(const Sha256Digest& mesh, BuildKind build) const {
  return usage_.BytesOf(FileGroup::kTrees, TreeFileName(mesh, build));
}

Result<Tree> SceneStore::ReadTree(const TreeFileKey& key) {
  const std::string name = TreeFileName(key.mesh, key.build);
  Result<std::unique_ptr<ReadableFile>> file = OpenCounted(FileGroup::kTrees, name);
  if (!file.ok()) return std::move(file).error();
  Result<Tree> tree = ReadTreeFile(key, *std::move(file));
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
  // Others' files do not give way to one that will not fit anyway, nor do meshes to derived ones.
  if (!usage_.FitsBesideMeshes(bytes_expected)) return;
  const std::optional<DiskRoom> room = MakeRoom(bytes_expected);
  if (!room) return;
  Result<NewBlob> blob = Blobs(group).Create();
  if (!blob.ok()) return;
  Result<NewBlob> written = write(*std::move(blob));
  if (!written.ok()) return;
  const std::uint64_t bytes = written->bytes();
  if (written->Commit(name).ok()) usage_.Set(group, name, bytes);
}

void SceneStore::WritePrepared(const Sha256Digest& mesh, const PreparedMesh& prepared) {
  WriteDerived(FileGroup::kParsed, mesh.ToHex(), prepared.facts.memory_bytes,
               [&](NewBlob blob) { return WriteMeshFile(mesh, prepared, std::move(blob)); });
}

void SceneStore::WriteTree(const TreeFileKey& key, const Tree& tree) {
  WriteDerived(FileGroup::kTrees, TreeFileName(key.mesh, key.build), tree.bytes(),
               [&](NewBlob blob) { return WriteTreeFile(key, tree, std::move(blob)); });
}

Result<MeasuredTradeoff> SceneStore::ReadTradeoff(const Sha256Digest& mesh) {
  const std::string name = mesh.ToHex();
  if (usage_.BytesOf(FileGroup::kMeasured, name) == 0) {
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

void SceneStore::RemoveTradeoff(const Sha256Digest& mesh) {
  const std::string name = mesh.ToHex();
  if (usage_.Drop(FileGroup::kMeasured, name)) (void)Blobs(FileGroup::kMeasured).Remove(name);
}

void SceneStore::RemoveTree(const Sha256Digest& mesh, BuildKind build) {
  const std::string name = TreeFileName(mesh, build);
  if (usage_.Drop(FileGroup::kTrees, name)) (void)Blobs(FileGroup::kTrees).Remove(name);
}

}  // namespace kdray::core
