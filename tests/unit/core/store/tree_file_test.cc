// SPDX-License-Identifier: Apache-2.0
// Stored meshes and trees: what comes back is bit for bit what was written, and whatever was done
// to a file is noticed.
#include "core/store/tree_file.h"

#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/hash.h"
#include "core/store/blob_store.h"
#include "core/store/parsed_mesh_file.h"
#include "tests/support/mesh_files.h"
#include "tests/support/shapes.h"
#include "tests/support/simulated_disk.h"

namespace kdray::core {
namespace {

using test::SimulatedDisk;
using FileBytes = std::vector<std::byte>;

const Sha256Digest kMesh = HashBytes(test::Bytes("a mesh"));
const Sha256Digest kOtherMesh = HashBytes(test::Bytes("another mesh"));

ParsedMesh Prepare(const MeshData& data) {
  Result<TriangleMesh> mesh = TriangleMesh::Create(data);
  EXPECT_TRUE(mesh.ok());
  MeshFacts facts;
  facts.format = mesh->format();
  facts.file_bytes = 1234;
  facts.triangles = mesh->triangle_count();
  facts.dropped = 7;
  facts.vertices = mesh->vertex_count();
  facts.bounds = mesh->bounds();
  facts.health.closed = true;
  facts.health.open_edges = 3;
  facts.health.coordinate_resolution = 1e-7;
  facts.double_vertices = mesh->has_double_vertices();
  facts.frame = mesh->frame();
  facts.shortest_edge = mesh->shortest_edge();
  facts.memory_bytes = mesh->bytes();
  facts.parse_ms = 0.125;
  return ParsedMesh{facts, *std::move(mesh)};
}

// One file on a disk of its own, under the name "file".
class OneFile {
 public:
  OneFile() : store_(&disk_, "folder") { EXPECT_TRUE(store_.Open().ok()); }

  NewBlob Create() {
    Result<NewBlob> blob = store_.Create();
    EXPECT_TRUE(blob.ok());
    return *std::move(blob);
  }
  FileBytes Commit(Result<NewBlob> written) {
    EXPECT_TRUE(written.ok() && written->Commit("file").ok());
    return disk_.Contents("folder/file").value();
  }
  std::unique_ptr<ReadableFile> Open(const FileBytes& bytes) {
    disk_.SetContents("folder/file", bytes);
    Result<std::unique_ptr<ReadableFile>> file = store_.Read("file");
    EXPECT_TRUE(file.ok());
    return *std::move(file);
  }

 private:
  SimulatedDisk disk_;
  BlobStore store_;
};

FileBytes Write(const TreeFileKey& key, const Tree& tree) {
  OneFile file;
  return file.Commit(WriteTreeFile(key, tree, file.Create()));
}
Result<Tree> Read(const TreeFileKey& key, const FileBytes& bytes) {
  OneFile file;
  return ReadTreeFile(key, file.Open(bytes));
}
FileBytes Write(const ParsedMesh& mesh) {
  OneFile file;
  return file.Commit(WriteParsedMeshFile(kMesh, mesh, file.Create()));
}
Result<ParsedMesh> Read(const Sha256Digest& mesh, const FileBytes& bytes) {
  OneFile file;
  return ReadParsedMeshFile(mesh, file.Open(bytes));
}

struct StoredTree {
  TreeFileKey key;
  Tree tree;
  FileBytes bytes;
};

StoredTree StoreSphere(BuildKind build) {
  const ParsedMesh mesh = Prepare(test::UvSphere({1, 2, 3}, 2, 6, 8));
  Result<Tree> tree = BuildTree(mesh.mesh, build);
  EXPECT_TRUE(tree.ok());
  StoredTree stored{{kMesh, mesh.mesh.triangle_count(), build}, *std::move(tree), {}};
  stored.bytes = Write(stored.key, stored.tree);
  return stored;
}

// Gives a changed file a digest that fits, as an attacker would.
void FixDigest(FileBytes* bytes) {
  const std::size_t payload = bytes->size() - 32;
  const Sha256Digest digest = HashBytes(std::span<const std::byte>(*bytes).first(payload));
  std::memcpy(bytes->data() + payload, digest.bytes.data(), 32);
}

// Every damage to `good` that `is_noticed` must notice.
void ExpectEveryDamageIsNoticed(const FileBytes& good,
                                const std::function<bool(const FileBytes&)>& is_noticed) {
  ASSERT_FALSE(is_noticed(good));
  for (std::size_t i = 0; i < good.size(); ++i) {
    FileBytes bad = good;
    bad[i] ^= std::byte{1} << (i % 8);
    EXPECT_TRUE(is_noticed(bad)) << "a bit of byte " << i << " of " << good.size() << " flipped";
  }
  for (std::size_t length = 0; length < good.size(); ++length) {
    EXPECT_TRUE(is_noticed(FileBytes(good.begin(), good.begin() + std::ptrdiff_t(length))))
        << "cut to " << length << " of " << good.size();
  }
  for (const std::size_t more : {1u, 8u, 40u, 5000u}) {
    FileBytes bad = good;
    bad.resize(good.size() + more);
    EXPECT_TRUE(is_noticed(bad)) << "grown by " << more;
    FileBytes twice = good;
    twice.insert(twice.end(), good.begin(), good.begin() + std::ptrdiff_t(more % good.size()));
    EXPECT_TRUE(is_noticed(twice)) << "grown by its own first " << more;
  }
  FileBytes doubled = good;
  doubled.insert(doubled.end(), good.begin(), good.end());
  EXPECT_TRUE(is_noticed(doubled));
  EXPECT_TRUE(is_noticed(FileBytes(good.size())));
}

TEST(TreeFile, GivesBackTheSameTreeForEveryBuild) {
  for (const BuildKind build : kAllBuildKinds) {
    const StoredTree stored = StoreSphere(build);
    const Result<Tree> read = Read(stored.key, stored.bytes);
    ASSERT_TRUE(read.ok()) << Name(build) << ": " << read.error().message;
    EXPECT_EQ(read->build, build);
    EXPECT_EQ(read->stats, stored.tree.stats);
    EXPECT_EQ(Write(stored.key, *read), stored.bytes) << Name(build);
  }
}

TEST(TreeFile, HoldsATreeOverNothingButDegenerateTriangles) {
  MeshData data;
  data.vertices = {{0, 0, 0}, {1, 0, 0}};
  data.triangles = {{0, 1, 1}};
  const ParsedMesh mesh = Prepare(data);
  for (const BuildKind build : kAllBuildKinds) {
    const Result<Tree> tree = BuildTree(mesh.mesh, build);
    ASSERT_TRUE(tree.ok());
    const TreeFileKey key{kMesh, 1, build};
    const FileBytes bytes = Write(key, *tree);
    const Result<Tree> read = Read(key, bytes);
    ASSERT_TRUE(read.ok()) << Name(build);
    EXPECT_EQ(Write(key, *read), bytes);
  }
}

TEST(TreeFile, NoticesEveryDamage) {
  for (const BuildKind build : {BuildKind::kKdSah, BuildKind::kBvh, BuildKind::kBox}) {
    const StoredTree stored = StoreSphere(build);
    ExpectEveryDamageIsNoticed(stored.bytes, [&](const FileBytes& bytes) {
      const Result<Tree> read = Read(stored.key, bytes);
      return !read.ok() && read.error().code == ErrorCode::kCorrupt;
    });
  }
}

TEST(TreeFile, IsRefusedUnderAnotherKey) {
  const StoredTree stored = StoreSphere(BuildKind::kKdSah);
  TreeFileKey key = stored.key;
  key.mesh = kOtherMesh;
  EXPECT_FALSE(Read(key, stored.bytes).ok()) << "another mesh";
  key = stored.key;
  key.build = BuildKind::kKdBinned;  // the same structure, built otherwise
  EXPECT_FALSE(Read(key, stored.bytes).ok()) << "another build";
  key = stored.key;
  ++key.triangle_count;
  EXPECT_FALSE(Read(key, stored.bytes).ok()) << "another number of triangles";
}

TEST(TreeFile, OfAnotherFormatVersionOrByteOrderIsRefusedThoughItsDigestFits) {
  const StoredTree stored = StoreSphere(BuildKind::kKdSah);
  // Magic, version, byte-order mark: see checked_file.h.
  for (const std::size_t byte : {0u, 8u, 12u}) {
    FileBytes other = stored.bytes;
    other[byte] ^= std::byte{2};
    FixDigest(&other);
    const Result<Tree> read = Read(stored.key, other);
    ASSERT_FALSE(read.ok()) << "byte " << byte;
    EXPECT_EQ(read.error().message, "a stored file has another format or version");
  }
}

// As version 2 stored it, without max_leaf: the statistics end with max_leaf and four numbers of 8
// bytes, then comes the footer of 40.
FileBytes AsVersion2(const StoredTree& stored) {
  FileBytes bytes = stored.bytes;
  const std::size_t max_leaf_at = bytes.size() - 40 - 5 * 8;
  std::uint64_t max_leaf = 0;
  std::memcpy(&max_leaf, bytes.data() + max_leaf_at, sizeof max_leaf);
  EXPECT_EQ(max_leaf, stored.tree.stats.max_leaf) << "the test knows the layout";
  const auto first = bytes.begin() + static_cast<std::ptrdiff_t>(max_leaf_at);
  bytes.erase(first, first + 8);
  bytes[8] = std::byte{2};
  const std::uint64_t payload_bytes = bytes.size() - 16 - 40;
  std::memcpy(bytes.data() + bytes.size() - 40, &payload_bytes, sizeof payload_bytes);
  FixDigest(&bytes);
  return bytes;
}

TEST(TreeFile, OfVersion2IsReadWhenItTellsTheLargestLeaf) {
  for (const BuildKind build : kAllBuildKinds) {
    const StoredTree stored = StoreSphere(build);
    const Result<Tree> read = Read(stored.key, AsVersion2(stored));
    if (build == BuildKind::kBox) {
      ASSERT_EQ(stored.tree.stats.leaf_histogram.size(), 66u);
      ASSERT_FALSE(read.ok()) << "its one leaf has more than 64 triangles: how many is not told";
      EXPECT_EQ(read.error().code, ErrorCode::kCorrupt);
      continue;
    }
    ASSERT_TRUE(read.ok()) << Name(build) << ": " << read.error().message;
    EXPECT_EQ(read->stats, stored.tree.stats);
    EXPECT_EQ(Write(stored.key, *read), stored.bytes) << Name(build);
  }
}

TEST(TreeFile, WithACountBeyondItsLengthAllocatesNothingForIt) {
  const StoredTree stored = StoreSphere(BuildKind::kKdSah);
  // Header 16, digest 32, triangles 8, build 1, revision 4, bounds 24, root 4, stack 4; then the
  // number of nodes.
  const std::size_t count_at = 16 + 32 + 8 + 1 + 4 + 24 + 4 + 4;
  std::uint64_t count = 0;
  std::memcpy(&count, stored.bytes.data() + count_at, sizeof count);
  ASSERT_EQ(count, stored.tree.wide.nodes.size()) << "the test knows the layout";
  for (const std::uint64_t lie :
       {std::uint64_t{1} << 60, ~std::uint64_t{0}, stored.bytes.size() / 8}) {
    FileBytes other = stored.bytes;
    std::memcpy(other.data() + count_at, &lie, sizeof lie);
    FixDigest(&other);
    const Result<Tree> read = Read(stored.key, other);
    ASSERT_FALSE(read.ok());
    EXPECT_EQ(read.error().code, ErrorCode::kCorrupt);
  }
}

TEST(TreeFile, WithAStructureThatCannotBeTraversedIsRefusedThoughItsDigestFits) {
  const StoredTree stored = StoreSphere(BuildKind::kKdSah);
  Tree bad = stored.tree;
  bad.wide.blocks.at(0).id[1] = static_cast<PrimitiveId>(stored.key.triangle_count);
  EXPECT_FALSE(Read(stored.key, Write(stored.key, bad)).ok()) << "no such triangle";

  bad = stored.tree;
  ASSERT_FALSE(bad.wide.nodes.empty());
  bad.wide.nodes.back().child[0] = 0;
  EXPECT_FALSE(Read(stored.key, Write(stored.key, bad)).ok()) << "a child above its parent";

  bad = stored.tree;
  bad.wide.nodes.at(0).order[3] ^= 1;
  EXPECT_FALSE(Read(stored.key, Write(stored.key, bad)).ok()) << "a child twice in the order";

  bad = stored.tree;
  bad.wide.blocks.back().id[0] &= LeafBlock::kIdMask;
  EXPECT_FALSE(Read(stored.key, Write(stored.key, bad)).ok()) << "a leaf without an end";

  bad = stored.tree;
  --bad.wide.stack_size;
  EXPECT_FALSE(Read(stored.key, Write(stored.key, bad)).ok()) << "a stack that would overflow";
}

TEST(TreeFile, PassesOnAnErrorOfTheDisk) {
  const StoredTree stored = StoreSphere(BuildKind::kKdSah);
  SimulatedDisk disk;
  BlobStore store(&disk, "folder");
  ASSERT_TRUE(store.Open().ok());
  disk.SetContents("folder/file", stored.bytes);
  for (std::uint64_t n = 1; n < 3; ++n) {
    disk.FailAt(n, ErrorCode::kIo);
    auto file = store.Read("file");
    ASSERT_TRUE(file.ok());
    const Result<Tree> read = ReadTreeFile(stored.key, *std::move(file));
    ASSERT_FALSE(read.ok()) << "operation " << n;
    EXPECT_EQ(read.error().code, ErrorCode::kIo);
  }
}

std::vector<ParsedMesh> MeshesOfBothVertexTypes() {
  std::vector<ParsedMesh> meshes;
  meshes.push_back(Prepare(test::RoundToFloat(test::IcoSphere({0, 0, 0}, 1, 1))));
  meshes.push_back(Prepare(test::IcoSphere({0.1, 0.2, 0.3}, 1, 1)));
  MeshData partly_degenerate = test::Soup(37, 0.1, 11);
  for (std::size_t i = 0; i < 37; i += 5) {
    partly_degenerate.triangles[i][2] = partly_degenerate.triangles[i][0];
  }
  meshes.push_back(Prepare(partly_degenerate));
  return meshes;
}

TEST(MeshFile, GivesBackTheSameMesh) {
  const std::vector<ParsedMesh> meshes = MeshesOfBothVertexTypes();
  EXPECT_FALSE(meshes[0].mesh.has_double_vertices());
  EXPECT_TRUE(meshes[1].mesh.has_double_vertices());
  for (const ParsedMesh& mesh : meshes) {
    const FileBytes bytes = Write(mesh);
    const Result<ParsedMesh> read = Read(kMesh, bytes);
    ASSERT_TRUE(read.ok()) << read.error().message;
    EXPECT_EQ(read->facts, mesh.facts);
    EXPECT_EQ(read->mesh.frame(), mesh.mesh.frame());
    EXPECT_EQ(read->mesh.bounds(), mesh.mesh.bounds());
    EXPECT_EQ(read->mesh.vertex_count(), mesh.mesh.vertex_count());
    EXPECT_EQ(read->mesh.degenerate_flags(), mesh.mesh.degenerate_flags());
    EXPECT_EQ(read->mesh.degenerate_count(), mesh.mesh.degenerate_count());
    EXPECT_EQ(read->mesh.shortest_edge(), mesh.mesh.shortest_edge());
    EXPECT_EQ(read->mesh.bytes(), mesh.mesh.bytes());
    for (PrimitiveId id = 0; id < mesh.mesh.triangle_count(); ++id) {
      for (int corner = 0; corner < 3; ++corner) {
        ASSERT_EQ(read->mesh.LocalCorner(id, corner), mesh.mesh.LocalCorner(id, corner));
      }
    }
    EXPECT_EQ(Write(*read), bytes);
  }
}

TEST(MeshFile, NoticesEveryDamage) {
  for (const ParsedMesh& mesh : MeshesOfBothVertexTypes()) {
    ExpectEveryDamageIsNoticed(Write(mesh), [&](const FileBytes& bytes) {
      const Result<ParsedMesh> read = Read(kMesh, bytes);
      return !read.ok() && read.error().code == ErrorCode::kCorrupt;
    });
  }
}

TEST(MeshFile, IsRefusedForAnotherMesh) {
  EXPECT_FALSE(Read(kOtherMesh, Write(MeshesOfBothVertexTypes()[0])).ok());
}

TEST(MeshFile, IsNoTreeFile) {
  const StoredTree stored = StoreSphere(BuildKind::kKdSah);
  EXPECT_FALSE(Read(kMesh, stored.bytes).ok());
  EXPECT_FALSE(Read(stored.key, Write(MeshesOfBothVertexTypes()[0])).ok());
}

}  // namespace
}  // namespace kdray::core
