// SPDX-License-Identifier: Apache-2.0
#include "api/answer_writer.h"

#include <algorithm>
#include <cstring>
#include <optional>
#include <string>

#include "api/json_text.h"
#include "api/npy.h"

namespace kdray::api {
namespace {

/// Answers up to this size are joined to one piece: a copy costs less than more sends.
constexpr std::size_t kJoinedBytes = 64 * 1024;

ByteBlock BlockOf(std::string_view text) {
  ByteBlock block(text.size());
  std::copy(text.begin(), text.end(), block.data());
  return block;
}

ByteBlock Joined(const std::vector<ByteBlock>& pieces, std::size_t bytes) {
  ByteBlock joined(bytes);
  char* out = joined.data();
  for (const ByteBlock& piece : pieces) out = PutWord(out, piece.view());
  return joined;
}

}  // namespace

template <class Rows>
AnswerWriter<Rows>::AnswerWriter(BatchType type, std::unique_ptr<const RowEncoder<Rows>> encoder,
                                 std::optional<std::vector<std::size_t>> shape, ChargeBytes charge,
                                 BlockSource* blocks)
    : type_(type),
      encoder_(std::move(encoder)),
      shape_(std::move(shape)),
      charge_(std::move(charge)),
      blocks_(blocks) {}

template <class Rows>
Check AnswerWriter<Rows>::Begin(std::size_t elements) {
  EndBlock();
  if (problem_) return problem_;
  block_first_ += std::exchange(block_elements_, elements);
  if (type_ == BatchType::kJson || elements == 0) return std::nullopt;
  const std::size_t bytes = elements * encoder_->ElementBytes();
  if (bytes > pieces_.back().room()) problem_ = AddPiece(bytes);
  if (problem_) return problem_;
  block_at_ = pieces_.back().size();
  pieces_.back().Extend(bytes);
  return std::nullopt;
}

// A piece with room for `bytes`, and for further blocks if the answer will fill at least half of
// one of the source.
template <class Rows>
Check AnswerWriter<Rows>::AddPiece(std::size_t bytes) {
  std::size_t left = bytes;
  if (shape_) {
    std::size_t elements = 1;
    for (const std::size_t length : *shape_) elements *= length;
    left = (elements - block_first_) * encoder_->ElementBytes();
  }
  const bool from_source =
      blocks_ != nullptr && bytes <= blocks_->block_bytes() && left >= blocks_->block_bytes() / 2;
  if (charge_) {
    if (auto problem = charge_(from_source ? blocks_->block_bytes() : bytes)) return problem;
  }
  ByteBlock piece = from_source ? ByteBlock(blocks_) : ByteBlock::WithRoom(bytes);
  pieces_.push_back(std::move(piece));
  return std::nullopt;
}

template <class Rows>
void AnswerWriter<Rows>::Put(const Rows& rows) {
  if (type_ == BatchType::kNpy) {
    if (block_elements_ == 0) return;
    const std::size_t first = rows.first_element() - block_first_;
    encoder_->PutNpy(rows, pieces_.back().data() + block_at_ + first * encoder_->ElementBytes());
    return;
  }
  ByteBlock most(encoder_->MostJsonBytes(rows));
  const char* end = encoder_->PutJson(rows, most.data());
  ByteBlock text = BlockOf(most.view().substr(0, static_cast<std::size_t>(end - most.data())));
  const std::lock_guard lock(mutex_);
  if (!problem_ && charge_) problem_ = charge_(text.size());
  if (!problem_) texts_.emplace_back(rows.first_row, std::move(text));
}

template <class Rows>
void AnswerWriter<Rows>::EndBlock() {
  std::sort(texts_.begin(), texts_.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  for (auto& [first_row, text] : texts_) {
    if (text.size() > 0) pieces_.push_back(std::move(text));
  }
  texts_.clear();
}

template <class Rows>
ByteBlock AnswerWriter<Rows>::Head() const {
  if (type_ == BatchType::kJson) return BlockOf("{\"results\":[");
  std::vector<std::size_t> shape =
      shape_.value_or(std::vector<std::size_t>{block_first_ + block_elements_});
  for (const std::size_t length : encoder_->ElementShape()) shape.push_back(length);
  return BlockOf(NpyHeader(encoder_->Descr(), shape));
}

template <class Rows>
Outcome<std::vector<ByteBlock>> AnswerWriter<Rows>::Finish(const BatchReport& report) && {
  EndBlock();
  if (problem_) return *std::move(problem_);
  pieces_.front() = Head();
  if (type_ == BatchType::kJson) {
    std::string end = "],";
    AppendRowLists(&end, report.invalid, report.truncated);
    end += '}';
    if (charge_) problem_ = charge_(end.size());
    if (problem_) return *std::move(problem_);
    pieces_.push_back(BlockOf(end));
  }
  std::size_t bytes = 0;
  for (const ByteBlock& piece : pieces_) bytes += piece.size();
  if (bytes <= kJoinedBytes && pieces_.size() > 1) {
    ByteBlock joined = Joined(pieces_, bytes);
    pieces_.clear();
    pieces_.push_back(std::move(joined));
  }
  return std::move(pieces_);
}

template class AnswerWriter<ClosestRows>;
template class AnswerWriter<AnyRows>;
template class AnswerWriter<CountRows>;
template class AnswerWriter<AllRows>;

}  // namespace kdray::api
