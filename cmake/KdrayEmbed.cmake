# SPDX-License-Identifier: Apache-2.0
# Embeds files into a program, so the daemon is one file without a data directory.

set(KDRAY_EMBED_SCRIPT "${CMAKE_CURRENT_LIST_DIR}/embed_files.cmake")

# kdray_embed(TARGET NAME HEADER path/to/name.h VARIABLE kName NAMESPACE kdray::layer BASE DIR FILES file...)
#
# Generates HEADER, which the .cc files of TARGET include under that name. It defines
#
#   namespace kdray::layer {
#   inline constexpr std::array<std::pair<std::string_view, std::string_view>, N> kName;  // {name, content}
#   }
#
# in the order of FILES. A file's name is its path relative to BASE (default: the calling folder);
# generated files may be named by their full path. Include the header in one .cc only, because it
# contains the bytes.
function(kdray_embed)
  cmake_parse_arguments(arg "" "TARGET;HEADER;VARIABLE;NAMESPACE;BASE" "FILES" ${ARGN})
  foreach(needed TARGET HEADER VARIABLE NAMESPACE FILES)
    if(NOT arg_${needed})
      message(FATAL_ERROR "kdray_embed: ${needed} is missing")
    endif()
  endforeach()
  if(NOT arg_BASE)
    set(arg_BASE "${CMAKE_CURRENT_SOURCE_DIR}")
  endif()

  set(paths)
  set(names)
  foreach(file IN LISTS arg_FILES)
    cmake_path(ABSOLUTE_PATH file BASE_DIRECTORY "${CMAKE_CURRENT_SOURCE_DIR}" NORMALIZE)
    file(RELATIVE_PATH name "${arg_BASE}" "${file}")
    list(APPEND paths "${file}")
    list(APPEND names "${name}")
  endforeach()

  set(root "${CMAKE_CURRENT_BINARY_DIR}/embedded")
  set(header "${root}/${arg_HEADER}")
  add_custom_command(
    OUTPUT "${header}"
    COMMAND "${CMAKE_COMMAND}" "-DHEADER=${header}" "-DVARIABLE=${arg_VARIABLE}" "-DNAMESPACE=${arg_NAMESPACE}"
            "-DPATHS=${paths}" "-DNAMES=${names}" -P "${KDRAY_EMBED_SCRIPT}"
    DEPENDS ${paths} "${KDRAY_EMBED_SCRIPT}"
    COMMENT "Embedding ${arg_HEADER}"
    VERBATIM)
  target_sources(${arg_TARGET} PRIVATE "${header}")
  target_include_directories(${arg_TARGET} PRIVATE "${root}")
endfunction()
