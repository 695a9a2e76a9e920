// Files that are no mesh of a format that is read, but that people send all the same. Knowing them,
// an error can say what the bytes are and what to send instead. core/io/format_sniffer.h knows the
// formats that are read.
#pragma once

#include <optional>
#include <string_view>

#include "core/base/cancel_poll.h"

namespace kdray::core {

struct ForeignFile {
  std::string_view name;    ///< "gzip data"
  std::string_view advice;  ///< "unpack it and send the file that is in it"
};

/// What the bytes are, by their first 64 KiB; nullopt when they are nothing that is known here.
/// Text that only a reader could tell from a mesh (a list of points) is left to IsListOfPoints.
/// O(1).
std::optional<ForeignFile> FindForeignFile(std::string_view bytes);

/// True when each of the first lines of the text holds coordinates: at least three numbers, between
/// blanks, commas or semicolons. A count alone on the first line is allowed (PTS), and a line with
/// the names of columns. O(1).
bool IsListOfPoints(std::string_view text);

inline constexpr std::string_view kNoFacesAdvice =
    "points have no surface, send a mesh with faces (made from the points, if need be)";

/// True for a text of some length without a line break, which is what `curl -d @FILE` makes of a
/// text file. O(text); when the poll has stopped, the answer means nothing.
bool HasLostItsLineBreaks(std::string_view text, CancelPoll* poll);

/// What to say of such a text.
inline constexpr std::string_view kLineBreaksAdvice =
    "the text has no line break; curl -d takes them out, curl --data-binary @FILE keeps them";

}  // namespace kdray::core
