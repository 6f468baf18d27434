#!/usr/bin/env bash
# Installs what is missing and runs all tests. Arguments go to `cargo test`: scripts/test.sh -p erfgs-train raster
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh --oracles
. scripts/driver.sh
if [ $# -eq 0 ]; then set -- --workspace; fi
cargo test --locked "$@"
