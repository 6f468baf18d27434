#!/usr/bin/env bash
# Feeds the decoders and the session file with what libFuzzer makes up, on stable Rust (targets: tests/fuzz/src/targets).
# usage: scripts/fuzz.sh [SECONDS] [TARGET...]   (60 seconds for each target, and all targets, without arguments)
# What is found lies in target/fuzz/artifacts; what covers more of the code is kept in target/fuzz/corpus for the next run.
set -euo pipefail
cd "$(dirname "$0")/.."
[ -x "$HOME/.cargo/bin/cargo" ] && PATH=$HOME/.cargo/bin:$PATH

all=$(sed -n 's|^    ("\([a-z0-9]*\)", [a-z0-9]*),$|\1|p' tests/fuzz/src/targets/mod.rs)
case "${1:-}" in
  -h|--help) sed -n '2,4p' "$0" | cut -c3-; echo "targets:" $all; exit 0 ;;
esac
export seconds=60
if [[ "${1:-}" =~ ^[0-9]+$ ]]; then seconds=$1; shift; fi
targets=${*:-$all}
for target in $targets; do
  grep -qx "$target" <<<"$all" || { echo "fuzz.sh: no target '$target'; there are:" $all >&2; exit 2; }
done

host=$(rustc -vV | sed -n 's/^host: //p')
export folder=target/fuzz binary=target/fuzz/$host/release/fuzz
rm -rf "$folder/seeds"
# The same versions of everything as in the workspace.
cp Cargo.lock tests/fuzz/libfuzzer/Cargo.lock
# What cargo-fuzz passes with --sanitizer none: the compiler counts the edges that run, and hands comparisons to libFuzzer.
flags="--cfg fuzzing -Cpasses=sancov-module"
for pass in level=4 inline-8bit-counters pc-table trace-compares; do
  flags+=" -Cllvm-args=-sanitizer-coverage-$pass"
done
# With a target named, build scripts and macros go without.
RUSTFLAGS=$flags cargo build --release --manifest-path tests/fuzz/libfuzzer/Cargo.toml --target-dir "$folder" --target "$host"

mkdir -p "$folder/artifacts"
fuzz() { # fuzz TARGET
  local log=$folder/$1.log corpus=$folder/corpus/$1 seeds=$folder/seeds/$1
  mkdir -p "$corpus" "$seeds"
  if ERFGS_FUZZ_TARGET=$1 ERFGS_FUZZ_SEEDS=$seeds "$binary" "$corpus" "$seeds" -max_total_time="$seconds" -timeout=20 -rss_limit_mb=3000 \
    -len_control=0 -print_final_stats=1 -artifact_prefix="$folder/artifacts/$1-" >"$log" 2>&1; then
    local edges runs
    edges=$(grep -o ' cov: [0-9]*' "$log" | tail -1)
    runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    echo "$1: ${runs:-?} inputs, ${edges# cov: } edges"
  else
    echo "fuzz.sh: $1 failed; to repeat: ERFGS_FUZZ_TARGET=$1 $binary $(sed -n 's/.*Test unit written to //p' "$log" | tail -1)" >&2
    grep -v '^#' "$log" | tail -50 >&2
    return 1
  fi
}
export -f fuzz
printf '%s\n' $targets | xargs -P "$(nproc)" -I '{}' bash -c 'fuzz {}'
