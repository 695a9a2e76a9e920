// SPDX-License-Identifier: Apache-2.0
#include "core/store/tree_file.h"

#include <optional>
#include <utility>

#include "core/store/checked_file.h"
#include "core/store/facts_codec.h"

namespace kdray::core {

template <>
inline constexpr bool kStorable<WideNode> = true;
template <>
inline constexpr bool kStorable<LeafBlock> = true;

namespace {

// Increment the version when the layout below, or that of a node or block, changes.
constexpr FileKind kTreeFileKind{"kdraytre", 3, 2};
constexpr std::uint32_t kFirstWithMaxLeaf = 3;

void PutWideTree(const WideTree& tree, CheckedWriter* writer) {
  writer->Put(tree.bounds);
  writer->Put(tree.root);
  writer->Put(tree.stack_size);
  writer->PutArray(std::span(tree.nodes));
  writer->PutArray(std::span(tree.blocks));
}

void GetWideTree(CheckedReader* reader, WideTree* tree) {
  tree->bounds = reader->Get<Bounds3f>();
  tree->root = reader->Get<std::uint32_t>();
  tree->stack_size = reader->Get<std::uint32_t>();
  reader->GetArray(&tree->nodes);
  reader->GetArray(&tree->blocks);
}

}  // namespace

Result<NewBlob> WriteTreeFile(const TreeFileKey& key, const Tree& tree, NewBlob blob,
                              const CancelToken& cancel) {
  CheckedWriter writer(std::move(blob), kTreeFileKind, cancel);
  writer.Put(key.mesh);
  writer.Put(std::uint64_t{key.triangle_count});
  PutEnum(key.build, &writer);
  writer.Put(kBuilderRevision);
  PutWideTree(tree.wide, &writer);
  PutTreeStats(tree.stats, &writer);
  return std::move(writer).Finish();
}

Result<Tree> ReadTreeFile(const TreeFileKey& key, std::unique_ptr<ReadableFile> file,
                          const CancelToken& cancel) {
  CheckedReader reader(std::move(file), kTreeFileKind, cancel);
  const bool expected =
      reader.Get<Sha256Digest>() == key.mesh && reader.Get<std::uint64_t>() == key.triangle_count &&
      GetEnum<BuildKind>(&reader) == key.build && reader.Get<std::uint32_t>() == kBuilderRevision;
  if (!expected) reader.Fail();
  Tree tree;
  tree.build = key.build;
  GetWideTree(&reader, &tree.wide);
  std::optional<TreeStats> stats =
      GetTreeStats(reader.version() < kFirstWithMaxLeaf ? TreeStatsLayout::kWithoutMaxLeaf
                                                        : TreeStatsLayout::kWithMaxLeaf,
                   &reader);
  if (stats) {
    tree.stats = *std::move(stats);
  } else {
    reader.Fail();
  }
  Status status = reader.Finish();
  if (status.ok()) status = tree.wide.Validate(key.triangle_count, cancel);
  if (!status.ok()) return std::move(status).error();
  return tree;
}

}  // namespace kdray::core
