// SPDX-License-Identifier: Apache-2.0
// The .npy format, versions 1.0 to 3.0: a magic string, a header (the text of a Python dictionary),
// then the bytes of the elements. Source: numpy, "NEP 1 - A Simple File Format for NumPy Arrays",
// and numpy.lib.format.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "api/types.h"

namespace kdray::api {

/// The first bytes of every .npy file.
inline constexpr std::string_view kNpyMagic = "\x93NUMPY";

/// A view of an array in a body.
struct NpyArray {
  NumberType type = NumberType::kF4;  ///< little-endian
  bool fortran_order = false;         ///< the first index varies fastest
  std::vector<std::size_t> shape;     ///< empty: one number
  std::string_view data;              ///< exactly the product of `shape` elements; not aligned
};

/// Reads an array of `<f4` or `<f8`. invalid_array for another type (the message names the two), an
/// invalid header (it must be a dictionary with exactly the keys descr, fortran_order and shape;
/// nothing is evaluated), more than 33 dimensions, or a size that differs from the number of bytes.
/// Allocates only the shape, whatever the header claims.
Outcome<NpyArray> ReadNpy(std::string_view bytes);

/// What the beginning of an array says of it.
struct NpyStart {
  NpyArray array;                ///< without its data
  std::size_t header_bytes = 0;  ///< before the data
  std::uint64_t data_bytes = 0;  ///< by type and shape

  /// invalid_array unless that is what follows the header.
  Check CheckSize(std::uint64_t present_bytes) const;
};

/// Reads what stands before the elements, if `bytes` have all of it: the problems of ReadNpy()
/// except that of the size.
Outcome<NpyStart> ReadNpyStart(std::string_view bytes);

/// Everything before the elements, version 1.0, padded so that they start at a multiple of 64
/// bytes. `descr` is a Python literal (`'<f4'` with its quotes, or a list for a structured type);
/// the order is C.
std::string NpyHeader(std::string_view descr, std::span<const std::size_t> shape);

}  // namespace kdray::api
