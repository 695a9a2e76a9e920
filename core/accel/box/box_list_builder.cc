// SPDX-License-Identifier: Apache-2.0
#include "core/accel/box/box_list_builder.h"

#include "core/accel/build_monitor.h"

namespace kdray::core {

Result<BoxList> BuildBoxList(const TriangleMesh& mesh, const BuildOptions& options) {
  BuildMonitor monitor(options);
  BoxList box;
  box.primitives.reserve(mesh.triangle_count() - mesh.degenerate_count());
  Bounds3d bounds = Bounds3d::Empty();
  CancelPoll poll = monitor.MakePoll();
  PolledLoop(mesh.triangle_count(), 32, &poll, [&](std::size_t i) {
    const PrimitiveId id = static_cast<PrimitiveId>(i);
    if (mesh.IsDegenerate(id)) return;
    box.primitives.push_back(id);
    for (int corner = 0; corner < 3; ++corner) bounds.Extend(mesh.LocalCorner(id, corner));
  });
  if (!bounds.IsEmpty()) box.bounds = RoundOutward(bounds);
  const Status status = monitor.Finish();
  if (!status.ok()) return status.error();
  return box;
}

TreeStats ComputeStats(const BoxList& box, const SahCost& cost, const CancelToken&) {
  TreeStats stats;
  stats.nodes = 1;
  stats.bytes = box.bytes();
  stats.traversal_cost = cost.traversal;
  stats.intersection_cost = cost.intersection;
  stats.sah_cost = cost.Leaf(box.primitives.size());
  CountLeaf(box.primitives.size(), 0, &stats);
  return stats;
}

}  // namespace kdray::core
