// SPDX-License-Identifier: Apache-2.0
// Writes the answer of a batch, as JSON or .npy, while its rows arrive.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "api/batch_type.h"
#include "api/batch_work.h"
#include "api/byte_block.h"
#include "api/hit_encoder.h"
#include "api/row_sink.h"
#include "api/types.h"

namespace kdray::api {

/// The bytes are kept in pieces, as they were written: nothing is copied to join them. Memory:
/// that of the answer; a large array's pieces are whole blocks of the source.
template <class Rows>
class AnswerWriter final : public RowSink<Rows> {
 public:
  /// `shape` is that of a .npy array without the dimensions of an element; nullopt: the number of
  /// elements. `blocks` may be null.
  AnswerWriter(BatchType type, std::unique_ptr<const RowEncoder<Rows>> encoder,
               std::optional<std::vector<std::size_t>> shape, ChargeBytes charge = {},
               BlockSource* blocks = nullptr);

  Check Begin(std::size_t elements) override;
  void Put(const Rows& rows) override;

  /// The whole answer, in order, after all blocks. `report` has its lists of rows.
  Outcome<std::vector<ByteBlock>> Finish(const BatchReport& report) &&;

 private:
  void EndBlock();
  Check AddPiece(std::size_t bytes);
  ByteBlock Head() const;

  const BatchType type_;
  const std::unique_ptr<const RowEncoder<Rows>> encoder_;
  const std::optional<std::vector<std::size_t>> shape_;
  const ChargeBytes charge_;
  BlockSource* const blocks_;
  std::vector<ByteBlock> pieces_ = std::vector<ByteBlock>(1);  ///< the first is for the head
  std::size_t block_first_ = 0, block_elements_ = 0;
  std::size_t block_at_ = 0;  ///< where the block begins in the last piece

  std::mutex mutex_;
  std::vector<std::pair<std::size_t, ByteBlock>> texts_;  ///< of the block, with their first row
  Check problem_;
};

}  // namespace kdray::api
