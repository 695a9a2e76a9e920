// Telling the text of a 32-bit float from the text of a double. Programs print floats with six,
// seven, eight or nine digits, so the text alone is neither the float nor a hint at its type.
#pragma once

#include <optional>
#include <string_view>

namespace kdray::core {

/// The float nearest to a decimal number, if that float, printed with as many digits (with an
/// exponent), or as many places behind the point (without), gives the number back. nullopt for a
/// number that has more digits than a float explains ("0.1000000000", a double with 17 digits), or
/// beyond a float's range. A coordinate that is written as not finite is that float.
///
/// `word`: a text of which ParseCoordinate makes `value`. O(word), and for up to 14 digits as fast
/// as reading them.
std::optional<float> ParsePrintedFloat(std::string_view word, double value);

}  // namespace kdray::core
