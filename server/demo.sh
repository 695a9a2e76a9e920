#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The demonstration of `server/run --demo`, with the programs in the folder BIN: server/demo.sh BIN
# Uploads a mesh, queries rays and renders a picture. Only the files in out/demo remain.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=$1
out=$PWD/out/demo
step() { echo $'\n'"== $*"; }
# Shows a command as a user would type it, and runs it.
try() { echo "\$ kdray $*" >&2; "$bin/kdray" "$@"; }

mkdir -p "$out"
rm -f "$out"/*
data=$(mktemp -d)
daemon=
finish() {
  if [[ $daemon ]]; then
    kill "$daemon" 2>/dev/null || true
    wait "$daemon" || true
  fi
  rm -rf "$data"
}
trap finish EXIT

step "The daemon starts on a free port"
"$bin/kdrayd" --host 127.0.0.1 --port 0 --data-dir "$data/store" >"$data/ready" 2>"$out/kdrayd.log" &
daemon=$!
for _ in $(seq 300); do
  [[ -s $data/ready ]] && break
  kill -0 "$daemon" 2>/dev/null || { cat "$out/kdrayd.log" >&2; echo "kdrayd did not start" >&2; exit 1; }
  sleep 0.1
done
[[ -s $data/ready ]] || { echo "kdrayd did not say within 30 s that it listens" >&2; exit 1; }
cat "$data/ready"
KDRAY_SERVER=$(sed -n 's/^kdrayd listening on //p' "$data/ready")
export KDRAY_SERVER

step "A mesh goes in, a tree id comes out"
cd "$out"
try sample teapot -o teapot.obj
id=$(try upload teapot.obj)
echo "$id"

step "What one ray from above hits: t, triangle, u, v"
echo '{"rays": [[0, 10, 0, 0, -1, 0]]}' >one.json
try rays "$id" one.json -o one-hit.json
cat one-hit.json && echo

step "A batch: 100,000 random rays as .npy, hits as .npy"
try sample-rays --tree "$id" -n 100000 -o rays.npy
try rays "$id" rays.npy -o hits.npy

step "A picture, and one with the boxes of a kd-tree"
try render "$id" -o teapot.png
try upload teapot.obj --build kd-sah
try render "${id%-auto}-kd-sah" --cells-depth 8 -o teapot-cells.png

step "The daemon stops when it is told to"
kill "$daemon"
status=0
wait "$daemon" || status=$?
daemon=
((status == 0)) || { echo "kdrayd ended with $status instead of 0" >&2; exit 1; }
echo "kdrayd has ended. What was made:"
ls -l "$out"
echo
echo "The picture: $out/teapot.png"
echo "For your own meshes: server/run, then open http://127.0.0.1:8080 in a browser."
