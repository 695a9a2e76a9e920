// SPDX-License-Identifier: Apache-2.0
#include "api/ray_rows.h"

#include <bit>
#include <cstdint>
#include <cstring>
#include <type_traits>

namespace kdray::api {
namespace {

static_assert(std::endian::native == std::endian::little,
              ".npy elements are copied as they are; a big-endian machine has to swap them");

bool FitsFloat(double value) { return static_cast<double>(static_cast<float>(value)) == value; }

/// Puts a row of 6 or 8 columns into the order of kRayNumbers.
template <class Sent, class T>
void PutRow(const Sent* n, bool with_interval, T t_min, T t_max, T* out) {
  out[0] = static_cast<T>(n[0]);
  out[1] = static_cast<T>(n[1]);
  out[2] = static_cast<T>(n[2]);
  out[3] = with_interval ? static_cast<T>(n[6]) : t_min;
  out[4] = static_cast<T>(n[3]);
  out[5] = static_cast<T>(n[4]);
  out[6] = static_cast<T>(n[5]);
  out[7] = with_interval ? static_cast<T>(n[7]) : t_max;
}

/// Rows of kColumns of the same type, half a ray at a time: this is what most batches are. With a
/// store for each number, the processor could not wait for enough memory at once.
template <std::size_t kColumns, class T>
void ReadHalves(const char* data, T t_min, T t_max, std::span<T> numbers) {
  // GCC's vectors (manual, "Using Vector Instructions through Built-in Functions").
  using Half [[gnu::vector_size(4 * sizeof(T))]] = T;
  using Bits = std::conditional_t<sizeof(T) == 4, std::int32_t, std::int64_t>;
  using Mask [[gnu::vector_size(4 * sizeof(T))]] = Bits;
  constexpr Mask kVector = {-1, -1, -1, 0};
  // Vectors are not returned: without AVX, that would be another calling convention.
  const auto load = [](const char* from, Mask* half) { std::memcpy(half, from, sizeof(*half)); };
  // The first three of `vector`, and the last of `interval`.
  const auto store_joined = [](const Mask& vector, const Mask& interval, T* out) {
    const Mask half = (vector & kVector) | (interval & ~kVector);
    std::memcpy(out, &half, sizeof(half));
  };
  const Half first = {0, 0, 0, t_min}, last = {0, 0, 0, t_max};
  Mask least, most;
  std::memcpy(&least, &first, sizeof(least));
  std::memcpy(&most, &last, sizeof(most));
  for (T *out = numbers.data(), *end = out + numbers.size(); out != end; out += kRayNumbers) {
    Mask origin, direction, middle;
    load(data, &origin);
    if constexpr (kColumns == 8) {
      load(data + 3 * sizeof(T), &middle);  // dx dy dz t_min
      load(data + 4 * sizeof(T), &direction);
      store_joined(origin, middle, out);
      store_joined(middle, direction, out + 4);
    } else {
      load(data + 2 * sizeof(T), &middle);  // oz dx dy dz
      direction = __builtin_shufflevector(middle, middle, 1, 2, 3, 0);
      store_joined(origin, least, out);
      store_joined(direction, most, out + 4);
    }
    data += kColumns * sizeof(T);
  }
}

/// Rows of kColumns. The elements are not aligned, so they are copied.
template <std::size_t kColumns, class Sent, class T>
void ReadInOrder(const char* data, T t_min, T t_max, std::span<T> numbers) {
  if constexpr (std::is_same_v<Sent, T>) {
    return ReadHalves<kColumns>(data, t_min, t_max, numbers);
  } else {
    for (std::size_t at = 0; at < numbers.size(); at += kRayNumbers) {
      Sent n[kRayNumbers] = {};
      std::memcpy(n, data, kColumns * sizeof(Sent));
      data += kColumns * sizeof(Sent);
      PutRow(n, kColumns == 8, t_min, t_max, &numbers[at]);
    }
  }
}

template <class Sent, class T>
void ReadSent(const RayRowForm& form, const char* data, std::span<T> numbers) {
  const auto t_min = static_cast<T>(form.t_min), t_max = static_cast<T>(form.t_max);
  return form.columns == 8 ? ReadInOrder<8, Sent>(data, t_min, t_max, numbers)
                           : ReadInOrder<6, Sent>(data, t_min, t_max, numbers);
}

template <class Sent, class T>
void ReadSentColumns(const RayRowForm& form, const char* data, std::size_t stride, T* ray) {
  Sent n[kRayNumbers] = {};
  for (std::size_t column = 0; column < form.columns; ++column) {
    std::memcpy(&n[column], data + column * stride, sizeof(Sent));
  }
  PutRow(n, form.columns == 8, static_cast<T>(form.t_min), static_cast<T>(form.t_max), ray);
}

}  // namespace

std::optional<RayRowForm> RayRowForm::Of(const NpyArray& array, double t_min, double t_max) {
  if (array.shape.empty() || (array.shape.back() != 6 && array.shape.back() != 8)) {
    return std::nullopt;
  }
  return RayRowForm{array.type, array.shape.back(), t_min, t_max};
}

NumberType RayRowForm::RayType() const {
  return columns == 8 || (FitsFloat(t_min) && FitsFloat(t_max)) ? sent : NumberType::kF8;
}

void RayRowForm::Read(const char* data, std::span<float> numbers) const {
  ReadSent<float>(*this, data, numbers);
}

void RayRowForm::Read(const char* data, std::span<double> numbers) const {
  if (sent == NumberType::kF4) {
    ReadSent<float>(*this, data, numbers);
  } else {
    ReadSent<double>(*this, data, numbers);
  }
}

void RayRowForm::ReadColumns(const char* data, std::size_t stride,
                             std::span<float, kRayNumbers> ray) const {
  ReadSentColumns<float>(*this, data, stride, ray.data());
}

void RayRowForm::ReadColumns(const char* data, std::size_t stride,
                             std::span<double, kRayNumbers> ray) const {
  if (sent == NumberType::kF4) {
    ReadSentColumns<float>(*this, data, stride, ray.data());
  } else {
    ReadSentColumns<double>(*this, data, stride, ray.data());
  }
}

}  // namespace kdray::api
