# SPDX-License-Identifier: Apache-2.0
# Settings of all our targets. They are set on targets, not as global flags, so they do not affect what
# a consumer compiles.

set(CMAKE_RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/bin")
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "Release, RelWithDebInfo or Debug" FORCE)
endif()

function(kdray_settings target)
  target_compile_features(${target} PUBLIC cxx_std_20)
  set_target_properties(${target} PROPERTIES CXX_EXTENSIONS OFF)
  target_include_directories(${target} PUBLIC "$<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>")
  # -ffp-contract=off: a fused multiply-add would make answers differ between machines.
  # No -ffast-math, for the same reason. -fno-tree-slp-vectorize: otherwise g++ 12 drops two
  # neighbouring conversions from double to float and back, so Vec3d(Vec3f(p)) would be p
  # (tests/unit/core/geometry/vec3_test.cc).
  target_compile_options(${target} PRIVATE
    -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Woverloaded-virtual -Wcast-align -Wunused
    -Wdouble-promotion -Wimplicit-fallthrough
    # g++ 12 warns of "text" + std::string itself (GCC bug 105651).
    $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>
    -ffp-contract=off -fno-tree-slp-vectorize -fno-math-errno -fstack-protector-strong)
  target_compile_definitions(${target} PRIVATE KDRAY_VERSION="${PROJECT_VERSION}")
  if(KDRAY_SANITIZE)
    target_compile_options(${target} PRIVATE -fsanitize=${KDRAY_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
    target_link_options(${target} PUBLIC -fsanitize=${KDRAY_SANITIZE})
    # g++ 12 loses track of the content of std::optional and Result across checks: false positives.
    target_compile_options(${target} PRIVATE $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
  endif()
endfunction()

# kdray_layer(NAME DIR): static library from every .cc below the calling folder, except main.cc files.
function(kdray_layer target)
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/*.cc" "${CMAKE_CURRENT_SOURCE_DIR}/*.h")
  list(FILTER sources EXCLUDE REGEX "main\\.cc$")
  add_library(${target} STATIC ${sources})
  kdray_settings(${target})
  kdray_check_headers(${target})
endfunction()

function(kdray_executable target)
  add_executable(${target} ${ARGN})
  kdray_settings(${target})
endfunction()
