#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The list of Debian packages that kdray needs; installs those that are missing.
#   server/dependencies.sh GROUP...          install missing packages; silent and offline without any
#   server/dependencies.sh --list GROUP...   print the names, one per line
# Groups: build (compile the daemon and the command), test (build and run the tests as well), run (start the
# compiled programs: the second stage of the Dockerfile), package (Debian packages), lint (tests/lint), bench
# (tests/bench), fuzz (tests/fuzz/run).
set -euo pipefail

# The version of Debian, because names of libraries contain versions; 12 on other systems.
release() {
  local VERSION_ID=12 ID=
  # shellcheck source=/dev/null
  [[ -r /etc/os-release ]] && . /etc/os-release
  [[ $ID == debian ]] && echo "${VERSION_ID%%.*}" || echo 12
}

packages_of() {
  case $1 in
    build) cat <<'END' ;;
build-essential
cmake
libcairo2-dev
libcli11-dev
libcpp-httplib-dev
libcurl4-openssl-dev
libdeflate-dev
libgmp-dev
libmeshoptimizer-dev
libpugixml-dev
libspdlog-dev
libssl-dev
libstb-dev
libtbb-dev
libzstd-dev
ninja-build
nlohmann-json3-dev
pkg-config
prometheus-cpp-dev
python3
python3-yaml
zlib1g-dev
END
    test)
      # Debian 12 has no trimesh.
      [[ $(release) == 12 ]] || printf '%s\n' python3-rtree python3-trimesh
      cat <<'END'
chromium
chromium-driver
curl
file
haproxy
libcgal-dev
libembree-dev
libgmock-dev
libgtest-dev
libpng-dev
mypy
nodejs
prometheus
python3-distributed
python3-jsonschema
python3-kubernetes
python3-numpy
python3-pip
python3-requests
python3-setuptools
python3-venv
python3-wheel
strace
zsh
zstd
END
      ;;
    run)
      case $(release) in
        12) echo libcpp-httplib0.11 libcurl4 libspdlog1.10 libssl3 ;;
        *) echo libcpp-httplib0.18 libcurl4t64 libspdlog1.15 libssl3t64 ;;
      esac | tr ' ' '\n'
      cat <<'END'
ca-certificates
libcairo2
libdeflate0
libgmp10
libmeshoptimizer2d
libprometheus-cpp-core1.0
libpugixml1v5
libtbb12
libzstd1
zlib1g
END
      ;;
    bench) cat <<'END' ;;
libembree-dev
nginx-light
python3-matplotlib
python3-pil
wrk
END
    fuzz)
      case $(release) in
        12) echo clang-14 libclang-rt-14-dev ;;
        *) echo clang-19 libclang-rt-19-dev ;;
      esac | tr ' ' '\n'
      ;;
    package) cat <<'END' ;;
dpkg-dev
file
END
    lint) cat <<'END' ;;
clang-format
clang-tidy
shellcheck
END
    *)
      echo "server/dependencies.sh: no group '$1'; there are build, test, run, package, lint, bench and fuzz" >&2
      return 2
      ;;
  esac
}

list_only=false
[[ ${1:-} == --list ]] && { list_only=true; shift; }
[[ $# -ge 1 ]] || { sed -n '2,7s/^# \{0,1\}//p' "$0" >&2; exit 2; }
wanted=()
for group in "$@"; do
  names=$(packages_of "$group") || exit
  mapfile -t names <<<"$names"
  wanted+=("${names[@]}")
done
if $list_only; then
  printf '%s\n' "${wanted[@]}"
  exit 0
fi

if ! command -v dpkg-query >/dev/null; then
  echo "kdray: this is no Debian, so what it needs cannot be looked up. On Debian 12 it is:" "${wanted[@]}" >&2
  exit 0  # what is really missing, CMake will say
fi
missing=()
for name in "${wanted[@]}"; do
  [[ $(dpkg-query -W -f '${db:Status-Status}' "$name" 2>/dev/null) == installed ]] || missing+=("$name")
done
((${#missing[@]})) || exit 0

if [[ $(id -u) == 0 ]]; then
  as_root=()
elif command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [[ -t 0 ]]; }; then
  as_root=(sudo)
else
  echo "kdray: these Debian packages are missing, and installing them needs root or sudo. As root:" >&2
  echo "  apt-get install --no-install-recommends ${missing[*]}" >&2
  exit 1
fi
echo "kdray: installing ${#missing[@]} Debian packages: ${missing[*]}" >&2
apt_get() { "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=300 "$@"; }
log=$(mktemp)
trap 'rm -f "$log"' EXIT
# The output of apt (hundreds of lines) is shown only after an error.
if ! { apt_get update && apt_get install -y --no-install-recommends "${missing[@]}"; } </dev/null >"$log" 2>&1; then
  tail -n 30 "$log" >&2
  echo "kdray: apt-get could not install them; see above" >&2
  exit 1
fi
