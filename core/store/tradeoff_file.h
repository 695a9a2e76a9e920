// SPDX-License-Identifier: Apache-2.0
// The stored result of a mesh's trade-off measurement.
#pragma once

#include <cstdint>
#include <memory>

#include "core/base/hash.h"
#include "core/base/result.h"
#include "core/catalog/records.h"
#include "core/store/blob_store.h"

namespace kdray::core {

/// Some hundred bytes for each build and precision.
inline constexpr std::uint64_t kTradeoffFileBytes = 8192;

/// The file is on stable storage under its temporary name when it returns.
Result<NewBlob> WriteTradeoffFile(const Sha256Digest& mesh, const MeasuredTradeoff& measured,
                                  NewBlob blob);
/// kCorrupt unless it is valid and of this mesh; kIo.
Result<MeasuredTradeoff> ReadTradeoffFile(const Sha256Digest& mesh,
                                          std::unique_ptr<ReadableFile> file);

}  // namespace kdray::core
