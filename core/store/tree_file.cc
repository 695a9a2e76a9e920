#include "core/store/tree_file.h"

#include <utility>

#include "core/store/checked_file.h"
#include "core/store/facts_codec.h"

namespace kdray::core {

template <>
inline constexpr bool kStorable<KdNode> = true;
template <>
inline constexpr bool kStorable<BvhNode> = true;

namespace {

// Raise the version whenever the layout below, or that of a node, changes.
constexpr FileKind kTreeFileKind{"kdraytre", 1};

void PutStructure(const BoxList& box, CheckedWriter* writer) {
  writer->Put(box.bounds);
  writer->PutArray(std::span(box.primitives));
}
void PutStructure(const Bvh& bvh, CheckedWriter* writer) {
  writer->PutArray(std::span(bvh.nodes));
  writer->PutArray(std::span(bvh.primitives));
}
void PutStructure(const KdTree& tree, CheckedWriter* writer) {
  writer->Put(tree.bounds);
  writer->PutArray(std::span(tree.nodes));
  writer->PutArray(std::span(tree.primitives));
}

void GetStructure(CheckedReader* reader, BoxList* box) {
  box->bounds = reader->Get<Bounds3f>();
  box->primitives = reader->GetArray<PrimitiveId>();
}
void GetStructure(CheckedReader* reader, Bvh* bvh) {
  bvh->nodes = reader->GetArray<BvhNode>();
  bvh->primitives = reader->GetArray<PrimitiveId>();
}
void GetStructure(CheckedReader* reader, KdTree* tree) {
  tree->bounds = reader->Get<Bounds3f>();
  tree->nodes = reader->GetArray<KdNode>();
  tree->primitives = reader->GetArray<PrimitiveId>();
}

// The structure that a build makes, empty.
std::variant<BoxList, Bvh, KdTree> StructureOf(BuildKind build) {
  switch (build) {
    case BuildKind::kBox:
      return BoxList{};
    case BuildKind::kBvh:
      return Bvh{};
    case BuildKind::kKdSah:
    case BuildKind::kKdBinned:
    case BuildKind::kKdCyclic:
    case BuildKind::kKdMedian:
      break;
  }
  return KdTree{};
}

}  // namespace

Result<NewBlob> WriteTreeFile(const TreeFileKey& key, const Tree& tree, NewBlob blob) {
  CheckedWriter writer(std::move(blob), kTreeFileKind);
  writer.Put(key.mesh);
  writer.Put(std::uint64_t{key.triangle_count});
  PutEnum(key.build, &writer);
  writer.Put(kBuilderRevision);
  std::visit([&](const auto& structure) { PutStructure(structure, &writer); }, tree.structure);
  PutTreeStats(tree.stats, &writer);
  return std::move(writer).Finish();
}

Result<Tree> ReadTreeFile(const TreeFileKey& key, std::unique_ptr<ReadableFile> file) {
  CheckedReader reader(std::move(file), kTreeFileKind);
  const bool expected = reader.Get<Sha256Digest>() == key.mesh &&
                        reader.Get<std::uint64_t>() == key.triangle_count &&
                        GetEnum(BuildKind::kBox, &reader) == key.build &&
                        reader.Get<std::uint32_t>() == kBuilderRevision;
  if (!expected) reader.Fail();
  Tree tree;
  tree.build = key.build;
  tree.structure = StructureOf(key.build);
  std::visit([&](auto& structure) { GetStructure(&reader, &structure); }, tree.structure);
  tree.stats = GetTreeStats(&reader);
  Status status = reader.Finish();
  if (status.ok()) {
    status =
        std::visit([&](const auto& s) { return s.Validate(key.triangle_count); }, tree.structure);
  }
  if (!status.ok()) return std::move(status).error();
  return tree;
}

}  // namespace kdray::core
