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
  has() { # has FILE TEXT...: each of them is in it
    local text
    for text in "${@:2}"; do
      grep -qF -- "$text" "$1" || { cat "$1"; echo "it lacks: $text"; code=1; }
    done
  }
  serve tests/guest/cameras.toml
  for camera in "${cameras[@]}"; do plugged 60 target/independent/release/independent $camera; done
  # Our own driver, through the same libusb.
  for camera in "${cameras[@]}"; do plugged 200 target/debug/examples/follow_pattern $camera; done
  plugged 60 target/debug/erfgs devices --json >"$folder/devices.json"
  has "$folder/devices.json" '"00051234"' '"00000336"'
  dismiss 0,0
  # Transfers that come late or in pieces cost nothing.
  serve tests/guest/faults.toml
  for camera in "${cameras[@]}"; do plugged 200 target/debug/examples/follow_pattern $camera; done
  dismiss 3,3
  u3v
  return $code
}

# A USB3 Vision camera: Aravis lists, reads and sets it, and our program records it; every frame and every loss is accounted for.
u3v() {
  serve tests/guest/u3v.toml kept
  plugged 60 arv-tool-0.8 control Width ExposureTime=3000 PixelFormat=Mono12p >"$folder/set"
  has "$folder/set" '-U3V00042 (USB3)' 'Width = 160 min:16 max:160 inc:4' 'ExposureTime = 3000 us' 'PixelFormat = Mono12p'
  plugged 60 arv-tool-0.8 values >"$folder/values"
  has "$folder/values" "'DeviceModelName' = 'Emulated U3V'" "'DeviceTemperature' = 41.5 C" "'TriggerMode' = 'Off'"
  plugged 60 target/debug/erfgs devices --json >"$folder/devices.json"
  has "$folder/devices.json" '"erfgs Emulated U3V \"mono\""' '"U3V00042"' '"5 Gbit/s"'
  plugged 60 target/debug/erfgs record tests/guest/u3v-rig.toml --out "$folder/take.mcap" --seconds 3 --disk-test 0 --quiet --json \
    >"$folder/summary.json"
  has "$folder/summary.json" '"driver": 3,'
  target/debug/erfgs sync "$folder/take.mcap" --json >"$folder/sync.json" || code=1
  has "$folder/sync.json" '"free-running"'
  target/debug/erfgs export "$folder/take.mcap" --to png --out "$folder/pictures" --quiet || code=1
  bye 0
  python3 tests/guest/u3v.py "$folder" || code=1
  rm -rf "$folder"
}

serve() { # serve RIG.toml [kept]: its devices, in $folder; kept: with a copy of all that they deliver
  local devices keep=()
  devices=$(grep -c '^\[\[device\]\]' "$1")
  folder=$(mktemp -d)
  if [ $# -gt 1 ]; then
    mkdir "$folder/$2"
    keep=(--keep "$folder/$2")
  fi
  mkfifo "$folder/commands"
  target/debug/erfgs-usbd "$1" --sockets "$folder" --ledger "$folder/ledger.json" "${keep[@]}" <"$folder/commands" &
  daemon=$!
  exec 3>"$folder/commands"
  until [ "$(ls "$folder"/*.sock 2>/dev/null | wc -l)" = "$devices" ]; do
    kill -0 $daemon || return 1
    sleep 0.05
  done
}

dismiss() { # dismiss FAULTS: the devices that are served, and how many faults each should have had
  bye "$1"
  rm -rf "$folder"
}

bye() { # bye FAULTS: as dismiss, and leaves what they wrote
  echo quit >&3
  exec 3>&-
  wait $daemon || code=1
  local faults
  faults=$(grep -o '"faults": *[0-9]*' "$folder/ledger.json" | grep -o '[0-9]*$' | paste -sd ,)
  [ "$faults" = "$1" ] || { echo "the cameras had $faults faults, not $1"; code=1; }
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
