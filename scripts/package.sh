#!/usr/bin/env bash
# Packs the crates that are published, compiles each from its package alone, and prints what each costs: the size of its package,
# and the crates that it depends on (itself included, on Linux) by default and with as few features as a use of it takes.
# Before that it looks whether each feature compiles alone.
# usage: scripts/package.sh [--sizes]   (--sizes packs and counts, and compiles nothing)
set -euo pipefail
cd "$(dirname "$0")/.."

compile=true
case "${1:-}" in
  "") ;;
  --sizes) compile=false ;;
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
if $compile; then
  alone base files parallel
  alone events aedat4 npz digest serde
  alone scene cameras images formats exr
  alone session file pictures export exr rosbag2
  alone rig evk4 davis346 frames trigger
fi
target=$(cargo metadata --locked --no-deps --format-version 1 | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
# Whether it is committed is not asked: the check is for what lies here. Cargo's own look at the packages would build all that they
# depend on once more, in another profile.
cargo package --locked --quiet --allow-dirty --no-verify "${crates[@]/#/-perfgs-}"

# A workspace of nothing but what the packages hold, each in place of what the registry has of that name. With the profiles of
# this one, so that dependencies that were read above are not read again.
if $compile; then
  unpacked=$target/unpacked
  rm -rf "$unpacked"
  mkdir -p "$unpacked"
  {
    printf '[workspace]\nresolver = "3"\nmembers = ["*"]\n[patch.crates-io]\n'
    for crate in "${crates[@]}"; do
      tar -xzf "$target"/package/"erfgs-$crate"-*.crate -C "$unpacked"
      printf 'erfgs-%s = { path = "%s" }\n' "$crate" "$(cd "$unpacked" && echo "erfgs-$crate"-*)"
    done
    sed -n '/^\[profile/,$p' Cargo.toml
  } >"$unpacked/Cargo.toml"
  cp Cargo.lock "$unpacked"
  for crate in "${crates[@]}"; do
    cargo check --quiet --manifest-path "$unpacked/Cargo.toml" --target-dir "$target" -p "erfgs-$crate"
  done
fi

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
