#!/usr/bin/env bash
# Packs the crates that are published, compiles each from its package alone, by default and with each of its features alone, and
# prints what each costs: the size of its package, and the crates that it depends on (itself included, on Linux) by default and with
# as few features as a use of it takes.
# usage: scripts/package.sh [--sizes | --built]
#   --sizes   packs and counts, and compiles nothing
#   --built   other crates are those that the tests were built with, with all of their features. Without it, each set of features has
#             no more of other crates than it asks for itself, as somebody has who depends on nothing else: before a release.
set -euo pipefail
cd "$(dirname "$0")/.."

compile=true built=false
case "${1:-}" in
  "") ;;
  --sizes) compile=false ;;
  --built) built=true ;;
  *) sed -n '2,8p' "$0" | cut -c3-; [ "$1" = -h ] || [ "$1" = --help ] && exit 0 || exit 2 ;;
esac

crates=(base events scene splat session rig)
export CARGO_INCREMENTAL=0 CARGO_PROFILE_DEV_DEBUG=false
# .ci/run has had clippy look at them.
unset RUSTC_WORKSPACE_WRAPPER
. scripts/driver.sh
target=$(cargo metadata --locked --no-deps --format-version 1 | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
unpacked=$target/unpacked
# Of the unpacked crates, which cannot be in one lock file with those here under the same name and version.
version=$(sed -n '/^\[workspace.package\]/,$s/^version = "\(.*\)"/\1+packed/p' Cargo.toml | head -n 1)

# Whether it is committed is not asked: the check is for what lies here. Cargo's own look at the packages would build all that they
# depend on once more, in another profile.
cargo package --locked --quiet --allow-dirty --no-verify "${crates[@]/#/-perfgs-}"

# A workspace of nothing but what the packages hold, each in place of what the registry has of that name. With the profiles of
# this one, so that other crates that the tests were built with are the same.
unpack() {
  local crate
  rm -rf "$unpacked"
  mkdir -p "$unpacked"
  {
    printf '[workspace]\nresolver = "3"\nmembers = ["*"]\n[patch.crates-io]\n'
    for crate in "${crates[@]}"; do
      # As of now: packages date all of their files to one day in 2006, and cargo would take what changed for what it knows.
      tar -xzmf "$target"/package/"erfgs-$crate"-*.crate -C "$unpacked"
      mv "$unpacked/erfgs-$crate"-* "$unpacked/$crate"
      sed -i "0,/^version = .*/s//version = \"$version\"/" "$unpacked/$crate/Cargo.toml"
      printf 'erfgs-%s = { path = "%s" }\n' "$crate" "$crate"
    done
    sed -n '/^\[profile/,$p' Cargo.toml
  } >"$unpacked/Cargo.toml"
  cp Cargo.lock "$unpacked"
}

# Compiled beside each of them, this has cargo settle on the same features of other crates as for the tests.
beside() {
  mkdir -p "$unpacked/beside/src"
  touch "$unpacked/beside/src/lib.rs"
  {
    printf '[package]\nname = "beside"\nversion = "0.0.0"\nedition = "2024"\n[dependencies]\n'
    cargo tree --locked --workspace --features "$ERFGS_FEATURES" --depth 1 --prefix none --no-dedupe -e normal,dev -f '{p}|{f}' \
      | sed -n 's/^\([^ ]*\) v\([0-9.]*\)[^ ]*|\(.*\)/\1 \2 \3/p' | sort -u | while read -r name its_version features; do
      [ -z "$features" ] || features="\"${features//,/\", \"}\""
      printf '%s = { version = "=%s", default-features = false, features = [%s] }\n' "$name" "$its_version" "$features"
    done
  } >"$unpacked/beside/Cargo.toml"
}

check() { # check CRATE [ARGUMENT...]
  local crate=$1
  shift
  set -- --quiet --manifest-path "$unpacked/Cargo.toml" --target-dir "$target" -p "erfgs-$crate@$version" "$@"
  # What cargo checks depends on what it checked, and what it builds on what it built.
  if $built; then
    RUSTC_WORKSPACE_WRAPPER=$PWD/scripts/looking-rustc.sh cargo build -p beside "$@"
  else
    cargo check "$@"
  fi
}

# Each feature alone, and none.
alone() { # alone CRATE FEATURE...
  local crate=$1 feature
  check "$crate" || { echo "package.sh: stopped at the package of erfgs-$crate" >&2; return 1; }
  shift
  check "$crate" --no-default-features || { echo "package.sh: stopped at erfgs-$crate without features" >&2; return 1; }
  for feature in "$@"; do
    check "$crate" --no-default-features --features "erfgs-$crate/$feature" \
      || { echo "package.sh: stopped at erfgs-$crate with the feature $feature alone" >&2; return 1; }
  done
}
if $compile; then
  unpack
  if $built; then beside; fi
  alone base files parallel
  alone events aedat4 npz digest serde
  alone scene cameras images formats exr
  alone splat
  alone session file pictures export exr rosbag2
  alone rig evk4 davis346 frames trigger
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
