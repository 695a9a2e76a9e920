# SPDX-License-Identifier: Apache-2.0
# Run by kdray_embed() in the build: writes HEADER from the files PATHS under their NAMES.
#
# Bytes become character literals, not one string literal: the standard limits string literals to
# 65536 bytes, and a raw string cannot contain every byte.

set(definitions "")
set(entries "")
set(index 0)
foreach(path name IN ZIP_LISTS PATHS NAMES)
  file(READ "${path}" hex HEX)
  string(LENGTH "${hex}" digits)
  math(EXPR size "${digits} / 2")
  string(REGEX REPLACE "(..)" "'\\\\x\\1'," characters "${hex}")
  string(REPEAT "." 112 line)  # sixteen literals of seven characters
  string(REGEX REPLACE "(${line})" "\\1\n" characters "${characters}")
  # The NUL at the end is not counted; it avoids an array without elements for an empty file.
  string(APPEND definitions "inline constexpr char ${VARIABLE}File${index}[] = {\n${characters}'\\0'};\n")
  string(APPEND entries "    {\"${name}\", {${VARIABLE}File${index}, ${size}}},\n")
  math(EXPR index "${index} + 1")
endforeach()

file(WRITE "${HEADER}" "// Made by kdray_embed(). Do not edit.
#pragma once

#include <array>
#include <string_view>
#include <utility>

namespace ${NAMESPACE} {

${definitions}
inline constexpr std::array<std::pair<std::string_view, std::string_view>, ${index}> ${VARIABLE} = {{
${entries}}};

}  // namespace ${NAMESPACE}
")
