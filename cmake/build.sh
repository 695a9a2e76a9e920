#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Configures and builds a preset of CMakePresets.json: cmake/build.sh PRESET [TARGET...]. Used by server/run,
# tests/run and the Dockerfile; by hand, `cmake --preset P && cmake --build --preset P` does the same.
# KDRAY_WARNINGS_AS_ERRORS=ON makes warnings errors, as .ci/run and the preset dev do.
set -euo pipefail
cd "$(dirname "$0")/.."
preset=$1
shift

# One compiler per processor, but limited by memory: a compiler needs up to 1.5 GiB.
available_kib=$(awk '/^MemAvailable:/ {print $2}' /proc/meminfo)
if [[ -r /sys/fs/cgroup/memory.max && $(</sys/fs/cgroup/memory.max) != max ]]; then
  limit_kib=$(($(</sys/fs/cgroup/memory.max) / 1024))
  ((limit_kib < available_kib)) && available_kib=$limit_kib
fi
jobs=$((available_kib / (1536 * 1024)))
processors=$(nproc)
((jobs > processors)) && jobs=$processors
((jobs < 1)) && jobs=1

log=$(mktemp)
trap 'rm -f "$log"' EXIT
settings=()
[[ ${KDRAY_WARNINGS_AS_ERRORS:-} ]] && settings=(-D "CMAKE_COMPILE_WARNING_AS_ERROR=$KDRAY_WARNINGS_AS_ERRORS")
if ! cmake --preset "$preset" "${settings[@]}" >"$log" 2>&1; then
  cat "$log" >&2
  exit 1
fi
targets=()
(($#)) && targets=(--target "$@")
cmake --build --preset "$preset" -j "$jobs" "${targets[@]}" >&2
