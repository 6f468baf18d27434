#!/usr/bin/env bash
# Feeds the decoders and the session file with what libFuzzer makes up, on stable Rust (targets: session/fuzz).
# usage: scripts/fuzz.sh [SECONDS] [TARGET...]   (8 seconds for each target, and all targets, without arguments)
# What is found lies in target/fuzz/artifacts; what covers more of the code is kept in target/fuzz/corpus for the next run.
set -euo pipefail
cd "$(dirname "$0")/.."
[ -x "$HOME/.cargo/bin/cargo" ] && PATH=$HOME/.cargo/bin:$PATH

all=$(sed -n 's|^path = "fuzz_targets/\(.*\)\.rs"|\1|p' session/fuzz/Cargo.toml)
case "${1:-}" in
  -h|--help) sed -n '2,4p' "$0" | cut -c3-; echo "targets:" $all; exit 0 ;;
esac
export seconds=8
if [[ "${1:-}" =~ ^[0-9]+$ ]]; then seconds=$1; shift; fi
targets=${*:-$all}
for target in $targets; do
  grep -qx "$target" <<<"$all" || { echo "fuzz.sh: no target '$target'; there are:" $all >&2; exit 2; }
done

host=$(rustc -vV | sed -n 's/^host: //p')
export folder=target/fuzz binaries=target/fuzz/$host/release
rm -rf "$folder/seeds"
# The whole workspace is named, so that what `cargo test` built will do.
cargo build --quiet --locked --workspace --example fuzz_seeds
target/debug/examples/fuzz_seeds "$folder/seeds"
# The same versions of everything as in the workspace.
cp Cargo.lock session/fuzz/Cargo.lock
# What cargo-fuzz passes with --sanitizer none: the compiler counts the edges that run, and hands comparisons to libFuzzer.
flags="--cfg fuzzing -Cpasses=sancov-module"
for pass in level=4 inline-8bit-counters pc-table trace-compares; do
  flags+=" -Cllvm-args=-sanitizer-coverage-$pass"
done
# With a target named, build scripts and macros go without.
RUSTFLAGS=$flags cargo build --release --manifest-path session/fuzz/Cargo.toml --target-dir "$folder" --target "$host" \
  $(printf -- '--bin %s ' $targets)

mkdir -p "$folder/artifacts"
# Sessions that are repaired are files; in memory nobody waits for a disk.
[ -w /dev/shm ] && export TMPDIR=/dev/shm
fuzz() { # fuzz TARGET
  local log=$folder/$1.log corpus=$folder/corpus/$1
  mkdir -p "$corpus" "$folder/seeds/$1"
  if "$binaries/$1" "$corpus" "$folder/seeds/$1" -max_total_time="$seconds" -timeout=20 -rss_limit_mb=3000 \
    -len_control=0 -print_final_stats=1 -artifact_prefix="$folder/artifacts/$1-" >"$log" 2>&1; then
    local edges runs
    edges=$(grep -o ' cov: [0-9]*' "$log" | tail -1)
    runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    echo "$1: ${runs:-?} inputs, ${edges# cov: } edges"
  else
    echo "fuzz.sh: $1 failed; to repeat: $binaries/$1 $(sed -n 's/.*Test unit written to //p' "$log" | tail -1)" >&2
    grep -v '^#' "$log" | tail -50 >&2
    return 1
  fi
}
export -f fuzz
printf '%s\n' $targets | xargs -P "$(nproc)" -I '{}' bash -c 'fuzz {}'
