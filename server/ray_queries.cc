#include "server/ray_queries.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <variant>
#include <vector>

#include "core/base/parallel.h"
#include "core/render/shading.h"
#include "server/mapping.h"

namespace kdray::server {
namespace {

// Rays are handed to the tracer in blocks of this many: large enough for it to sort and share out,
// small enough that a converted copy of them costs little memory.
constexpr std::size_t kBlockRays = 131'072;
// Rows that one thread converts at a time.
constexpr std::size_t kGrainRows = 8192;

template <class T>
std::span<const T> RowsOf(const std::vector<T>& rows) {
  return rows;
}

// One block of a batch, in core's words. Called within the query arena.
template <class T>
class RayBlock {
 public:
  explicit RayBlock(std::span<const api::RayRow<T>> rows) : rays_(rows.size()) {
    core::ParallelFor(0, rows.size(), kGrainRows, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) rays_[i] = ToCore(rows[i]);
    });
  }
  core::RayBatch batch() const { return std::span<const core::RayOf<T>>(rays_); }
  void ListInvalid(std::size_t first_row, std::vector<std::uint64_t>* invalid) const {
    for (std::size_t i = 0; i < rays_.size(); ++i) {
      if (!core::IsValid(rays_[i])) invalid->push_back(first_row + i);
    }
  }

 private:
  std::vector<core::RayOf<T>> rays_;
};

// f(block, first row) for every block of the table; stops at the first error.
template <class F>
core::Status ForEachBlock(const api::RayTable& table, const F& f) {
  return std::visit(
      [&](const auto& rows) -> core::Status {
        for (std::size_t first = 0; first < rows.size(); first += kBlockRays) {
          const std::size_t count = std::min(kBlockRays, rows.size() - first);
          const RayBlock block(RowsOf(rows).subspan(first, count));
          if (core::Status status = f(block, first); !status.ok()) return status;
        }
        return {};
      },
      table.rows);
}

// Geometric normals and hit points, for those who ask.
class HitDetails {
 public:
  HitDetails(const core::TriangleMesh& mesh, const api::RayOptions& options, std::size_t rows,
             api::ClosestAnswer* answer)
      : mesh_(mesh), answer_(answer) {
    const auto asked = [&](api::RayField field) {
      return std::find(options.fields.begin(), options.fields.end(), field) != options.fields.end();
    };
    constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
    constexpr double kNoPoint = std::numeric_limits<double>::quiet_NaN();
    if (asked(api::RayField::kNormal)) answer->normals.assign(rows, {kNone, kNone, kNone});
    if (asked(api::RayField::kPoint)) {
      answer->points.assign(rows, {kNoPoint, kNoPoint, kNoPoint});
    }
  }
  bool wanted() const { return !answer_->normals.empty() || !answer_->points.empty(); }

  void Fill(std::size_t row, const core::Ray& ray, const core::Hit& hit) const {
    if (!hit.IsHit()) return;
    if (!answer_->normals.empty()) {
      const core::Vec3f n(core::UnitNormal(mesh_, hit.primitive_id));
      answer_->normals[row] = {n.x, n.y, n.z};
    }
    if (!answer_->points.empty()) {
      const core::Vec3d p = ray.origin + ray.direction * hit.t;
      answer_->points[row] = {p.x, p.y, p.z};
    }
  }

 private:
  const core::TriangleMesh& mesh_;
  api::ClosestAnswer* answer_;
};

}  // namespace

core::Status AnswerClosest(const core::Scene& scene, const api::RayTable& rays,
                           const api::RayOptions& options, const core::TraceOptions& trace,
                           api::ClosestAnswer* answer) {
  answer->hits.resize(rays.size());
  const HitDetails details(*scene.mesh, options, rays.size(), answer);
  std::vector<core::Hit> hits(std::min(rays.size(), kBlockRays));
  return ForEachBlock(rays, [&](const auto& block, std::size_t first_row) {
    const core::RayBatch batch = block.batch();
    const std::span<core::Hit> block_hits = std::span(hits).first(batch.size());
    core::Status status = core::TraceClosest(scene, batch, trace, block_hits);
    if (!status.ok()) return status;
    core::ParallelFor(0, batch.size(), kGrainRows, [&](std::size_t i, std::size_t last) {
      for (; i < last; ++i) {
        answer->hits[first_row + i] = ToApi(block_hits[i]);
        if (details.wanted()) details.Fill(first_row + i, batch[i], block_hits[i]);
      }
    });
    block.ListInvalid(first_row, &answer->invalid);
    return status;
  });
}

core::Status AnswerAny(const core::Scene& scene, const api::RayTable& rays,
                       const core::TraceOptions& trace, api::AnyAnswer* answer) {
  answer->occluded.resize(rays.size());
  return ForEachBlock(rays, [&](const auto& block, std::size_t first_row) {
    const core::RayBatch batch = block.batch();
    block.ListInvalid(first_row, &answer->invalid);
    return core::TraceAny(scene, batch, trace,
                          std::span(answer->occluded).subspan(first_row, batch.size()));
  });
}

}  // namespace kdray::server
