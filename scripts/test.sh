#!/usr/bin/env bash
# Installs what is missing and runs all tests. Arguments go to `cargo test`: scripts/test.sh -p erfgs-train raster
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh --oracles --emulation
. scripts/driver.sh
if [ $# -gt 0 ]; then
  cargo test --locked "$@"
else
  cargo test --locked --workspace --no-run
  # An emulated processor keeps one core busy, and some tests do no more: side by side both are done sooner.
  log=target/emulation.log
  set -m # a process group of its own, so that nothing of it outlives this script
  scripts/emulation.sh >"$log" 2>&1 &
  emulation=$!
  set +m
  trap 'kill -- -$emulation 2>/dev/null || true' EXIT
  cargo test --locked --workspace
  echo "waiting for the emulated devices (scripts/emulation.sh, so far in $log)"
  passed=yes
  wait $emulation || passed=no
  cat "$log"
  [ $passed = yes ] || { echo "test.sh: a check on emulated devices failed, see above; to repeat: scripts/emulation.sh" >&2; exit 1; }
fi
