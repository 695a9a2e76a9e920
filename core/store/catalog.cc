// SPDX-License-Identifier: Apache-2.0
#include "core/store/catalog.h"

#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "core/store/checked_file.h"
#include "core/store/facts_codec.h"
#include "core/store/memory_file.h"

namespace kdray::core {
namespace {

// Increment the version when the layout below, or the meaning of a fact, changes.
constexpr FileKind kRecordFileKind{"kdraycat", 5, 1};
// Readers of meshes have changed since the facts of version 1 were found.
constexpr std::uint32_t kFirstWithTheseMeshFacts = 2;
constexpr std::uint32_t kFirstWithMaxLeaf = 3;
constexpr std::uint32_t kFirstWithResumes = 3;
constexpr std::uint32_t kFirstWithSurfaceFacts = 4;
constexpr std::uint32_t kFirstWithChoice = 5;

constexpr FileKind kGroupsFileKind{"kdraygrp", 1};
constexpr std::uint32_t kMaxGroups = 4096;

// No tree has this id, so it cannot be that of a record.
std::string GroupsFileName(const Sha256Digest& mesh) { return mesh.ToHex() + "-groups"; }

void PutTreeFacts(const TreeFacts& facts, CheckedWriter* writer) {
  PutEnum(facts.build, writer);
  PutTreeStats(facts.stats, writer);
  writer->Put(facts.build_ms);
}

// nullopt when the record does not tell all of them: then a build is due.
std::optional<TreeFacts> GetTreeFacts(CheckedReader* reader) {
  TreeFacts facts;
  facts.build = GetEnum<BuildKind>(reader);
  std::optional<TreeStats> stats =
      GetTreeStats(reader->version() < kFirstWithMaxLeaf ? TreeStatsLayout::kWithoutMaxLeaf
                                                         : TreeStatsLayout::kWithMaxLeaf,
                   reader);
  facts.build_ms = reader->Get<double>();
  if (!stats) return std::nullopt;
  facts.stats = *std::move(stats);
  return facts;
}

void PutChoice(const std::optional<AutoChoice>& choice, CheckedWriter* writer) {
  PutBool(choice.has_value(), writer);
  if (!choice) return;
  writer->Put(choice->overlap);
  PutBool(choice->costs.has_value(), writer);
  if (!choice->costs) return;
  writer->Put(choice->costs->bvh);
  writer->Put(choice->costs->kd_sah);
}

std::optional<AutoChoice> GetChoice(CheckedReader* reader) {
  if (!GetBool(reader)) return std::nullopt;
  AutoChoice choice;
  choice.overlap = reader->Get<double>();
  if (GetBool(reader)) {
    choice.costs = AutoChoice::Costs();
    choice.costs->bvh = reader->Get<double>();
    choice.costs->kd_sah = reader->Get<double>();
  }
  return choice;
}

void PutRecord(const TreeRecord& record, CheckedWriter* writer) {
  const std::string name = record.id.ToString();
  writer->PutArray(std::span(name));
  writer->Put(record.created_ms);
  writer->Put(record.mesh_bytes);
  writer->Put(record.resumed);
  PutBool(record.mesh.has_value(), writer);
  if (record.mesh) {
    PutMeshFacts(*record.mesh, writer);
    PutSurfaceFacts(*record.mesh, writer);
  }
  PutBool(record.tree.has_value(), writer);
  if (record.tree) PutTreeFacts(*record.tree, writer);
  PutChoice(record.choice, writer);
}

Result<TreeRecord> GetRecord(const TreeId& id, std::unique_ptr<ReadableFile> file) {
  const std::string name = id.ToString();
  CheckedReader reader(std::move(file), kRecordFileKind);
  const std::vector<char> stored_name = reader.GetArray<char>();
  if (std::string_view(stored_name.data(), stored_name.size()) != name) reader.Fail();
  TreeRecord record;
  record.id = id;
  record.created_ms = reader.Get<std::int64_t>();
  record.mesh_bytes = reader.Get<std::uint64_t>();
  if (reader.version() >= kFirstWithResumes) record.resumed = reader.Get<std::uint32_t>();
  if (reader.version() < kFirstWithTheseMeshFacts) {
    reader.SkipRest();
  } else {
    if (GetBool(&reader)) record.mesh = GetMeshFacts(&reader);
    if (record.mesh && reader.version() >= kFirstWithSurfaceFacts) {
      GetSurfaceFacts(&reader, &*record.mesh);
    }
    if (GetBool(&reader)) record.tree = GetTreeFacts(&reader);
    if (reader.version() >= kFirstWithChoice) record.choice = GetChoice(&reader);
  }
  if (Status status = reader.Finish(); !status.ok()) return std::move(status).error();
  return record;
}

}  // namespace

std::vector<std::byte> EncodeRecord(const TreeRecord& record) {
  CheckedWriter writer(kRecordFileKind);
  PutRecord(record, &writer);
  return std::move(writer).FinishInMemory();
}

Result<TreeRecord> DecodeRecord(const TreeId& id, std::vector<std::byte> bytes) {
  return GetRecord(id, std::make_unique<MemoryFile>(std::move(bytes)));
}

Status Catalog::Save(const TreeRecord& record) {
  Result<NewBlob> blob = blobs_.Create();
  if (!blob.ok()) return std::move(blob).error();
  CheckedWriter writer(*std::move(blob), kRecordFileKind);
  PutRecord(record, &writer);
  Result<NewBlob> written = std::move(writer).Finish();
  if (!written.ok()) return std::move(written).error();
  return written->Commit(record.id.ToString());
}

Result<TreeRecord> Catalog::Read(const TreeId& id) const {
  Result<std::unique_ptr<ReadableFile>> file = blobs_.Read(id.ToString());
  if (!file.ok()) return std::move(file).error();
  return GetRecord(id, *std::move(file));
}

Result<Catalog::Contents> Catalog::Load() const {
  const Result<std::vector<FileInfo>> files = blobs_.List();
  if (!files.ok()) return files.error();
  Contents contents;
  for (const FileInfo& file : *files) {
    const std::optional<TreeId> id = ParseTreeId(file.name);
    if (!id) continue;
    Result<TreeRecord> record = Read(*id);
    if (!record.ok()) {
      ++contents.damaged;
      const ErrorCode code = record.error().code;
      const bool failed = code == ErrorCode::kIo || code == ErrorCode::kMemoryFull;
      if (!file.readable || failed) ++contents.unreadable;
      TreeRecord wanted;
      wanted.id = *id;
      wanted.created_ms = file.modified_ms;
      record = std::move(wanted);
    }
    contents.records.push_back(*std::move(record));
  }
  return contents;
}

Status Catalog::Remove(const TreeId& id) { return blobs_.Remove(id.ToString()); }

Status Catalog::SaveGroupNames(const Sha256Digest& mesh, std::span<const std::string> names) {
  Result<NewBlob> blob = blobs_.Create();
  if (!blob.ok()) return std::move(blob).error();
  CheckedWriter writer(*std::move(blob), kGroupsFileKind);
  writer.Put(mesh);
  writer.Put(static_cast<std::uint32_t>(names.size()));
  for (const std::string& name : names) writer.PutArray(std::span(name));
  Result<NewBlob> written = std::move(writer).Finish();
  if (!written.ok()) return std::move(written).error();
  return written->Commit(GroupsFileName(mesh));
}

Result<std::vector<std::string>> Catalog::ReadGroupNames(const Sha256Digest& mesh) const {
  Result<std::unique_ptr<ReadableFile>> file = blobs_.Read(GroupsFileName(mesh));
  if (!file.ok()) return std::move(file).error();
  CheckedReader reader(*std::move(file), kGroupsFileKind);
  if (reader.Get<Sha256Digest>() != mesh) reader.Fail();
  std::vector<std::string> names;
  const auto count = reader.GetBelow(kMaxGroups + 1);
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::vector<char> name = reader.GetArray<char>();
    names.emplace_back(name.begin(), name.end());
  }
  if (Status status = reader.Finish(); !status.ok()) return std::move(status).error();
  return names;
}

Status Catalog::RemoveAllOf(const Sha256Digest& mesh) {
  std::array<std::string, kAllBuildKinds.size() + 2> names;
  std::array<std::string_view, kAllBuildKinds.size() + 2> views;
  names.back() = GroupsFileName(mesh);
  names[0] = TreeId{mesh, std::nullopt}.ToString();
  for (std::size_t i = 0; i < kAllBuildKinds.size(); ++i) {
    names[i + 1] = TreeId{mesh, kAllBuildKinds[i]}.ToString();
  }
  std::copy(names.begin(), names.end(), views.begin());
  return blobs_.Remove(views);
}

}  // namespace kdray::core
