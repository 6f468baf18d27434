#!/usr/bin/env bash
# Has Rerun read what `erfgs export --to foxglove` and `--to rosbag2` write: every picture must become an EncodedImage, every lens a
# Pinhole and every pose a Transform3D. Rerun is installed into target/rerun, which takes 680 MB; that is why this is no part of the tests.
set -euo pipefail
cd "$(dirname "$0")/.."

usage="usage: scripts/rerun.sh [FILE.mcap...]
  FILE.mcap  what was exported with --rig; without any a small take of the emulated rig is recorded, calibrated and exported"
case ${1:-} in
  -h | --help) sed -n '2,3p' "$0" | cut -c3-; echo "$usage"; exit 0 ;;
  -*) echo "rerun.sh: unknown option $1" >&2; echo "$usage" >&2; exit 2 ;;
esac

version=0.41.0 venv=target/rerun
if ! "$venv/bin/rerun" --version 2>/dev/null | grep -q " $version "; then
  python3 -m venv --clear "$venv"
  "$venv/bin/pip" install --quiet --no-compile --disable-pip-version-check "rerun-sdk==$version"
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
if [ $# = 0 ]; then
  . scripts/driver.sh
  programs=${CARGO_TARGET_DIR:-target}/debug
  cargo build --locked --workspace --features "$ERFGS_FEATURES" --bin erfgs --bin erfgs-emulated-rig
  for take in screen wand performance; do
    "$programs/erfgs-emulated-rig" $take "$work/$take.mcap" --small
  done
  "$programs/erfgs" calibrate board "$work/screen.mcap" --target chessboard:9x6:0.03 --blink 15 --intrinsics-only --out "$work/lenses.json"
  "$programs/erfgs" calibrate wand "$work/wand.mcap" --wand 0.13+0.26 --led-hz 385,500,625 --rig "$work/lenses.json" --out "$work/rig.json"
  "$programs/erfgs" export "$work/performance.mcap" --to foxglove --rig "$work/rig.json" --out "$work/take.foxglove.mcap"
  "$programs/erfgs" export "$work/performance.mcap" --to rosbag2 --rig "$work/rig.json" --out "$work/bag"
  set -- "$work/take.foxglove.mcap" "$work/bag/bag_0.mcap"
fi

for file; do
  "$venv/bin/rerun" mcap check --full "$file"
  "$venv/bin/rerun" mcap convert "$file" -o "$work/read.rrd" >"$work/convert.log" 2>&1 || { cat "$work/convert.log" >&2; exit 1; }
  # That it makes a name of its own of the file's path is no complaint.
  if grep -E 'WARN|ERROR' "$work/convert.log" | grep -v 'Application ID' >&2; then
    echo "rerun.sh: Rerun complains of $file" >&2
    exit 1
  fi
  "$venv/bin/rerun" rrd print "$work/read.rrd" >"$work/read.txt"
  for column in EncodedImage:blob CoordinateFrame:frame Pinhole:image_from_camera Pinhole:resolution Transform3D:translation Transform3D:quaternion; do
    grep -q "$column" "$work/read.txt" || { echo "rerun.sh: Rerun finds no $column in $file" >&2; exit 1; }
  done
  echo "$file: $(grep -c EncodedImage:blob "$work/read.txt") chunks of pictures, $(grep -c Pinhole:resolution "$work/read.txt") lenses, poses"
done
