# SPDX-License-Identifier: Apache-2.0
# Every header must compile alone. A source file that includes its own header first shows it; for each
# other header of a target, this makes a one-line source that includes only that header. They are built
# by the target `check-headers`, which tests/run builds.

add_custom_target(check-headers)

# The source that checks a header of the current folder.
function(kdray_header_check_source header source)
  file(RELATIVE_PATH name "${PROJECT_SOURCE_DIR}" "${header}")
  string(MAKE_C_IDENTIFIER "${name}" id)
  set(${source} "${CMAKE_CURRENT_BINARY_DIR}/check_headers/${id}.cc" PARENT_SCOPE)
endfunction()

# Whether the source file beside a header includes it before anything else.
function(kdray_header_is_included_first header name result)
  string(REGEX REPLACE "\\.h$" ".cc" source "${header}")
  set(${result} FALSE PARENT_SCOPE)
  if(EXISTS "${source}")
    file(STRINGS "${source}" includes REGEX "^#include")
    if(includes)
      list(GET includes 0 first)
      if(first STREQUAL "#include \"${name}\"")
        set(${result} TRUE PARENT_SCOPE)
      endif()
    endif()
  endif()
endfunction()

function(kdray_check_headers target)
  file(GLOB_RECURSE headers CONFIGURE_DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/*.h")
  if(NOT headers)
    return()
  endif()
  set(sources)
  foreach(header IN LISTS headers)
    file(RELATIVE_PATH name "${PROJECT_SOURCE_DIR}" "${header}")
    kdray_header_is_included_first("${header}" "${name}" is_checked)
    if(is_checked)
      continue()
    endif()
    kdray_header_check_source("${header}" source)
    file(GENERATE OUTPUT "${source}" CONTENT "#include \"${name}\"\n")
    list(APPEND sources "${source}")
  endforeach()
  if(NOT sources)
    return()
  endif()
  add_library(${target}_headers OBJECT EXCLUDE_FROM_ALL ${sources})
  kdray_settings(${target}_headers)
  target_link_libraries(${target}_headers PRIVATE ${target} $<TARGET_PROPERTY:${target},LINK_LIBRARIES>)
  add_dependencies(check-headers ${target}_headers)
endfunction()
