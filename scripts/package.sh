#!/usr/bin/env bash
# Packs the crates that are published, builds each from its package alone, and prints what each costs: the size of its package,
# and the crates that it depends on (itself included, on Linux) by default and with as few features as a use of it takes.
# Before that it looks whether each feature compiles alone.
# usage: scripts/package.sh [--sizes]   (--sizes packs and counts, and builds nothing)
set -euo pipefail
cd "$(dirname "$0")/.."

build=()
case "${1:-}" in
  "") ;;
  --sizes) build=(--no-verify) ;;
  *) sed -n '2,5p' "$0" | cut -c3-; [ "$1" = -h ] || [ "$1" = --help ] && exit 0 || exit 2 ;;
esac

crates=(base events scene session rig)
export CARGO_INCREMENTAL=0 CARGO_PROFILE_DEV_DEBUG=false
# .ci/run has had clippy look at them.
unset RUSTC_WORKSPACE_WRAPPER

# Each feature alone, and none.
alone() { # alone CRATE FEATURE...
  local crate=$1 feature
  shift
  for feature in '' "$@"; do
    cargo check --quiet --locked -p "erfgs-$crate" --no-default-features --features "$feature" \
      || { echo "package.sh: erfgs-$crate does not compile with the features '$feature' alone" >&2; return 1; }
  done
}
if [ ${#build[@]} -eq 0 ]; then
  alone base files parallel
  alone events aedat4 npz digest serde
  alone scene cameras images formats exr
  alone session file pictures export exr rosbag2
  alone rig evk4 davis346 frames trigger
fi
# Cargo takes a package of a version for what it was when that version was first unpacked and built here.
target=$(cargo metadata --locked --no-deps --format-version 1 | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
rm -rf "${CARGO_HOME:-$HOME/.cargo}"/registry/{src,cache}/-*/erfgs-*
built=$(grep -sl 'registry/src/-' "$target"/debug/deps/erfgs_*.d || true)
for file in $built; do
  hash=${file##*-}
  rm -rf "$target"/debug/.fingerprint/erfgs-*-"${hash%.d}"
done
# Whether it is committed is not asked: the check is for what lies here. What is built goes to the folder of all builds.
# shellcheck disable=SC2068
cargo package --locked --quiet --allow-dirty "${build[@]}" ${crates[@]/#/-p erfgs-}

# count CRATE [ARGUMENT...]
count() {
  local crate=$1
  shift
  cargo tree --locked -p "erfgs-$crate" --target x86_64-unknown-linux-gnu -e normal --prefix none "$@" \
    | sed 's/ (.*//' | sort -u | wc -l
}

row() { printf '%-16s %8s %8s   %s\n' "$@"; }
row package kB crates features
for crate in "${crates[@]}"; do
  bytes=$(cat "$target"/package/"erfgs-$crate"-*.crate | wc -c)
  row "erfgs-$crate" $((bytes / 1000)) "$(count "$crate")" default
  row '' '' "$(count "$crate" --no-default-features)" none
  case $crate in
    scene) row '' '' "$(count scene --no-default-features --features cameras)" cameras ;;
    session) row '' '' "$(count session --no-default-features --features file)" file ;;
    rig)
      for feature in evk4 davis346 frames trigger; do
        row '' '' "$(count rig --no-default-features --features $feature)" $feature
      done
      ;;
  esac
done
