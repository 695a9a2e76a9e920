// SPDX-License-Identifier: Apache-2.0
#include "core/store/facts_codec.h"

#include <cstddef>
#include <utility>
#include <vector>

namespace kdray::core {

void PutBool(bool value, CheckedWriter* writer) {
  writer->Put(static_cast<std::uint8_t>(value ? 1 : 0));
}
bool GetBool(CheckedReader* reader) { return reader->GetBelow(std::uint8_t{2}) == 1; }

void PutMeshFacts(const MeshFacts& facts, CheckedWriter* writer) {
  PutEnum(facts.format, writer);
  writer->Put(facts.file_bytes);
  writer->Put(facts.triangles);
  writer->Put(facts.dropped);
  writer->Put(facts.vertices);
  writer->Put(facts.bounds);
  writer->Put(facts.health.degenerate);
  writer->Put(facts.health.duplicate);
  writer->Put(facts.health.concave);
  writer->Put(facts.health.open_edges);
  writer->Put(facts.health.non_manifold_edges);
  PutBool(facts.health.closed, writer);
  writer->Put(facts.health.coordinate_resolution);
  // A second bit in the byte of the first, so older files can still be read.
  writer->Put(static_cast<std::uint8_t>((facts.double_vertices ? 1 : 0) +
                                        (facts.rounded_vertices ? 2 : 0)));
  PutBool(facts.wider_than_declared, writer);
  writer->Put(facts.frame.origin);
  writer->Put(std::int32_t{facts.frame.exponent});
  writer->Put(facts.shortest_edge);
  writer->Put(facts.memory_bytes);
  writer->Put(facts.parse_ms);
}

MeshFacts GetMeshFacts(CheckedReader* reader) {
  MeshFacts facts;
  facts.format = GetEnum<MeshFormat>(reader);
  facts.file_bytes = reader->Get<std::uint64_t>();
  facts.triangles = reader->Get<std::uint64_t>();
  facts.dropped = reader->Get<std::uint64_t>();
  facts.vertices = reader->Get<std::uint64_t>();
  facts.bounds = reader->Get<Bounds3d>();
  facts.health.degenerate = reader->Get<std::uint64_t>();
  facts.health.duplicate = reader->Get<std::uint64_t>();
  facts.health.concave = reader->Get<std::uint64_t>();
  facts.health.open_edges = reader->Get<std::uint64_t>();
  facts.health.non_manifold_edges = reader->Get<std::uint64_t>();
  facts.health.closed = GetBool(reader);
  facts.health.coordinate_resolution = reader->Get<double>();
  const auto vertices = reader->GetBelow(std::uint8_t{4});
  facts.double_vertices = (vertices & 1u) != 0;
  facts.rounded_vertices = (vertices & 2u) != 0;
  facts.wider_than_declared = GetBool(reader);
  facts.frame.origin = reader->Get<Vec3d>();
  facts.frame.exponent = reader->Get<std::int32_t>();
  facts.shortest_edge = reader->Get<double>();
  facts.memory_bytes = reader->Get<std::uint64_t>();
  facts.parse_ms = reader->Get<double>();
  return facts;
}

namespace {

template <class T>
void PutOptional(const std::optional<T>& value, CheckedWriter* writer) {
  PutBool(value.has_value(), writer);
  writer->Put(value.value_or(T()));
}
template <class T>
std::optional<T> GetOptional(CheckedReader* reader) {
  const bool is_there = GetBool(reader);
  const T value = reader->Get<T>();
  return is_there ? std::optional(value) : std::nullopt;
}

}  // namespace

void PutSurfaceFacts(const MeshFacts& facts, CheckedWriter* writer) {
  PutOptional(facts.area, writer);
  PutOptional(facts.volume, writer);
  PutOptional(facts.groups, writer);
}

void GetSurfaceFacts(CheckedReader* reader, MeshFacts* facts) {
  facts->area = GetOptional<double>(reader);
  facts->volume = GetOptional<double>(reader);
  facts->groups = GetOptional<std::uint32_t>(reader);
}

void PutTreeStats(const TreeStats& stats, CheckedWriter* writer) {
  writer->Put(stats.nodes);
  writer->Put(stats.leaves);
  writer->Put(stats.empty_leaves);
  writer->Put(stats.references);
  writer->Put(stats.max_depth);
  writer->PutArray(std::span(stats.leaf_histogram));
  writer->Put(stats.max_leaf);
  writer->Put(stats.bytes);
  writer->Put(stats.sah_cost);
  writer->Put(stats.traversal_cost);
  writer->Put(stats.intersection_cost);
}

namespace {

constexpr std::size_t kHistogramEntries = TreeStats::kHistogramLeaf + 2;

// The largest leaf by a histogram of the layout without max_leaf. It has an entry for every size up
// to that of the largest leaf, or it was capped: then its last entry counts leaves of any size.
std::optional<std::uint64_t> LargestLeaf(const std::vector<std::uint64_t>& histogram) {
  if (histogram.size() == kHistogramEntries) return std::nullopt;
  return histogram.empty() ? 0 : histogram.size() - 1;
}

// One entry for all leaves beyond kHistogramLeaf.
void CapHistogram(std::vector<std::uint64_t>* histogram) {
  if (histogram->size() <= kHistogramEntries) return;
  std::vector<std::uint64_t> capped(histogram->begin(), histogram->begin() + kHistogramEntries);
  for (std::size_t i = kHistogramEntries; i < histogram->size(); ++i) {
    capped.back() += (*histogram)[i];
  }
  *histogram = std::move(capped);
}

}  // namespace

std::optional<TreeStats> GetTreeStats(TreeStatsLayout layout, CheckedReader* reader) {
  TreeStats stats;
  stats.nodes = reader->Get<std::uint64_t>();
  stats.leaves = reader->Get<std::uint64_t>();
  stats.empty_leaves = reader->Get<std::uint64_t>();
  stats.references = reader->Get<std::uint64_t>();
  stats.max_depth = reader->Get<std::uint32_t>();
  stats.leaf_histogram = reader->GetArray<std::uint64_t>();
  std::optional<std::uint64_t> max_leaf;
  if (layout == TreeStatsLayout::kWithMaxLeaf) {
    if (stats.leaf_histogram.size() > kHistogramEntries) reader->Fail();
    max_leaf = reader->Get<std::uint64_t>();
  } else {
    max_leaf = LargestLeaf(stats.leaf_histogram);
    CapHistogram(&stats.leaf_histogram);
  }
  stats.bytes = reader->Get<std::uint64_t>();
  stats.sah_cost = reader->Get<double>();
  stats.traversal_cost = reader->Get<double>();
  stats.intersection_cost = reader->Get<double>();
  if (!max_leaf) return std::nullopt;
  stats.max_leaf = *max_leaf;
  return stats;
}

}  // namespace kdray::core
