#!/usr/bin/env bash
# Installs what is missing and runs all tests. Arguments go to `cargo test`: scripts/test.sh -p erfgs-train raster
# At the end it says which tests were not run for want of recordings that may not be passed on (tests/recordings).
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh --oracles --emulation --browser --slurm
. scripts/driver.sh
rm -rf target/not-run
if [ $# -gt 0 ]; then
  cargo test --locked "$@"
else
  cargo test --locked --workspace
  scripts/emulation.sh
fi
if [ -d target/not-run ]; then
  not_run=$(sort -u target/not-run/*)
  echo "test.sh: not run ($(wc -l <<<"$not_run")), as there is no such folder:"
  sed 's/^/  /' <<<"$not_run"
fi
