// SPDX-License-Identifier: Apache-2.0
// Errors of mesh readers, with line or byte.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "core/base/result.h"

namespace kdray::core {

/// kInvalidMesh at a line (counted from 1) of a text file: "line 12: " and the cause.
Error AtLine(std::uint64_t line, std::string_view cause);

/// kInvalidMesh at an offset (counted from 0) in a binary file: "byte 84: " and the cause.
Error AtByte(std::uint64_t byte, std::string_view cause);

/// The same with the code of `error`. An error that the file did not cause (kCancelled) is returned
/// unchanged.
Error AtLine(std::uint64_t line, Error error);
Error AtByte(std::uint64_t byte, Error error);

/// Whether the file caused the error: it breaks its format's rules or has no triangle. A reader may
/// then try to read the bytes in another way.
bool IsOfTheFile(const Error& error);

/// A piece of the file for a message: in quotes, cut after 40 bytes, with \xNN for every byte that
/// is not printable ASCII, so that a message is always valid text.
std::string Quoted(std::string_view piece);

}  // namespace kdray::core
