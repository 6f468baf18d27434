#!/usr/bin/env bash
# A rig of emulated RGB and event cameras records a calibration and a small stage, as a real one would; what it saw is
# reconstructed by 4DGS and by ERF-GS, trained for equal time, and compared in a report. With the folder of a PanopticSports
# recording, does the same with that; with --stage, with a film of the stage whose cameras and clocks are known. ERF-GS reconstructs what
# moves as bodies, which are found before.
set -euo pipefail
cd "$(dirname "$0")/.."

usage="usage: scripts/demo.sh [--small | --stage | PANOPTIC_FOLDER [--frames A..B]] [--out FOLDER] [--minutes M]

  --small          a rig of seven cameras and short takes, trained for 10 s
  --stage          the stage is filmed directly, without a rig, its recordings and its calibration
  PANOPTIC_FOLDER  a recording of PanopticSports, such as basketball
  --frames A..B    the frames of the recording to take, both ends included (default: all)
  --out FOLDER     where everything goes (default: demo-rig, demo-small, demo-stage or demo-panoptic); what is there already is
                   not made again
  --minutes M      training time of each method (default: 3; 4 with --stage, 18 for a recording)"
what=rig recording= frames=() out= minutes= small=()
while [ $# -gt 0 ]; do
  case "$1" in
    -h|--help) sed -n '2,5p' "$0" | cut -c3-; echo; echo "$usage"; exit 0 ;;
    --frames) frames=(--frames "${2:?$usage}"); shift 2 ;;
    --stage) what=stage; shift ;;
    --small) small=(--small); shift ;;
    --out) out=${2:?$usage}; shift 2 ;;
    --minutes) minutes=${2:?$usage}; shift 2 ;;
    -*) echo "demo.sh: unknown option $1" >&2; echo "$usage" >&2; exit 2 ;;
    *) recording=$1; shift ;;
  esac
done
wrong() { echo "demo.sh: $1" >&2; echo "$usage" >&2; exit 2; }
if [ -n "$recording" ]; then
  [ $what = rig ] || wrong "--stage takes no recording"
  what=recording
  [ -e "$recording/train_meta.json" ] || {
    echo "demo.sh: $recording holds no train_meta.json, so it is no PanopticSports recording" >&2
    exit 2
  }
elif [ ${#frames[@]} -gt 0 ]; then
  wrong "--frames goes with a recording"
fi
[ $what = rig ] || [ ${#small[@]} = 0 ] || wrong "--small is of the rig alone"

scripts/setup.sh
. scripts/driver.sh
[ -x "$HOME/.cargo/bin/cargo" ] && PATH=$HOME/.cargo/bin:$PATH
cargo build --release --locked -p erfgs -p erfgs-stage -p erfgs-emulated-rig --bins
PATH=$PWD/target/release:$PATH
erfgs doctor

say() { printf '\n== %s\n' "$*"; }
started=$SECONDS
if [ $what = recording ]; then
  out=${out:-demo-panoptic} minutes=${minutes:-18}
  mkdir -p "$out"
  if [ ! -e "$out/full/dataset.json" ]; then
    say "importing the recording at half size"
    erfgs dataset import panoptic "$recording" "${frames[@]}" --scale 0.5 --out "$out/full"
  fi
  if [ ! -e "$out/ds/dataset.json" ]; then
    say "keeping each fourth frame, blurred over three; four cameras keep their events alone"
    erfgs dataset variant "$out/full" --subsample 4 --blur 3 --event-only 4 --out "$out/ds"
  fi
elif [ $what = rig ]; then
  if [ ${#small[@]} -gt 0 ]; then
    out=${out:-demo-small} minutes=${minutes:-0.17}
  else
    out=${out:-demo-rig} minutes=${minutes:-3}
  fi
  mkdir -p "$out"
  for take in screen wand performance; do
    if [ ! -e "$out/$take.mcap" ]; then
      say "recording: $take"
      rm -f "$out/$take.part.mcap"
      erfgs-emulated-rig "$take" "$out/$take.part.mcap" "${small[@]}"
      mv "$out/$take.part.mcap" "$out/$take.mcap"
    fi
  done
  if [ ! -e "$out/lenses.json" ]; then
    say "lenses, from a board that blinks on a screen"
    erfgs calibrate board "$out/screen.mcap" --target chessboard:9x6:0.03 --blink 15 --intrinsics-only --out "$out/lenses.json"
  fi
  if [ ! -e "$out/rig.json" ]; then
    say "poses and clocks, from a wand that is waved"
    erfgs calibrate wand "$out/wand.mcap" --wand 0.13+0.26 --led-hz 385,500,625 --rig "$out/lenses.json" --out "$out/rig.json"
  fi
  if [ ! -e "$out/ds/dataset.json" ]; then
    say "the recording becomes a dataset"
    # An EVK4 has four times as many columns as the other cameras. The cameras that run freely are held out.
    if [ ${#small[@]} -gt 0 ]; then
      options=(--scale 0.5 --scale-of event0=0.125 --seconds 0.2 --test free0)
    else
      options=(--scale 0.5 --scale-of event0=0.25 --scale-of event1=0.25 --seconds 0.5 --test free0,free1)
    fi
    rm -rf "$out/recorded"
    erfgs dataset import session "$out/performance.mcap" --rig "$out/rig.json" --from 1.5 "${options[@]}" --out "$out/recorded"
    erfgs dataset undistort "$out/recorded" --out "$out/ds"
  fi
else
  out=${out:-demo-stage} minutes=${minutes:-4}
  mkdir -p "$out"
  if [ ! -e "$out/ds/dataset.json" ]; then
    say "filming the stage"
    erfgs-stage film --rgb-fps 20 --out "$out/ds"
  fi
fi
if ! erfgs info "$out/ds" --json | grep -q '"points": [0-9]'; then
  say "finding the initial points"
  points=()
  # Bare walls and floor have few features; the sweep fills them.
  [ $what = recording ] && points=(--method colmap+sweep --max-points 25000)
  erfgs dataset points "$out/ds" "${points[@]}"
fi
# About as many iterations as the time allows on a fast machine, so that both methods train for equal time. Both take a frame for
# the middle of its exposure, so that what differs is what events add; the model of the exposure does not pay in so short a time.
options=(--iterations 3000+14000 --set blur.model=off)
[ $what = recording ] && options=()
# The event cameras of a rig have more pixels, so that an iteration takes longer.
if [ $what = rig ]; then
  iterations=1000+4000
  [ ${#small[@]} -gt 0 ] && iterations=150+350
  options=(--iterations "$iterations" --set blur.model=off)
fi
if [ $what != recording ] && [ ${#small[@]} = 0 ] && [ ! -e "$out/ds/bodies.json" ]; then
  say "finding bodies: what moves, how it turns, and its shapes"
  erfgs dataset bodies "$out/ds"
fi
runs=()
for method in 4dgs erf-gs; do
  run=$out/run-$method
  runs+=("$run")
  if [ ! -e "$run/metrics.json" ]; then
    say "training $method for $minutes minutes"
    resume=()
    [ -e "$run/checkpoint.bin" ] && resume=(--resume)
    erfgs train "$out/ds" --minutes "$minutes" --method "$method" "${options[@]}" --seed 1 --out "$run" "${resume[@]}"
    say "evaluating $method on the held-out cameras"
    erfgs eval "$run"
  fi
done
say "comparing"
erfgs report "${runs[@]}" --out "$out/report.html"
echo
echo "report: $out/report.html (everything after the build took $(((SECONDS - started) / 60)) min $(((SECONDS - started) % 60)) s)"
[ $what = rig ] && echo "calibration: $out/lenses.html and $out/rig.html"
echo "walk around in it: target/release/erfgs view $out/run-4dgs ${runs[-1]}"
