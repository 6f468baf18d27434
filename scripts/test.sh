#!/usr/bin/env bash
# Installs what is missing and runs all tests. Arguments go to `cargo test`: scripts/test.sh -p erfgs-train raster
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh --oracles --emulation
. scripts/driver.sh
if [ $# -gt 0 ]; then
  cargo test --locked "$@"
else
  cargo test --locked --workspace
  scripts/emulation.sh
fi
