// SPDX-License-Identifier: Apache-2.0
// The stored files. Their hashes are made right, so the readers after the check see every
// input: a damaged disk is caught by the hash, and a file that another version wrote is not.
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>

#include "core/accel/tree.h"
#include "core/base/hash.h"
#include "core/scene/scene.h"
#include "core/store/catalog.h"
#include "core/store/parsed_mesh_file.h"
#include "core/store/tradeoff_file.h"
#include "core/store/tree_file.h"
#include "core/trace/trace.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/shapes.h"
#include "tests/support/simulated_disk.h"

namespace kdray::fuzz {
namespace {

constexpr std::size_t kHeaderBytes = 16, kTrailerBytes = 8 + 32;  // core/store/checked_file.h

const core::Sha256Digest kMeshDigest = core::HashBytes(ToBytes("a mesh"));

const core::TriangleMesh& Mesh() {
  static const core::TriangleMesh mesh =
      *core::TriangleMesh::Create(test::UvSphere({0, 0, 0}, 1, 6, 8));
  return mesh;
}

/// One file on a disk in memory.
class OneFile {
 public:
  OneFile() : store_(&disk_, "folder") { (void)store_.Open(); }

  core::NewBlob Create() { return *store_.Create(); }
  /// The file without its trailer.
  Bytes Commit(core::Result<core::NewBlob> written) {
    (void)written->Commit("file");
    Bytes bytes = disk_.Contents("folder/file").value();
    bytes.resize(bytes.size() - kTrailerBytes);
    return bytes;
  }
  /// The file with these bytes and the trailer that they need.
  std::unique_ptr<core::ReadableFile> Open(std::span<const std::byte> input) {
    disk_.SetContents("folder/file", Sealed(input));
    return *store_.Read("file");
  }

  static Bytes Sealed(std::span<const std::byte> input) {
    Bytes file(input.begin(), input.end());
    const std::uint64_t payload = file.size() < kHeaderBytes ? 0 : file.size() - kHeaderBytes;
    const auto length = std::as_bytes(std::span(&payload, 1));
    file.insert(file.end(), length.begin(), length.end());
    const core::Sha256Digest digest = core::HashBytes(file);
    const auto hash = std::as_bytes(std::span(digest.bytes));
    file.insert(file.end(), hash.begin(), hash.end());
    return file;
  }

 private:
  test::SimulatedDisk disk_;
  core::BlobStore store_;
};

constexpr core::BuildKind kKinds[] = {core::BuildKind::kKdSah, core::BuildKind::kBvh,
                                      core::BuildKind::kBox};

core::TreeFileKey KeyOf(core::BuildKind kind) {
  return {kMeshDigest, Mesh().triangle_count(), kind};
}

// A tree that is read is safe to traverse, whatever its file holds.
bool FuzzTree(std::span<const std::byte> input) {
  bool valid = false;
  for (const core::BuildKind kind : kKinds) {
    OneFile file;
    core::Result<core::Tree> tree = core::ReadTreeFile(KeyOf(kind), file.Open(input));
    if (!tree.ok()) {
      Require(tree.error().code == core::ErrorCode::kCorrupt, "a bad file is corrupt");
      continue;
    }
    valid = true;
    static const auto mesh = std::make_shared<const core::TriangleMesh>(Mesh());
    const core::Scene scene{mesh, std::make_shared<const core::Tree>(*std::move(tree))};
    std::vector<core::Ray> rays;
    for (int i = 0; i < 100; ++i) {
      const double angle = i * 0.37;
      rays.push_back({{2 * std::cos(angle), 2 * std::sin(angle), 0.1 * (i % 7)},
                      0,
                      {-std::cos(angle), -std::sin(angle), 0.01 * (i % 5)},
                      10});
    }
    std::vector<core::Hit> hits(rays.size());
    for (const auto precision : {core::Precision::kFast, core::Precision::kExact}) {
      core::TraceOptions options;
      options.precision = precision;
      Require(core::TraceClosest(scene, std::span<const core::Ray>(rays), options, hits).ok(),
              "a query ends");
      for (const core::Hit& hit : hits) {
        Require(!hit.IsHit() || hit.primitive_id < mesh->triangle_count(), "a hit is a triangle");
      }
    }
  }
  return valid;
}

bool FuzzParsedMesh(std::span<const std::byte> input) {
  OneFile file;
  const auto parsed = core::ReadParsedMeshFile(kMeshDigest, file.Open(input));
  if (!parsed.ok()) {
    Require(parsed.error().code == core::ErrorCode::kCorrupt, "a bad file is corrupt");
    return false;
  }
  for (std::size_t i = 0; i < parsed->mesh.triangle_count(); ++i) {
    const auto id = static_cast<core::PrimitiveId>(i);
    Require(core::IsFinite(parsed->mesh.LocalCorner(id, 0)), "a corner is finite");
  }
  return true;
}

bool FuzzTradeoff(std::span<const std::byte> input) {
  OneFile file;
  const auto measured = core::ReadTradeoffFile(kMeshDigest, file.Open(input));
  Require(measured.ok() || measured.error().code == core::ErrorCode::kCorrupt,
          "a bad file is corrupt");
  return measured.ok();
}

core::TreeRecord Record() {
  core::TreeRecord record;
  record.id = core::TreeId{kMeshDigest, core::BuildKind::kBvh};
  record.created_ms = 1'600'000'000'000;
  record.mesh_bytes = 100;
  return record;
}

// A record that cannot be read still names its tree, and the other records are read.
bool FuzzRecord(std::span<const std::byte> input) {
  test::SimulatedDisk disk;
  core::Catalog catalog(&disk, "catalog");
  (void)catalog.Open();
  disk.SetContents(std::filesystem::path("catalog") / Record().id.ToString(),
                   OneFile::Sealed(input));
  const auto contents = catalog.Load();
  Require(contents.ok() && contents->records.size() == 1, "a record names its tree");
  Require(contents->records[0].id == Record().id, "a record is that of its name");
  return contents->damaged == 0;
}

std::vector<Bytes> TreeSeeds() {
  std::vector<Bytes> seeds;
  for (const core::BuildKind kind : kKinds) {
    OneFile file;
    const core::Tree tree = *core::BuildTree(Mesh(), kind);
    seeds.push_back(file.Commit(core::WriteTreeFile(KeyOf(kind), tree, file.Create())));
  }
  return seeds;
}

std::vector<Bytes> ParsedMeshSeeds() {
  OneFile file;
  core::MeshFacts facts;
  facts.triangles = Mesh().triangle_count();
  facts.vertices = Mesh().vertex_count();
  facts.bounds = Mesh().bounds();
  facts.frame = Mesh().frame();
  facts.double_vertices = Mesh().has_double_vertices();
  facts.memory_bytes = Mesh().bytes();
  const core::ParsedMesh parsed{facts, Mesh()};
  return {file.Commit(core::WriteParsedMeshFile(kMeshDigest, parsed, file.Create()))};
}

std::vector<Bytes> TradeoffSeeds() {
  OneFile file;
  return {file.Commit(core::WriteTradeoffFile(kMeshDigest, {}, file.Create()))};
}

std::vector<Bytes> RecordSeeds() {
  test::SimulatedDisk disk;
  core::Catalog catalog(&disk, "catalog");
  (void)catalog.Open();
  (void)catalog.Save(Record());
  Bytes bytes = disk.Contents(std::filesystem::path("catalog") / Record().id.ToString()).value();
  bytes.resize(bytes.size() - kTrailerBytes);
  return {bytes};
}

const FuzzTarget kTargets[] = {{"tree_file", FuzzTree, TreeSeeds},
                               {"parsed_mesh_file", FuzzParsedMesh, ParsedMeshSeeds},
                               {"tradeoff_file", FuzzTradeoff, TradeoffSeeds},
                               {"record", FuzzRecord, RecordSeeds}};

}  // namespace

std::span<const FuzzTarget> StoreTargets() { return kTargets; }

}  // namespace kdray::fuzz
