#!/usr/bin/env bash
# Runs the checks that plug emulated devices in: on this machine through umockdev, and in a QEMU guest with Debian's
# kernel. usage: scripts/emulation.sh [host] [CHECK...]   (all by default; CHECK: a job of scripts/guest/jobs)
set -euo pipefail
cd "$(dirname "$0")/.."
[ $# -gt 0 ] || set -- host independent uvc cameras show
[ -x "$HOME/.cargo/bin/cargo" ] && PATH=$HOME/.cargo/bin:$PATH

say() { printf '\n== %s\n' "$*"; }
say "building the emulated devices, and the drivers of others that open them"
make -C hardware-mocks/simavr BUILD="$PWD/target/trigger-board"
# The whole workspace is named, so that the features and with them all that `cargo test` built are the same.
cargo build --locked --workspace --bin erfgs-usbd --bin erfgs --example follow_pattern
CARGO_TARGET_DIR=target/independent cargo build --locked --release --manifest-path tests/guest/independent/Cargo.toml

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

for check in "$@"; do
  say "$check"
  started=$SECONDS
  case $check in
    host) host ;;
    cameras)
      binary=$(cargo test --locked --workspace --test guest_cameras --no-run --message-format json |
        grep -o '"executable":"[^"]*guest_cameras[^"]*"' | cut -d '"' -f 4)
      GUEST_CLOCK=instructions scripts/guest/run.sh cameras "$binary"
      ;;
    show)
      # Without what debuggers read, which is most of them: every byte passes an emulated processor.
      mkdir -p target/guest/programs
      for program in erfgs erfgs-usbd; do strip -o target/guest/programs/$program target/debug/$program; done
      GUEST_SECONDS=900 GUEST_CLOCK=instructions scripts/guest/run.sh show target/guest/programs
      ;;
    *) scripts/guest/run.sh "$check" ;;
  esac
  echo "$check: passed after $((SECONDS - started)) s"
done
