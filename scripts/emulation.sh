#!/usr/bin/env bash
# Runs the checks that plug emulated devices in: on this machine through umockdev, and in a QEMU guest with Debian's
# kernel. usage: scripts/emulation.sh [build] [host] [CHECK...]
#   build    builds what the checks run, and nothing else unless it is named (without it, that is done first)
#   run      the checks alone: what they run is built
#   CHECK    a job of scripts/guest/jobs; without any, the host, and the guest with the job all (the others in one boot)
set -euo pipefail
cd "$(dirname "$0")/.."
[ -x "$HOME/.cargo/bin/cargo" ] && PATH=$HOME/.cargo/bin:$PATH
. scripts/driver.sh

say() { printf '\n== %s\n' "$*"; }

build() {
  say "building the emulated devices, and the drivers of others that open them"
  make -C hardware-mocks/simavr BUILD="$PWD/target/trigger-board"
  # The whole workspace is named, so that the features and with them all that `cargo test` builds are the same.
  local all=(--locked --workspace --features "$ERFGS_FEATURES") binary
  cargo build "${all[@]}" --bin erfgs-usbd --bin erfgs --example follow_pattern
  binary=$(cargo test "${all[@]}" --test guest_cameras --no-run --message-format json |
    grep -o '"executable":"[^"]*guest_cameras[^"]*"' | cut -d '"' -f 4)
  mkdir -p target/emulation
  ln -f "$binary" target/emulation/guest_cameras
  # Without what debuggers read, which is most of them: in the guest every byte passes an emulated processor.
  local program
  for program in erfgs erfgs-usbd; do strip -o target/emulation/$program target/debug/$program; done
  # These are others' crates.
  CARGO_TARGET_DIR=target/independent env -u RUSTC_WORKSPACE_WRAPPER cargo build --locked --release --manifest-path tests/guest/independent/Cargo.toml
}

# The emulated cameras on this machine, without a kernel module.
host() {
  mkdir -p target/umockdev
  gcc -O2 -Wall -Wextra -Werror -o target/umockdev/bridge hardware-mocks/umockdev/bridge.c $(pkg-config --cflags --libs umockdev-1.0)
  local cameras=("evk4 00051234 100000 2" "davis346 00000336 50000 2") camera code=0
  plugged() { # plugged SECONDS PROGRAM...: runs it with the cameras on its bus
    timeout "$1" umockdev-wrapper target/umockdev/bridge "$folder" "${@:2}" || code=1
  }
  serve tests/guest/cameras.toml
  for camera in "${cameras[@]}"; do plugged 60 target/independent/release/independent $camera; done
  # Our own driver, through the same libusb.
  for camera in "${cameras[@]}"; do plugged 200 target/debug/examples/follow_pattern $camera; done
  plugged 60 target/debug/erfgs devices --json >"$folder/devices.json"
  for camera in '"00051234"' '"00000336"'; do
    grep -q "$camera" "$folder/devices.json" || { cat "$folder/devices.json"; echo "erfgs devices does not list $camera"; code=1; }
  done
  dismiss 0,0
  # Transfers that come late or in pieces cost nothing.
  serve tests/guest/faults.toml
  for camera in "${cameras[@]}"; do plugged 200 target/debug/examples/follow_pattern $camera; done
  dismiss 3,3
  return $code
}

serve() { # serve RIG.toml: its devices, in $folder
  folder=$(mktemp -d)
  mkfifo "$folder/commands"
  target/debug/erfgs-usbd "$1" --sockets "$folder" --ledger "$folder/ledger.json" <"$folder/commands" &
  daemon=$!
  exec 3>"$folder/commands"
  until [ "$(ls "$folder"/*.sock 2>/dev/null | wc -l)" = 2 ]; do
    kill -0 $daemon || return 1
    sleep 0.05
  done
}

dismiss() { # dismiss FAULTS: the devices that are served, and how many faults each should have had
  echo quit >&3
  exec 3>&-
  wait $daemon || code=1
  local faults
  faults=$(grep -o '"faults": *[0-9]*' "$folder/ledger.json" | grep -o '[0-9]*$' | paste -sd ,)
  [ "$faults" = "$1" ] || { echo "the cameras had $faults faults, not $1"; code=1; }
  rm -rf "$folder"
}

case "${1:-}" in
  build)
    build
    [ $# -gt 1 ] || exit 0
    shift
    ;;
  run) shift ;;
  *) build ;;
esac
[ $# -gt 0 ] || set -- host all
# In the guest's own time, so that it does not matter what this machine does besides.
export GUEST_CLOCK=instructions GUEST_SECONDS=900
# It takes what nobody else wants.
guest() { nice -n 10 scripts/guest/run.sh "$@"; }
for check in "$@"; do
  say "$check"
  started=$SECONDS
  case $check in
    host) host ;;
    all) guest all target/emulation/guest_cameras target/emulation ;;
    cameras) guest cameras target/emulation/guest_cameras ;;
    show) guest show target/emulation ;;
    *) guest "$check" ;;
  esac
  echo "$check: passed after $((SECONDS - started)) s"
done
