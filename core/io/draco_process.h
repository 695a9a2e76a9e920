// SPDX-License-Identifier: Apache-2.0
// Decodes the Draco data of a glTF primitive (KHR_draco_mesh_compression) by the program
// kdray-draco (codec/main.cc), which runs once for each.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/base/result.h"

namespace kdray::core {

/// An attribute that is wanted, as its accessor describes it.
struct DracoAttribute {
  std::uint32_t id = 0;              ///< its unique id in the data
  std::uint32_t component_type = 0;  ///< as in glTF: 5120 to 5126
  std::uint32_t components = 0;
  bool is_needed = false;  ///< its absence is an error
  std::uint64_t value_bytes = 0;
};

/// What the file says of the data: claims.
struct DracoForm {
  std::uint64_t vertices = 0;
  std::uint64_t triangles = 0;
  std::uint64_t attributes = 0;  ///< in the data, wanted or not
  std::uint64_t encoded_bytes = 0;
  std::vector<DracoAttribute> wanted;

  /// The memory of the program and of its answer, at most. The program may not take more, besides
  /// its mapped libraries.
  std::uint64_t Bytes() const;
};

/// The answer of the program.
struct DracoMesh {
  std::vector<std::byte> bytes;
  std::size_t corners_begin = 0;  ///< three numbers of 32 bits for each triangle, below `vertices`
  /// Where in `bytes` the values of each wanted attribute begin, one value a vertex; nullopt if the
  /// data do not have it, or have it in another type.
  std::vector<std::optional<std::size_t>> values_begin;

  std::uint32_t Corner(std::uint64_t i) const;
};

/// Runs the program. Any input is safe: its faults end that process only, whose memory and
/// processor time are limited. Errors: kInvalidMesh with the cause alone; kInternal when the
/// program is missing or cannot be started; those of the poll, at most some 20 ms after the stop.
Result<DracoMesh> DecodeDraco(std::span<const std::byte> encoded, const DracoForm& form,
                              CancelPoll* poll);

/// The program's file: beside this process's program, or where an installation has it
/// (../libexec/kdray).
std::optional<std::string> FindDracoProgram();

}  // namespace kdray::core
