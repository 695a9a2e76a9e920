// SPDX-License-Identifier: Apache-2.0
// Tables of rays from rows in memory, and sinks that keep the rows of answers.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "api/ray_table.h"
#include "api/row_sink.h"

namespace kdray::test {

/// One ray, its numbers in the order in which a table gives them.
template <class T>
struct RayRow {
  T ox, oy, oz, t_min, dx, dy, dz, t_max;
};
static_assert(sizeof(RayRow<float>) == api::kRayNumbers * sizeof(float));

/// Rows and the table that reads them.
template <class T>
class RayRows {
 public:
  explicit RayRows(std::vector<RayRow<T>> rows) : rows_(std::move(rows)) {
    std::vector<T> numbers;
    for (const RayRow<T>& r : rows_) {
      numbers.insert(numbers.end(), {r.ox, r.oy, r.oz, r.dx, r.dy, r.dz, r.t_min, r.t_max});
    }
    data_ = std::make_unique<std::string>(numbers.size() * sizeof(T), '\0');
    if (!numbers.empty()) std::memcpy(data_->data(), numbers.data(), data_->size());
    table_ = *api::RayTable::FromNpy({sizeof(T) == 4 ? api::NumberType::kF4 : api::NumberType::kF8,
                                      false,
                                      {rows_.size(), 8},
                                      *data_},
                                     0, 0, rows_.size());
  }
  const std::vector<RayRow<T>>& rows() const { return rows_; }
  const api::RayTable& table() const { return table_; }

 private:
  std::vector<RayRow<T>> rows_;
  std::unique_ptr<std::string> data_;  ///< stays where it is when this is moved
  api::RayTable table_;
};

/// All rows of a table as doubles.
inline std::vector<RayRow<double>> RowsOf(const api::RayTable& table) {
  std::vector<RayRow<double>> rows;
  for (std::size_t i = 0; i < table.size(); ++i) {
    double n[api::kRayNumbers] = {};
    if (table.row_type() == api::NumberType::kF4) {
      float narrow[api::kRayNumbers] = {};
      table.Read(i, narrow);
      std::copy(std::begin(narrow), std::end(narrow), n);
    } else {
      table.Read(i, n);
    }
    rows.push_back({n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7]});
  }
  return rows;
}

/// Keeps the rows of an answer in their order.
template <class Rows>
class Collected;

template <class Rows>
class CollectingSink : public api::RowSink<Rows> {
 public:
  api::Check Begin(std::size_t elements) override {
    elements_ += elements;
    return std::nullopt;
  }

 protected:
  /// Puts `values` to place `first`; takes no empty list of details.
  template <class T, class Values>
  void Keep(std::vector<T>* list, std::size_t first, const Values& values) {
    if (values.empty()) return;
    list->resize(std::max(list->size(), elements_));
    std::copy(values.begin(), values.end(), list->begin() + static_cast<std::ptrdiff_t>(first));
  }
  std::mutex mutex_;
  std::size_t elements_ = 0;
};

template <>
class Collected<api::ClosestRows> final : public CollectingSink<api::ClosestRows> {
 public:
  void Put(const api::ClosestRows& rows) override {
    const std::lock_guard lock(mutex_);
    Keep(&hits, rows.first_row, rows.hits.hits);
    Keep(&normals, rows.first_row, rows.hits.normals);
    Keep(&points, rows.first_row, rows.hits.points);
    Keep(&sides, rows.first_row, rows.hits.sides);
    Keep(&groups, rows.first_row, rows.hits.groups);
    Keep(&uvs, rows.first_row, rows.hits.uvs);
    Keep(&shading_normals, rows.first_row, rows.hits.shading_normals);
  }
  std::vector<api::RayHit> hits;
  std::vector<api::Vec3> normals, points, shading_normals;
  std::vector<std::int8_t> sides;
  std::vector<std::int32_t> groups;
  std::vector<std::array<double, 2>> uvs;
};

template <>
class Collected<api::AnyRows> final : public CollectingSink<api::AnyRows> {
 public:
  void Put(const api::AnyRows& rows) override {
    const std::lock_guard lock(mutex_);
    Keep(&occluded, rows.first_row, rows.occluded);
  }
  std::vector<std::uint8_t> occluded;
};

template <>
class Collected<api::CountRows> final : public CollectingSink<api::CountRows> {
 public:
  void Put(const api::CountRows& rows) override {
    const std::lock_guard lock(mutex_);
    Keep(&counts, rows.first_row, rows.counts);
  }
  std::vector<std::uint32_t> counts;
};

template <>
class Collected<api::AllRows> final : public CollectingSink<api::AllRows> {
 public:
  void Put(const api::AllRows& rows) override {
    const std::lock_guard lock(mutex_);
    Keep(&hits, rows.first_hit, rows.hits.hits);
    Keep(&sides, rows.first_hit, rows.hits.sides);
    counts.resize(std::max(counts.size(), rows.first_row + rows.size()));
    std::copy(rows.counts.begin(), rows.counts.end(),
              counts.begin() + static_cast<std::ptrdiff_t>(rows.first_row));
  }
  std::vector<std::uint32_t> counts;
  std::vector<api::RayHit> hits;
  std::vector<std::int8_t> sides;
};

}  // namespace kdray::test
