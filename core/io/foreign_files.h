// SPDX-License-Identifier: Apache-2.0
// Recognises files in unsupported formats that people send, so that an error can say what the bytes
// are and what to send instead. core/io/format_sniffer.h recognises the supported formats.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "core/base/cancel_poll.h"
#include "core/base/result.h"

namespace kdray::core {

struct ForeignFile {
  std::string_view name;    ///< "gzip data"
  std::string_view advice;  ///< "unpack it and send the file that is in it"
};

/// The kind of file, by the first 64 KiB; nullopt if it is unknown. A list of points needs a closer
/// look (IsListOfPoints). O(1).
std::optional<ForeignFile> FindForeignFile(std::string_view bytes);

/// The same for a text that no reader and no signature recognises: the name of a file, base64, a
/// JSON string, materials. O(1).
std::optional<ForeignFile> FindForeignText(std::string_view text);

/// True when each of the first lines of the text holds coordinates: at least three numbers, between
/// blanks, commas or semicolons. The first line may be a count (PTS) or the names of columns. O(1).
bool IsListOfPoints(std::string_view text);

inline constexpr std::string_view kNoFacesAdvice =
    "points have no surface, send a mesh with faces (made from the points, if need be)";

/// kEmptyMesh for a file of a format that can also hold points alone, with that advice.
Error NoFaces(std::string message);

/// True for a text of some length without a line break, the result of `curl -d @FILE` for a text
/// file. O(text). When the poll has stopped, the result is unspecified.
bool HasLostItsLineBreaks(std::string_view text, CancelPoll* poll);

/// The advice for such a text.
inline constexpr std::string_view kLineBreaksAdvice =
    "the text has no line break; curl -d takes them out, curl --data-binary @FILE keeps them";

}  // namespace kdray::core
