// SPDX-License-Identifier: Apache-2.0
// Distinguishes the text of a 32-bit float from the text of a double. Programs print floats with
// six, seven, eight or nine digits, so the text alone is neither the float nor a hint at its type.
#pragma once

#include <optional>
#include <string_view>

namespace kdray::core {

/// The float nearest to a decimal number, if that float prints as the same number: with as many
/// digits (if it has an exponent), or as many places after the decimal point (otherwise). nullopt
/// for a number with more digits than a float has ("0.1000000000", a double with 17 digits), or
/// beyond the range of float. A coordinate written as not finite becomes that float.
///
/// `word` must be a text that ParseCoordinate reads as `value`. O(word); for up to 14 digits as
/// fast as reading them.
std::optional<float> ParsePrintedFloat(std::string_view word, double value);

}  // namespace kdray::core
