// SPDX-License-Identifier: Apache-2.0
#include "server/request_memory.h"

#include <algorithm>
#include <chrono>
#include <iterator>
#include <optional>
#include <string>

namespace kdray::server {

using api::Problem;

api::Outcome<RequestMemory::Share> RequestMemory::Take(std::uint64_t bytes, api::ErrorCode never,
                                                       std::uint64_t lender_bytes) {
  if (auto problem = Charge(bytes, bytes, never, lender_bytes)) return *std::move(problem);
  return Share(this, bytes, lender_bytes);
}

api::Check RequestMemory::Share::Grow(std::uint64_t bytes, api::ErrorCode never) {
  if (auto problem = memory_->Charge(bytes, bytes_ + bytes, never, lender_bytes_)) return problem;
  bytes_ += bytes;
  return std::nullopt;
}

// `bytes` more for a request that will hold `total`.
api::Check RequestMemory::Charge(std::uint64_t bytes, std::uint64_t total, api::ErrorCode never,
                                 std::uint64_t lender_bytes) {
  const std::uint64_t left_to_others = IsSmall(total) ? 0 : own_ / 8;
  const std::uint64_t most = MostBytes(lender_bytes) - left_to_others;
  if (total > most) return NeverFits(total, most, never, lender_bytes);
  std::unique_lock lock(mutex_);
  const auto needed = [&] { return used_ + bytes + left_to_others; };
  const auto fits = [&] { return needed() <= own_ + borrowed_.bytes(); };
  bool has_waited = false;
  while (!fits()) {
    if (needed() <= MostBytes() && Borrow(needed(), &lock)) continue;
    if (std::exchange(has_waited, true)) return FullLocked(bytes);
    returned_.wait_for(lock, settle_time_, fits);
  }
  UseLocked(bytes);
  return std::nullopt;
}

// Borrows towards `needed` bytes in all, which are at most MostBytes().
bool RequestMemory::Borrow(std::uint64_t needed, std::unique_lock<std::mutex>* lock) {
  const std::uint64_t present = own_ + borrowed_.bytes();
  // In pieces, because an answer grows in small steps.
  const std::uint64_t piece = std::max(needed - present, own_ / 16);
  const std::uint64_t wanted = std::min(piece, MostBytes() - present);
  // Without the lock: the lender may evict trees.
  lock->unlock();
  std::optional<core::MemoryCharge> more = lender_->TryReserve(wanted);
  if (!more) more = lender_->TryReserve(needed - present);
  lock->lock();
  if (!more) return false;
  borrowed_.Add(*std::move(more));
  return true;
}

// A body that began now would be the newest, so no other body gives way to it.
api::Check RequestMemory::CheckBody(std::uint64_t bytes) const {
  if (bytes > MostBodyBytes()) {
    return NeverFits(bytes, MostBodyBytes(), api::ErrorCode::kBodyTooLarge);
  }
  std::unique_lock lock(mutex_);
  const auto fits = [&] { return FitsBodyLocked(bytes, bytes); };
  if (!returned_.wait_for(lock, settle_time_, fits)) return FullLocked(bytes);
  return std::nullopt;
}

bool RequestMemory::FitsBodyLocked(std::uint64_t bytes, std::uint64_t total,
                                   std::uint64_t returned) const {
  const std::uint64_t left_to_others = IsSmall(total) ? 0 : own_ / 4;
  const std::uint64_t used = used_ - returned;
  const std::uint64_t borrowed = returned == 0 ? borrowed_.bytes() : BorrowedAt(used);
  return used + bytes + left_to_others <= own_ + borrowed;
}

// What stays borrowed when memory is returned: small requests keep their eighth.
std::uint64_t RequestMemory::BorrowedAt(std::uint64_t used) const {
  const std::uint64_t wanted = used + own_ / 8;
  return std::min(borrowed_.bytes(), wanted > own_ ? wanted - own_ : 0);
}

Problem RequestMemory::FullLocked(std::uint64_t bytes) const {
  return Problem{.code = api::ErrorCode::kMemoryFull,
                 .detail = "other requests hold the memory that this one needs",
                 .limit = static_cast<double>(MostBytes()),
                 .actual = static_cast<double>(used_) + static_cast<double>(bytes)};
}

Problem RequestMemory::NeverFits(std::uint64_t bytes, std::uint64_t most, api::ErrorCode code,
                                 std::uint64_t lender_bytes) const {
  const bool is_beside_tree = MostBytes(lender_bytes) < MostBytes();
  return Problem{
      .code = code,
      .detail =
          "this request needs " + std::to_string(bytes) +
          " bytes of memory at once; under this server's --memory-limit at most " +
          std::to_string(most) + " are possible" +
          (is_beside_tree ? " beside the tree, which takes " + std::to_string(lender_bytes) : ""),
      .limit = static_cast<double>(most),
      .actual = static_cast<double>(bytes)};
}

void RequestMemory::Return(std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  ReturnLocked(bytes);
}

// The pool may keep what requests do not use. Beyond the own bytes nothing is borrowed for it.
void RequestMemory::UseLocked(std::uint64_t bytes) {
  used_ += bytes;
  pool_.KeepAtMost(own_ - std::min(own_, used_));
}

void RequestMemory::ReturnLocked(std::uint64_t bytes) {
  used_ -= bytes;
  pool_.KeepAtMost(own_ - std::min(own_, used_));
  borrowed_.Shrink(BorrowedAt(used_));
  returned_.notify_all();
}

std::uint64_t RequestMemory::used() const {
  const std::lock_guard lock(mutex_);
  return used_;
}

std::uint64_t RequestMemory::borrowed() const {
  const std::lock_guard lock(mutex_);
  return borrowed_.bytes();
}

// `bytes` more for a body; false when it is refused.
bool RequestMemory::Grow(Body::Held* body, std::uint64_t bytes) {
  std::unique_lock lock(mutex_);
  const std::uint64_t total = body->charged + bytes;
  const auto newer_bytes = [&] {
    std::uint64_t newer = 0;
    for (auto next = std::next(body->place); next != bodies_.end(); ++next) {
      newer += (*next)->charged;
    }
    return newer;
  };
  // Room that is free, or that newer bodies hold.
  const auto has_room = [&] {
    return body->refused || FitsBodyLocked(bytes, total) ||
           (newer_bytes() != 0 && FitsBodyLocked(bytes, total, newer_bytes()));
  };
  if (!returned_.wait_for(lock, settle_time_, has_room) || body->refused) return false;
  if (!FitsBodyLocked(bytes, total)) {
    while (!FitsBodyLocked(bytes, total) && std::next(body->place) != bodies_.end()) {
      const std::shared_ptr<Body::Held> newest = std::move(bodies_.back());
      bodies_.pop_back();
      ReturnLocked(std::exchange(newest->charged, 0));
      // Their bytes are freed here: a thread that waits for its client could not do so in time.
      const std::lock_guard parts_lock(newest->parts_mutex);
      newest->refused = true;
      newest->parts = {};
    }
  }
  UseLocked(bytes);
  body->charged += bytes;
  return true;
}

RequestMemory::Body::Body(RequestMemory* memory)
    : memory_(memory), held_(std::make_shared<Held>()) {
  const std::lock_guard lock(memory_->mutex_);
  held_->place = memory_->bodies_.insert(memory_->bodies_.end(), held_);
}

RequestMemory::Body::~Body() {
  const std::lock_guard lock(memory_->mutex_);
  if (held_->refused || held_->place == memory_->bodies_.end()) return;
  memory_->bodies_.erase(held_->place);
  memory_->ReturnLocked(held_->charged);
}

api::Check RequestMemory::Body::Append(std::span<const std::byte> piece) {
  const std::uint64_t bytes = piece.size();
  received_ += bytes;
  if (received_ > memory_->MostBodyBytes()) {
    return memory_->NeverFits(received_, memory_->MostBodyBytes(), api::ErrorCode::kBodyTooLarge);
  }
  if (!memory_->Grow(held_.get(), bytes)) return Full(bytes);
  return Use([piece](Parts* parts) { parts->text.Append(piece); }, bytes);
}

api::Problem RequestMemory::Body::Full(std::uint64_t bytes) const {
  const std::lock_guard lock(memory_->mutex_);
  return memory_->FullLocked(bytes);
}

api::Outcome<GrowingBytes> RequestMemory::Body::TakeText() {
  GrowingBytes text;
  if (auto problem = Use([&text](Parts* parts) { text = std::move(parts->text); })) {
    return *std::move(problem);
  }
  return text;
}

void RequestMemory::Body::ReturnText(std::uint64_t bytes) {
  const std::lock_guard lock(memory_->mutex_);
  if (held_->refused) return;  // its whole charge is returned
  held_->charged -= bytes;
  memory_->ReturnLocked(bytes);
}

api::Check RequestMemory::Body::AddBlock() {
  const std::uint64_t bytes = memory_->pool_.block_bytes();
  if (!memory_->Grow(held_.get(), bytes)) return Full(bytes);
  api::ByteBlock block(&memory_->pool_);
  return Use([&block](Parts* parts) { parts->blocks.push_back(std::move(block)); }, bytes);
}

api::Outcome<RequestMemory::Body::Whole> RequestMemory::Body::Finish() {
  const std::lock_guard lock(memory_->mutex_);
  if (held_->refused) return memory_->FullLocked(0);
  memory_->bodies_.erase(held_->place);
  held_->place = memory_->bodies_.end();
  return Whole{std::move(held_->parts.text), Share(memory_, std::exchange(held_->charged, 0)),
               std::move(held_->parts.blocks)};
}

}  // namespace kdray::server
