// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/ray_body.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <span>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "api/batch_codec.h"
#include "core/geometry/ray.h"
#include "server/handlers/answers.h"

namespace kdray::server {
namespace {

constexpr std::size_t kTextPieceBytes = std::size_t{64} << 10;
/// Received at once. The bytes are still in the second cache when they are decoded.
constexpr std::size_t kRowPieceBytes = std::size_t{256} << 10;

/// Whether all rays are valid. Looks at whole rays at once and never branches, which takes a tenth
/// of the time of IsValid() for each.
template <class T>
bool AreValid(std::span<const core::RayOf<T>> rays) {
  // GCC's vectors (manual, "Using Vector Instructions through Built-in Functions").
  using Numbers [[gnu::vector_size(4 * sizeof(T))]] = T;
  using Bits = std::conditional_t<sizeof(T) == 4, std::int32_t, std::int64_t>;
  using Mask [[gnu::vector_size(4 * sizeof(T))]] = Bits;
  constexpr Mask kVector = {-1, -1, -1, 0};  // and the fourth is t_min or t_max
  constexpr Bits kMagnitude = std::numeric_limits<Bits>::max();
  Mask all = {-1, -1, -1, -1};
  Bits has_zero = 0;
  for (const core::RayOf<T>& ray : rays) {
    Numbers origin, direction;
    std::memcpy(&origin, &ray.origin, sizeof(origin));
    std::memcpy(&direction, &ray.direction, sizeof(direction));
    const Mask is_finite = (origin - origin == 0) & (direction - direction == 0);
    const Mask is_ordered = origin <= direction;
    all &= (is_finite & kVector) | (is_ordered & ~kVector);
    Mask d;
    std::memcpy(&d, &ray.direction, sizeof(d));
    has_zero |= static_cast<Bits>(((d[0] | d[1] | d[2]) & kMagnitude) == 0);
  }
  return (all[0] & all[1] & all[2] & all[3]) != 0 && has_zero == 0;
}

/// Puts rows into the blocks of a body, as rays.
class RowReceiver {
 public:
  RowReceiver(api::ArrivingRays array, std::size_t block_bytes, RequestMemory::Body* body)
      : array_(std::move(array)), body_(*body) {
    rays_.sent = array_.form.sent;
    rays_.rows_in_block = block_bytes / array_.form.RayBytes();
  }

  /// Decodes the whole rows in `bytes`, which follow those of the last call, and counts the others.
  /// Returns how many bytes were used: all but an incomplete row.
  api::Outcome<std::size_t> Take(std::string_view bytes) {
    const Stopwatch decoding;
    const std::size_t row_bytes = array_.form.RowBytes();
    std::size_t used = 0;
    while (bytes.size() - used >= row_bytes && rays_.rows < array_.rows) {
      const std::size_t in_block = rays_.rows % rays_.rows_in_block;
      if (in_block == 0) {
        if (auto problem = body_.AddBlock()) return *std::move(problem);
      }
      const std::size_t rows = std::min({(bytes.size() - used) / row_bytes,
                                         rays_.rows_in_block - in_block, array_.rows - rays_.rows});
      const auto decode = [&](api::ByteBlock* block) {
        Decode(bytes.substr(used, rows * row_bytes), rows, block);
      };
      if (auto problem = body_.WriteToBlock(decode)) return *std::move(problem);
      rays_.rows += rows;
      used += rows * row_bytes;
    }
    if (rays_.rows == array_.rows) used = bytes.size();  // after the array; told in the end
    decode_ms_ += decoding.ms();
    return used;
  }

  double decode_ms() const { return decode_ms_; }
  const api::NpyStart& start() const { return array_.start; }
  api::RayTable Finish(std::vector<api::ByteBlock> blocks) && {
    rays_.blocks = std::move(blocks);
    return {array_.Shape(), std::move(rays_)};
  }

 private:
  void Decode(std::string_view bytes, std::size_t rows, api::ByteBlock* block) {
    if (array_.form.RayType() == api::NumberType::kF4) {
      Decode<float>(bytes, rows, block);
    } else {
      Decode<double>(bytes, rows, block);
    }
  }
  template <class T>
  void Decode(std::string_view bytes, std::size_t rows, api::ByteBlock* block) {
    // In pieces that stay in the first cache, where they are checked.
    constexpr std::size_t kPieceRows = 256;
    const std::size_t row_bytes = array_.form.RowBytes();
    for (std::size_t first = 0; first < rows; first += kPieceRows) {
      const std::size_t count = std::min(kPieceRows, rows - first);
      auto* const rays = reinterpret_cast<core::RayOf<T>*>(block->data() + block->size());
      array_.form.Read(bytes.data() + first * row_bytes,
                       std::span(reinterpret_cast<T*>(rays), count * api::kRayNumbers));
      block->Extend(count * sizeof(core::RayOf<T>));
      if (AreValid(std::span<const core::RayOf<T>>(rays, count))) [[likely]]
        continue;
      for (std::size_t i = 0; i < count; ++i) {
        if (!core::IsValid(rays[i])) [[unlikely]]
          rays_.invalid.push_back(rays_.rows + first + i);
      }
    }
  }

  const api::ArrivingRays array_;
  RequestMemory::Body& body_;
  api::RayBlocks rays_;
  double decode_ms_ = 0;
};

std::string_view AsText(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// The rest of a body whose first `taken` bytes are its text so far.
api::Outcome<RayBody> ReadRows(HttpPeer& peer, std::uint64_t max_bytes, std::uint64_t taken,
                               RowReceiver rows, RequestMemory::Body* body) {
  std::vector<std::byte> buffer(kRowPieceBytes);
  std::size_t kept = 0;  // an incomplete row at the beginning of the buffer
  const auto keep = [&](std::span<const std::byte> rest) {
    std::copy(rest.begin(), rest.end(), buffer.begin());
    kept = rest.size();
  };
  {
    const auto text = body->TakeText();
    if (!text) return text.problem();
    const std::string_view begun = text->view().substr(rows.start().header_bytes);
    const auto used = rows.Take(begun);
    if (!used) return used.problem();
    keep(std::as_bytes(std::span(begun)).subspan(*used));
    body->ReturnText(text->size());
  }
  for (;;) {
    const auto count = ReadPiece(peer, max_bytes, taken, std::span(buffer).subspan(kept));
    if (!count) return count.problem();
    if (*count == 0) break;
    taken += *count;
    const auto received = std::span(std::as_const(buffer)).first(kept + *count);
    const auto used = rows.Take(AsText(received));
    if (!used) return used.problem();
    keep(received.subspan(*used));
  }
  if (auto problem = rows.start().CheckSize(taken - rows.start().header_bytes)) {
    return *std::move(problem);
  }
  auto whole = body->Finish();
  if (!whole) return std::move(whole).problem();
  RayBody result;
  result.share = std::move(whole->share);
  result.decode_ms = rows.decode_ms();
  result.rays = std::move(rows).Finish(std::move(whole->blocks));
  result.bytes = taken;
  return result;
}

/// What can be decoded while it arrives. Not what would take more than half of the memory of
/// bodies, since rays take up to 4/3 of the rows' bytes.
std::optional<api::ArrivingRays> Recognise(const HandlerContext& context,
                                           const RoutedRequest& routed, std::string_view start,
                                           const api::RayOptions& options) {
  const auto type = api::DetectBatchType(start, routed.http.headers.Find("Content-Type"));
  if (!type || *type != api::BatchType::kNpy) return std::nullopt;
  auto array = api::RecogniseRays(start, routed.http.peer->body_size(), options, context.limits);
  const std::uint64_t most_bytes = context.memory.MostBodyBytes() / 2;
  if (array && array->rows > most_bytes / array->form.RayBytes()) return std::nullopt;
  return array;
}

}  // namespace

api::Outcome<RayBody> ReadRayBody(const HandlerContext& context, const RoutedRequest& routed,
                                  const api::RayOptions& options, const WorkOfBody& work) {
  const std::uint64_t max_bytes = context.limits.MaxBatchBytes();
  if (auto problem = CheckBody(context, routed, max_bytes, work)) return *std::move(problem);
  HttpPeer& peer = *routed.http.peer;
  RequestMemory::Body body(&context.memory);
  std::vector<std::byte> piece(
      std::min<std::uint64_t>(peer.body_size().value_or(max_bytes), kTextPieceBytes));
  bool looked = false;
  for (std::uint64_t taken = 0;;) {
    const auto count = ReadPiece(peer, max_bytes, taken, piece);
    if (!count) return count.problem();
    if (*count == 0) {
      auto whole = body.Finish();
      if (!whole) return std::move(whole).problem();
      RayBody result;
      result.share = std::move(whole->share);
      result.text = std::move(whole->text);
      result.bytes = taken;
      return result;
    }
    taken += *count;
    if (auto problem = body.Append(std::span(piece).first(*count))) return *std::move(problem);
    if (looked || taken < kDecodedBytes) continue;
    looked = true;
    std::optional<api::ArrivingRays> array;
    const auto look = [&](std::string_view text) {
      array = Recognise(context, routed, text, options);
    };
    if (auto problem = body.LookAtText(look)) return *std::move(problem);
    if (!array) continue;
    RowReceiver rows(*std::move(array), context.memory.blocks()->block_bytes(), &body);
    return ReadRows(peer, max_bytes, taken, std::move(rows), &body);
  }
}

}  // namespace kdray::server
