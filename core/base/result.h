// SPDX-License-Identifier: Apache-2.0
// Value or error. Core throws nothing on purpose and never prints or exits; what can go wrong
// because of a caller's input comes back as an Error. Assertions are for our own mistakes.
#pragma once

#include <cassert>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>

namespace kdray::core {

/// What kind of thing went wrong. Knows no protocol: server/mapping gives each its wire name and
/// HTTP status.
enum class ErrorCode {
  kInvalidMesh,  ///< the bytes are of a known mesh format and break its rules; see Error::line,
                 ///< Error::byte
  kEmptyMesh,    ///< no bytes at all, or not one triangle
  kUnsupportedMeshFormat,  ///< the bytes are of no format that core reads
  kMeshTooLarge,      ///< more vertices or triangles than 32-bit indices, or than a stated limit
  kInvalidArgument,   ///< a parameter outside its documented range
  kNotFound,          ///< nothing is stored under that name
  kCancelled,         ///< the caller asked to stop
  kDeadlineExceeded,  ///< the time the caller gave has passed
  kMemoryFull,        ///< does not fit into the memory limit now
  kStoreFull,         ///< no room on disk, or the disk is read-only
  kCorrupt,           ///< stored bytes fail their check; never returned for a caller's own upload
  kIo,                ///< the operating system refused a file operation
  kInternal,          ///< our mistake
};

struct Error {
  ErrorCode code = ErrorCode::kInternal;
  std::string message;  ///< for people: says where and what was allowed; no paths of the machine,
                        ///< no addresses
  std::optional<std::uint64_t> line = std::nullopt;  ///< 1-based line of a text file
  std::optional<std::uint64_t> byte = std::nullopt;  ///< 0-based offset in a binary file
  /// With kInvalidArgument, the field of the options that is wrong, if it is one: "fov_deg". A
  /// string literal, which the message does not repeat.
  std::string_view field = {};
};

/// Either a T or an Error. Access to the wrong one is a mistake of ours and asserts.
template <class T>
class [[nodiscard]] Result {
 public:
  // NOLINTNEXTLINE(google-explicit-constructor)
  Result(T value) : state_(std::in_place_index<0>, std::move(value)) {}
  // NOLINTNEXTLINE(google-explicit-constructor)
  Result(Error error) : state_(std::in_place_index<1>, std::move(error)) {}

  bool ok() const { return state_.index() == 0; }
  explicit operator bool() const { return ok(); }

  T& value() & {
    assert(ok());
    return std::get<0>(state_);
  }
  const T& value() const& {
    assert(ok());
    return std::get<0>(state_);
  }
  T&& value() && {
    assert(ok());
    return std::get<0>(std::move(state_));
  }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

  const Error& error() const& {
    assert(!ok());
    return std::get<1>(state_);
  }
  Error&& error() && {
    assert(!ok());
    return std::get<1>(std::move(state_));
  }

 private:
  std::variant<T, Error> state_;
};

/// Success without a value, or an Error.
template <>
class [[nodiscard]] Result<void> {
 public:
  Result() = default;
  Result(Error error) : error_(std::move(error)) {}  // NOLINT(google-explicit-constructor)

  bool ok() const { return !error_.has_value(); }
  explicit operator bool() const { return ok(); }
  const Error& error() const& {
    assert(!ok());
    return *error_;
  }
  Error&& error() && {
    assert(!ok());
    return *std::move(error_);
  }

 private:
  std::optional<Error> error_;
};

using Status = Result<void>;

}  // namespace kdray::core
