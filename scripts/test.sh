#!/usr/bin/env bash
# Installs what is missing and runs all tests, the emulated devices beside them. Arguments go to `cargo test`, which then runs
# alone: scripts/test.sh -p erfgs-splat raster
# At the end it says which tests were not run for want of recordings that may not be passed on (tests/recordings).
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh --oracles --emulation --browser --slurm
. scripts/driver.sh
rm -rf target/not-run
# Recordings that may not be passed on are here or are not; a test that needs one fails unless somebody says that there are none.
if [ -z "${ERFGS_SHARED:-}" ] && [ ! -d ../shared ]; then export ERFGS_SHARED=none; fi
if [ $# -gt 0 ]; then
  cargo test --locked "$@"
else
  all=(--locked --workspace --features "$ERFGS_FEATURES")
  # What the emulated machines run comes first. Cameras on this machine live in real time, and drivers give up on those that a busy
  # machine keeps from answering: half a minute for them alone. A guest takes one processor for minutes, which tests that wait leave idle.
  scripts/emulation.sh build
  scripts/emulation.sh run host
  set -m
  nice -n 5 scripts/emulation.sh run all >target/emulation.log 2>&1 &
  emulation=$!
  set +m
  trap 'kill -- -$emulation 2>/dev/null || true' EXIT
  cargo test "${all[@]}"
  scripts/python.sh
  code=0
  wait $emulation || code=$?
  trap - EXIT
  cat target/emulation.log
  [ $code = 0 ] || { echo "test.sh: scripts/emulation.sh ended with $code" >&2; exit $code; }
fi
if [ -d target/not-run ]; then
  not_run=$(sort -u target/not-run/*)
  echo "test.sh: not run ($(wc -l <<<"$not_run")), for want of recordings (ERFGS_SHARED names their folder):"
  sed 's/^/  /' <<<"$not_run"
fi
