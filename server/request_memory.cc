#include "server/request_memory.h"

#include <algorithm>
#include <iterator>

namespace kdray::server {

using api::Problem;

// `text_mutex` is taken after the budget's mutex or alone.
struct RequestMemory::Body::Held {
  // Guarded by the budget's mutex.
  std::uint64_t charged = 0;
  Bodies::iterator place;

  std::mutex text_mutex;
  GrowingBytes text;
  bool refused = false;  // written with both mutexes held
};

api::Outcome<RequestMemory::Share> RequestMemory::Take(std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  if (used_ > 0 && !FitsLocked(bytes)) return FullLocked(bytes);
  used_ += bytes;
  return Share(this, bytes);
}

api::Check RequestMemory::Check(std::uint64_t bytes) const {
  const std::lock_guard lock(mutex_);
  if (used_ > 0 && !FitsLocked(bytes)) return FullLocked(bytes);
  return std::nullopt;
}

api::Check RequestMemory::Share::Grow(std::uint64_t bytes) {
  const std::lock_guard lock(memory_->mutex_);
  const bool is_alone = memory_->used_ == bytes_;
  if (!is_alone && !memory_->FitsLocked(bytes)) return memory_->FullLocked(bytes);
  memory_->used_ += bytes;
  bytes_ += bytes;
  return std::nullopt;
}

Problem RequestMemory::FullLocked(std::uint64_t bytes) const {
  return Problem{.code = api::ErrorCode::kMemoryFull,
                 .detail = "other requests hold the memory that this one needs",
                 .limit = static_cast<double>(limit_),
                 .actual = static_cast<double>(used_) + static_cast<double>(bytes)};
}

void RequestMemory::Return(std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  used_ -= bytes;
}

std::uint64_t RequestMemory::used() const {
  const std::lock_guard lock(mutex_);
  return used_;
}

// `bytes` more for a body; false when it is refused.
bool RequestMemory::Grow(Body::Held* body, std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  if (body->refused) return false;
  const bool is_alone = used_ == body->charged;
  if (!is_alone && !FitsLocked(bytes)) {
    const auto after = std::next(body->place);
    std::uint64_t newer = 0;
    for (auto next = after; next != bodies_.end(); ++next) newer += (*next)->charged;
    const std::uint64_t others = used_ - newer;
    if (others != body->charged && (bytes > limit_ || others > limit_ - bytes)) return false;
    while (used_ != body->charged && !FitsLocked(bytes)) {
      const std::shared_ptr<Body::Held> newest = std::move(bodies_.back());
      bodies_.pop_back();
      used_ -= std::exchange(newest->charged, 0);
      // Their bytes are freed here: a thread that waits for its client could not do so in time.
      const std::lock_guard text_lock(newest->text_mutex);
      newest->refused = true;
      newest->text = GrowingBytes();
    }
  }
  used_ += bytes;
  body->charged += bytes;
  return true;
}

RequestMemory::Body::Body(RequestMemory* memory, std::uint64_t per_byte)
    : memory_(memory), per_byte_(per_byte), held_(std::make_shared<Held>()) {
  const std::lock_guard lock(memory_->mutex_);
  held_->place = memory_->bodies_.insert(memory_->bodies_.end(), held_);
}

RequestMemory::Body::~Body() {
  const std::lock_guard lock(memory_->mutex_);
  if (held_->refused || held_->place == memory_->bodies_.end()) return;
  memory_->bodies_.erase(held_->place);
  memory_->used_ -= held_->charged;
}

api::Check RequestMemory::Body::Append(std::span<const std::byte> piece) {
  const std::uint64_t bytes = piece.size() * per_byte_;
  if (memory_->Grow(held_.get(), bytes)) {
    const std::lock_guard text_lock(held_->text_mutex);
    if (!held_->refused) {
      held_->text.Append(piece);
      return std::nullopt;
    }
  }
  const std::lock_guard lock(memory_->mutex_);
  return memory_->FullLocked(bytes);
}

api::Outcome<RequestMemory::Body::Whole> RequestMemory::Body::Finish() {
  const std::lock_guard lock(memory_->mutex_);
  if (held_->refused) return memory_->FullLocked(0);
  memory_->bodies_.erase(held_->place);
  held_->place = memory_->bodies_.end();
  return Whole{std::move(held_->text), Share(memory_, std::exchange(held_->charged, 0))};
}

}  // namespace kdray::server
