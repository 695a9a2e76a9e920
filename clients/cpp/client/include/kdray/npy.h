// SPDX-License-Identifier: Apache-2.0
// The header of NumPy's .npy files (format versions 1 to 3).
// Source: NumPy documentation, "numpy.lib.format".
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace kdray::client {

struct NpyHeader {
  std::string descr;  ///< element type: `<f4`; of a structured array the text of its Python list
  bool fortran_order = false;
  std::vector<std::uint64_t> shape;
  std::size_t data_offset = 0;  ///< where the elements begin in the file; ignored when writing

  /// Product of the shape; 1 for a scalar.
  std::uint64_t ElementCount() const;
};

/// The first bytes of every .npy file.
inline constexpr std::string_view kNpyMagic = "\x93NUMPY";

/// Reads the header at the beginning of `bytes`; the elements need not be complete. Throws
/// LocalFileError with the cause.
NpyHeader ParseNpyHeader(std::string_view bytes);

/// A version 1 header, padded so that the elements begin at a multiple of 64 bytes.
std::string EncodeNpyHeader(const NpyHeader& header);

/// The elements of a <f4 array.
std::string LittleEndianFloats(std::span<const float> values);

/// The elements of a <f8 array.
std::string LittleEndianDoubles(std::span<const double> values);

}  // namespace kdray::client
