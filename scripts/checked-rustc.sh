#!/usr/bin/env bash
# The compiler of the workspace's own crates in .ci/run, which names it in RUSTC_WORKSPACE_WRAPPER: clippy looks at each crate
# and, where it has documentation, rustdoc. What either warns of is an error. `cargo clippy` and `cargo doc` find the same, but read
# all dependencies once more for it. A library with unit tests is compiled twice, and clippy looks at it with
# its tests; what only shows without them, such as functions that nothing but tests call, the compiler itself finds.
# usage: checked-rustc.sh RUSTC [ARGUMENT...]
set -euo pipefail

# Cargo asks the compiler what it is, too.
if [ -z "${CARGO_CRATE_NAME:-}" ]; then exec "$@"; fi

# What the two write is looked at by nobody.
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

arguments=() previous='' form=test source='' level=0
for argument in "${@:2}"; do
  case $previous=$argument in
    --out-dir=*) argument=$scratch ;;
    --crate-type=lib) form=library ;;
    --crate-type=bin) form=program ;;
    =--emit=*) argument=--emit=metadata ;;
    # Of a file that is written cargo hears from the compiler, which writes its own.
    =--json=*) argument=${argument/artifacts,/} ;;
    -C=opt-level=*) level=${argument#*=} ;;
    =*.rs) source=$argument ;;
  esac
  previous=
  case $argument in --out-dir | --crate-type | -C) previous=$argument ;; esac
  arguments+=("$argument")
done

# Tests run once. Where what they do themselves is little, it takes longer to optimise them than they ever run; the libraries that they
# test are compiled as for everything else. Of the calibration, the trainer and the renderer that is so of unit tests alone.
case $form:$CARGO_PKG_NAME:$source in
  test:erfgs-base:* | test:erfgs-recorder:* | test:erfgs-replay:* | test:erfgs-rig:* | test:erfgs-scene:* | \
    test:erfgs-session:* | test:erfgs-sync:* | test:erfgs-calibrate:*src/lib.rs | test:erfgs-train:*src/lib.rs | test:erfgs-splat:*src/lib.rs)
    set -- "$@" -C opt-level=0
    level=0
    ;;
esac

# What computes is compiled in one part: parts see nothing of each other (`lto` of the profile), and calibrations take a fifth less so. By
# default it is many, for whoever builds again after a change.
if [ "$level" = 2 ]; then set -- "$@" -C codegen-units=1; fi

# Nobody runs the studies here, nor benchmarks: that they compile is told without code being made of them.
case $CARGO_PKG_NAME:$source in
  erfgs-lab:*src/bin/* | *:*benches/*)
    "${0%/*}/looking-rustc.sh" clippy-driver "$@" -D warnings
    exit
    ;;
esac

# Clippy is the compiler with more to say, which optimises less: of what is not optimised, it reads, looks and writes in one.
alone=true
if [ $form != library ] && [ "$level" = 0 ]; then
  alone=false
elif [ $form != library ] || ! grep -rqs 'cfg(test)' "$(dirname "$source")"; then
  clippy-driver "$1" "${arguments[@]}" -D warnings
fi

# Neither tests nor examples nor build scripts are documented, and of a program what is private, too.
case $form:$source in
  test:* | *examples/* | *build.rs) ;;
  *)
    for at in "${!arguments[@]}"; do
      case ${arguments[at]} in --emit=metadata) unset "arguments[at]" ;; esac
    done
    if [ $form = program ]; then arguments+=(--document-private-items); fi
    rustdoc "${arguments[@]}" -D warnings
    ;;
esac

if $alone; then "$@" -D warnings; else clippy-driver "$@" -D warnings; fi
