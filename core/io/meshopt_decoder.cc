// SPDX-License-Identifier: Apache-2.0
#include "core/io/meshopt_decoder.h"

#include <meshoptimizer.h>

#include <algorithm>

namespace kdray::core {
namespace {

// The first byte of an encoded view: what it has, and the version that the extension names. The
// library of Debian 13 knows more versions than that of Debian 12.
std::byte HeaderOf(MeshoptMode mode) {
  switch (mode) {
    case MeshoptMode::kAttributes:
      return std::byte{0xa0};
    case MeshoptMode::kTriangles:
      return std::byte{0xe1};
    case MeshoptMode::kIndices:
      break;
  }
  return std::byte{0xd1};
}

std::string_view NameOf(MeshoptMode mode) {
  switch (mode) {
    case MeshoptMode::kAttributes:
      return "ATTRIBUTES";
    case MeshoptMode::kTriangles:
      return "TRIANGLES";
    case MeshoptMode::kIndices:
      break;
  }
  return "INDICES";
}

std::uint64_t RoundedUp(std::uint64_t dividend, std::uint64_t divisor) {
  return dividend / divisor + (dividend % divisor == 0 ? 0 : 1);
}

// A header, the first element in a tail of at least 32 bytes, and for each byte of the stride two
// bits for 16 elements. A block of 256 elements or fewer rounds them up to whole bytes.
std::uint64_t LeastAttributeBytes(const MeshoptForm& form) {
  return 1 + std::max<std::uint64_t>(form.stride, 32) + RoundedUp(form.count, 64) * form.stride;
}

// Bytes of the shortest encoding of form.count elements.
std::uint64_t LeastBytes(const MeshoptForm& form) {
  switch (form.mode) {
    case MeshoptMode::kAttributes:
      return LeastAttributeBytes(form);
    case MeshoptMode::kTriangles:  // a header, a byte for each triangle, a table
      return 1 + form.count / 3 + 16;
    case MeshoptMode::kIndices:  // a header, a byte for each index, a tail
      break;
  }
  return 1 + form.count + 4;
}

std::optional<std::string> WhyNotStride(const MeshoptForm& form) {
  if (form.mode != MeshoptMode::kAttributes) {
    if (form.stride == 2 || form.stride == 4) return std::nullopt;
    return "has a byteStride of " + std::to_string(form.stride) + "; allowed for " +
           std::string(NameOf(form.mode)) + " are 2 and 4";
  }
  if (form.stride == 0 || form.stride > 256 || form.stride % 4 != 0) {
    return "has a byteStride of " + std::to_string(form.stride) +
           "; allowed for ATTRIBUTES are multiples of 4 from 4 to 256";
  }
  if (form.filter == MeshoptFilter::kOctahedral && form.stride != 4 && form.stride != 8) {
    return "has a byteStride of " + std::to_string(form.stride) +
           "; allowed for the filter OCTAHEDRAL are 4 and 8";
  }
  if (form.filter == MeshoptFilter::kQuaternion && form.stride != 8) {
    return "has a byteStride of " + std::to_string(form.stride) + "; the filter QUATERNION needs 8";
  }
  return std::nullopt;
}

int Decode(const MeshoptForm& form, std::span<const std::byte> encoded, std::byte* decoded) {
  const auto* bytes = reinterpret_cast<const unsigned char*>(encoded.data());
  switch (form.mode) {
    case MeshoptMode::kAttributes:
      return meshopt_decodeVertexBuffer(decoded, form.count, form.stride, bytes, encoded.size());
    case MeshoptMode::kTriangles:
      return meshopt_decodeIndexBuffer(decoded, form.count, form.stride, bytes, encoded.size());
    case MeshoptMode::kIndices:
      break;
  }
  return meshopt_decodeIndexSequence(decoded, form.count, form.stride, bytes, encoded.size());
}

}  // namespace

std::optional<std::string> WhyNotMeshopt(const MeshoptForm& form, std::uint64_t encoded_bytes) {
  if (form.filter != MeshoptFilter::kNone && form.mode != MeshoptMode::kAttributes) {
    return "has a filter, which the mode " + std::string(NameOf(form.mode)) + " does not allow";
  }
  if (std::optional<std::string> why = WhyNotStride(form)) return why;
  // From here on no product overflows.
  if (form.count > kMaxMeshoptBytes / form.stride) {
    return "has " + std::to_string(form.count) + " elements of " + std::to_string(form.stride) +
           " bytes; at most " + std::to_string(kMaxMeshoptBytes) +
           " decoded bytes are allowed in a view";
  }
  if (form.mode == MeshoptMode::kTriangles && form.count % 3 != 0) {
    return "has " + std::to_string(form.count) +
           " indices; the mode TRIANGLES needs a multiple of 3";
  }
  const std::uint64_t least = LeastBytes(form);
  if (encoded_bytes >= least) return std::nullopt;
  return "claims " + std::to_string(form.count) + " elements of " + std::to_string(form.stride) +
         " bytes, whose shortest encoding takes " + std::to_string(least) + " bytes; it has " +
         std::to_string(encoded_bytes);
}

Status DecodeMeshopt(const MeshoptForm& form, std::span<const std::byte> encoded,
                     std::span<std::byte> decoded, CancelPoll* poll) {
  if (poll->Spend(CancelPoll::kWorkPerLook)) return poll->ToError();
  if (encoded.front() != HeaderOf(form.mode)) {
    return Error{ErrorCode::kInvalidMesh,
                 "the data do not begin as those of the mode " + std::string(NameOf(form.mode))};
  }
  if (Decode(form, encoded, decoded.data()) != 0) {
    return Error{ErrorCode::kInvalidMesh, "the compressed data are damaged, or are not " +
                                              std::to_string(form.count) + " elements of " +
                                              std::to_string(form.stride) + " bytes"};
  }
  // The time of the decoder counts, too.
  if (poll->Spend(CancelPoll::kWorkPerLook)) return poll->ToError();
  if (!ApplyMeshoptFilter(form.filter, form.stride, decoded, poll)) return poll->ToError();
  return {};
}

}  // namespace kdray::core
