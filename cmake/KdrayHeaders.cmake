# SPDX-License-Identifier: Apache-2.0
# Every header must compile alone: makes, for each header of a target, a one-line source that includes
# only that header. Built by the target `check-headers`, which tests/run builds.

add_custom_target(check-headers)

# The source that checks a header of the current folder.
function(kdray_header_check_source header source)
  file(RELATIVE_PATH name "${PROJECT_SOURCE_DIR}" "${header}")
  string(MAKE_C_IDENTIFIER "${name}" id)
  set(${source} "${CMAKE_CURRENT_BINARY_DIR}/check_headers/${id}.cc" PARENT_SCOPE)
endfunction()

function(kdray_check_headers target)
  file(GLOB_RECURSE headers CONFIGURE_DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/*.h")
  if(NOT headers)
    return()
  endif()
  set(sources)
  foreach(header IN LISTS headers)
    file(RELATIVE_PATH name "${PROJECT_SOURCE_DIR}" "${header}")
    kdray_header_check_source("${header}" source)
    file(GENERATE OUTPUT "${source}" CONTENT "#include \"${name}\"\n")
    list(APPEND sources "${source}")
  endforeach()
  add_library(${target}_headers OBJECT EXCLUDE_FROM_ALL ${sources})
  kdray_settings(${target}_headers)
  target_link_libraries(${target}_headers PRIVATE ${target} $<TARGET_PROPERTY:${target},LINK_LIBRARIES>)
  add_dependencies(check-headers ${target}_headers)
endfunction()
