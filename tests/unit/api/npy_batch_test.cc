// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "api/batch_codec.h"
#include "api/ray_table.h"
#include "tests/support/ray_rows.h"
#include "tests/unit/api/npy_bytes.h"

namespace kdray::api {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

template <class T>
NpyArray Array(std::vector<std::size_t> shape, const std::string& data, bool fortran = false) {
  return {sizeof(T) == 4 ? NumberType::kF4 : NumberType::kF8, fortran, std::move(shape), data};
}

/// The rows, which must be read as T.
template <class T>
std::vector<test::RayRow<double>> RowsOf(const Outcome<RayTable>& table) {
  EXPECT_EQ(table->row_type(), sizeof(T) == 4 ? NumberType::kF4 : NumberType::kF8);
  return test::RowsOf(*table);
}

TEST(RaysFromNpy, FillsTheIntervalOfRowsOfSix) {
  const std::string data = Bytes(Counted<float>(12));
  const Outcome<RayTable> table = RayTable::FromNpy(Array<float>({2, 6}, data), 0.5, kInfinity, 10);
  ASSERT_TRUE(table);
  EXPECT_THAT(table->shape(), ElementsAre(2));
  EXPECT_EQ(table->number_type(), NumberType::kF4);
  const test::RayRow<double> row = RowsOf<float>(table)[1];
  EXPECT_EQ(row.ox, 6);
  EXPECT_EQ(row.oy, 7);
  EXPECT_EQ(row.oz, 8);
  EXPECT_EQ(row.dx, 9);
  EXPECT_EQ(row.dy, 10);
  EXPECT_EQ(row.dz, 11);
  EXPECT_EQ(row.t_min, 0.5f);
  EXPECT_EQ(row.t_max, kInfinity);
}

TEST(RaysFromNpy, TakesTheIntervalOfRowsOfEightFromTheirColumns) {
  const std::string data = Bytes(Counted<double>(16));
  const Outcome<RayTable> table = RayTable::FromNpy(Array<double>({2, 8}, data), -1, -1, 10);
  ASSERT_TRUE(table);
  EXPECT_EQ(table->number_type(), NumberType::kF8);
  EXPECT_EQ(RowsOf<double>(table)[1].t_min, 14);
  EXPECT_EQ(RowsOf<double>(table)[1].t_max, 15);
  EXPECT_EQ(RowsOf<double>(table)[1].dz, 13);
}

TEST(RaysFromNpy, WidensFloatRowsWhenAFloatWouldMoveTheInterval) {
  const std::string data = Bytes(Counted<float>(6));
  const Outcome<RayTable> table = RayTable::FromNpy(Array<float>({1, 6}, data), 1e-6, 0.999999, 10);
  ASSERT_TRUE(table);
  EXPECT_EQ(RowsOf<double>(table)[0].t_min, 1e-6);
  EXPECT_EQ(RowsOf<double>(table)[0].t_max, 0.999999);
  EXPECT_EQ(RowsOf<double>(table)[0].dz, 5);
  EXPECT_EQ(table->number_type(), NumberType::kF4) << "the answer's type is still the request's";
}

TEST(RaysFromNpy, KeepsFloatRowsOfEightWhateverTheOptionsSay) {
  const std::string data = Bytes(Counted<float>(8));
  const Outcome<RayTable> table = RayTable::FromNpy(Array<float>({1, 8}, data), 1e-6, 0.999999, 10);
  ASSERT_TRUE(table);
  EXPECT_EQ(RowsOf<float>(table)[0].t_max, 7);
}

TEST(RaysFromNpy, TakesASingleRayAndNoRayAtAll) {
  const std::string data = Bytes(Counted<float>(6));
  const Outcome<RayTable> single = RayTable::FromNpy(Array<float>({6}, data), 0, kInfinity, 10);
  ASSERT_TRUE(single);
  EXPECT_THAT(single->shape(), IsEmpty());
  EXPECT_EQ(single->size(), 1u);
  const Outcome<RayTable> none = RayTable::FromNpy(Array<float>({4, 0, 6}, ""), 0, kInfinity, 10);
  ASSERT_TRUE(none);
  EXPECT_THAT(none->shape(), ElementsAre(4, 0));
  EXPECT_EQ(none->size(), 0u);
}

TEST(RaysFromNpy, NumbersTheRowsOfAFortranArrayInCOrder) {
  // Element (i, j, c) of shape (2, 3, 6) holds 100 i + 10 j + c.
  std::vector<double> elements;
  for (int c = 0; c < 6; ++c) {
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i < 2; ++i) elements.push_back(100 * i + 10 * j + c);
    }
  }
  const std::string data = Bytes(elements);
  const Outcome<RayTable> table =
      RayTable::FromNpy(Array<double>({2, 3, 6}, data, true), 0, kInfinity, 10);
  ASSERT_TRUE(table);
  EXPECT_THAT(table->shape(), ElementsAre(2, 3));
  const auto rows = RowsOf<double>(table);
  ASSERT_EQ(rows.size(), 6u);
  // Many rows at once, from any row on.
  for (std::size_t first = 0; first < 6; ++first) {
    std::vector<double> numbers((6 - first) * kRayNumbers);
    table->Read(first, numbers);
    EXPECT_EQ(std::memcmp(numbers.data(), &rows[first], numbers.size() * sizeof(double)), 0);
  }
  for (int i = 0; i < 2; ++i) {
    for (int j = 0; j < 3; ++j) {
      EXPECT_EQ(rows[static_cast<std::size_t>(3 * i + j)].ox, 100 * i + 10 * j);
      EXPECT_EQ(rows[static_cast<std::size_t>(3 * i + j)].dz, 100 * i + 10 * j + 5);
    }
  }
}

TEST(RaysFromNpy, ReadsElementsAtOddAddresses) {
  const std::string data = "x" + Bytes(Counted<double>(6));
  NpyArray array = Array<double>({1, 6}, data);
  array.data.remove_prefix(1);
  const Outcome<RayTable> table = RayTable::FromNpy(array, 0, kInfinity, 10);
  ASSERT_TRUE(table);
  EXPECT_EQ(RowsOf<double>(table)[0].dz, 5);
}

TEST(RaysFromNpy, KeepsRowsThatCannotBe) {
  const float nan = std::nanf("");
  const std::string data = Bytes(std::vector<float>{0, nan, 0, 0, 0, 0});
  const Outcome<RayTable> table = RayTable::FromNpy(Array<float>({1, 6}, data), 0, kInfinity, 10);
  ASSERT_TRUE(table);
  EXPECT_TRUE(std::isnan(RowsOf<float>(table)[0].oy));
}

TEST(RaysFromNpy, RefusesRowsOfAnotherLength) {
  for (const std::size_t columns : {0u, 1u, 3u, 5u, 7u, 9u}) {
    const std::string data = Bytes(Counted<float>(2 * columns));
    const Outcome<RayTable> table =
        RayTable::FromNpy(Array<float>({2, columns}, data), 0, kInfinity, 10);
    ASSERT_FALSE(table) << columns;
    EXPECT_EQ(table.problem().code, ErrorCode::kInvalidArray);
    EXPECT_THAT(table.problem().detail, HasSubstr("(2, " + std::to_string(columns) + ")"));
  }
  EXPECT_FALSE(RayTable::FromNpy(Array<float>({}, Bytes(Counted<float>(1))), 0, kInfinity, 10));
}

TEST(RaysFromNpy, TakesAsManyRowsAsTheLimitAndNoMore) {
  const std::string data = Bytes(Counted<float>(24));
  EXPECT_TRUE(RayTable::FromNpy(Array<float>({2, 2, 6}, data), 0, kInfinity, 4));
  const Outcome<RayTable> more = RayTable::FromNpy(Array<float>({2, 2, 6}, data), 0, kInfinity, 3);
  ASSERT_FALSE(more);
  EXPECT_EQ(more.problem().code, ErrorCode::kTooManyRays);
  EXPECT_EQ(more.problem().limit, 3);
  EXPECT_EQ(more.problem().actual, 4);
}

// ---- Arrays that are decoded while they arrive ----

std::string RayHeader(const std::string& rest) { return "{" + rest + "}"; }

TEST(ArrivingRays, AreRecognisedByTheirHeader) {
  const std::string header =
      RayHeader("'descr': '<f4', 'fortran_order': False, 'shape': (2, 3, 6), ");
  const std::string start = NpyFile(header, "the first bytes");
  const std::uint64_t bytes = NpyFile(header, "").size() + 2 * 3 * 6 * 4;
  for (const std::optional<std::uint64_t> declared :
       {std::optional(bytes), std::optional<std::uint64_t>()}) {
    const auto rays = RecogniseRays(start, declared, {}, {});
    ASSERT_TRUE(rays);
    EXPECT_EQ(rays->rows, 6U);
    EXPECT_THAT(rays->Shape(), ElementsAre(2, 3));
    EXPECT_EQ(rays->form.RowBytes(), 24U);
    EXPECT_EQ(rays->form.RayBytes(), 32U);
    EXPECT_EQ(rays->start.header_bytes + rays->start.data_bytes, bytes);
  }
  EXPECT_FALSE(RecogniseRays(start, bytes + 1, {}, {}));
  EXPECT_FALSE(RecogniseRays(start, bytes - 1, {}, {}));
  EXPECT_FALSE(RecogniseRays(start, 0, {}, {}));
  Limits few;
  few.max_rays = 5;
  EXPECT_FALSE(RecogniseRays(start, bytes, {}, few));
  RayOptions precise;
  precise.t_min = 0.1;
  EXPECT_FALSE(RecogniseRays(start, bytes, precise, {})) << "a float cannot hold it";
  precise.t_min = 0.5;
  EXPECT_TRUE(RecogniseRays(start, bytes, precise, {}));
}

TEST(ArrivingRays, AreNoOtherArraysAndNoDamagedOnes) {
  const auto recognised = [](const std::string& header) {
    return RecogniseRays(NpyFile(header, ""), std::nullopt, {}, {}).has_value();
  };
  const auto header = [](const std::string& descr, const std::string& order,
                         const std::string& shape) {
    return RayHeader("'descr': " + descr + ", 'fortran_order': " + order + ", 'shape': " + shape);
  };
  EXPECT_TRUE(recognised(header("'<f4'", "False", "(9, 6)")));
  EXPECT_TRUE(recognised(header("'<f8'", "False", "(9, 8)")));
  EXPECT_TRUE(recognised(header("'<f8'", "False", "(0, 8)")));
  for (const std::string& other :
       {header("'<f4'", "True", "(9, 6)"), header("'<f4'", "False", "(9, 7)"),
        header("'<f4'", "False", "()"), header("'<i4'", "False", "(9, 6)"),
        header("'>f4'", "False", "(9, 6)"), header("[('t', '<f4')]", "False", "(9, 6)"),
        header("'<f4'", "False", "(4294967296, 4294967296, 6)"),
        header("'<f4'", "False", "(0, 4294967296, 4294967296, 6)"),
        header("'<f4'", "False", "(1000000000, 6)"), header("'<f4'", "False", "(9, 6"),
        RayHeader(""), std::string()}) {
    EXPECT_FALSE(recognised(other)) << other;
  }
  const std::string whole = NpyFile(header("'<f4'", "False", "(9, 6)"), "");
  for (std::size_t bytes = 0; bytes < whole.size(); ++bytes) {
    EXPECT_FALSE(RecogniseRays(whole.substr(0, bytes), std::nullopt, {}, {})) << bytes;
  }
}

/// Rays i with the numbers 8 i to 8 i + 7, `rows_in_block` in a block.
template <class T>
RayTable TableOfBlocks(std::size_t rows, std::size_t rows_in_block) {
  RayBlocks blocks{.sent = sizeof(T) == 4 ? NumberType::kF4 : NumberType::kF8,
                   .rows = rows,
                   .rows_in_block = rows_in_block,
                   .blocks = {},
                   .invalid = {}};
  const std::vector<T> numbers = Counted<T>(rows * kRayNumbers);
  for (std::size_t first = 0; first < rows; first += rows_in_block) {
    const std::string part =
        Bytes(numbers).substr(first * kRayNumbers * sizeof(T),
                              std::min(rows_in_block, rows - first) * kRayNumbers * sizeof(T));
    ByteBlock block = ByteBlock::WithRoom(rows_in_block * kRayNumbers * sizeof(T));
    block.Extend(part.size());
    std::copy(part.begin(), part.end(), block.data());
    blocks.blocks.push_back(std::move(block));
  }
  return {{rows}, std::move(blocks)};
}

template <class T>
void ExpectReadable(std::size_t rows, std::size_t rows_in_block) {
  const RayTable table = TableOfBlocks<T>(rows, rows_in_block);
  EXPECT_EQ(table.size(), rows);
  for (std::size_t first = 0; first <= rows; ++first) {
    std::vector<T> numbers((rows - first) * kRayNumbers);
    table.Read(first, numbers);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      EXPECT_EQ(numbers[i], static_cast<T>(first * kRayNumbers + i));
    }
    if (first == rows) break;
    const std::span<const char> in_block = table.InBlock(first);
    const std::size_t left = std::min(rows_in_block - first % rows_in_block, rows - first);
    ASSERT_EQ(in_block.size(), left * kRayNumbers * sizeof(T));
    EXPECT_EQ(std::memcmp(in_block.data(), numbers.data(), in_block.size()), 0);
  }
}

TEST(RaysInBlocks, AreReadAcrossTheirBlocks) {
  ExpectReadable<float>(7, 3);
  ExpectReadable<double>(6, 3);
  ExpectReadable<double>(2, 5);
}

TEST(RaysInBlocks, AreFreedBlockByBlockWhenTheyHaveBeenRead) {
  RayTable table = TableOfBlocks<float>(8, 3);
  EXPECT_TRUE(table.MemoryOf(8).empty());
  const std::size_t block = 3 * kRayNumbers * sizeof(float);
  EXPECT_EQ(table.FreeBlocks(2), 0U);
  EXPECT_EQ(table.FreeBlocks(3), block);
  EXPECT_EQ(table.FreeBlocks(5), 0U);
  std::vector<float> numbers(5 * kRayNumbers);
  table.Read(3, numbers);
  EXPECT_EQ(numbers[0], 24);
  EXPECT_EQ(table.FreeBlocks(8), 2 * block) << "the last one is not full";
  EXPECT_EQ(table.FreeBlocks(8), 0U);
  EXPECT_EQ(table.size(), 8U);
}

}  // namespace
}  // namespace kdray::api
