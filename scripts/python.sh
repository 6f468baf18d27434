#!/usr/bin/env bash
# Builds the Python wheel, installs it into a fresh environment, and tests it there: types (mypy), stubs against the module (stubtest),
# and recordings (pytest). Arguments go to pytest.
set -euo pipefail
cd "$(dirname "$0")/.."

command -v python3 >/dev/null || { echo "python.sh: python3 is missing: scripts/setup.sh --oracles installs it" >&2; exit 1; }
. scripts/driver.sh
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/target}

# The tool that builds wheels is kept from run to run.
maturin=1.16.0 tools=$CARGO_TARGET_DIR/maturin-tools
if ! "$tools/bin/maturin" --version 2>/dev/null | grep -qx "maturin $maturin"; then
  python3 -m venv --clear "$tools"
  "$tools/bin/pip" install --quiet --no-compile --disable-pip-version-check "maturin==$maturin"
fi

# Real recordings, if scripts/setup.sh --oracles has not fetched them, and the programs that record emulated ones, film and train.
recordings=${ERFGS_RECORDINGS:-$PWD/target/recordings}
[ -n "${ERFGS_RECORDINGS:-}" ] || python3 tests/oracles/recordings.py "$recordings"
cargo build --locked --workspace --features "$ERFGS_FEATURES" --bin erfgs-emulated-rig --bin erfgs-stage
# The program as its tests have it, who have built it already: `cargo build` would build all of it in another way.
cargo test --locked --workspace --features "$ERFGS_FEATURES" --no-run --quiet --test pipeline

# As the tests are built, and with this machine's libraries: a wheel for others is that of scripts/release.sh.
wheels=$CARGO_TARGET_DIR/wheels
rm -rf "$wheels"
(cd python && "$tools/bin/maturin" build --quiet --profile dev --locked --auditwheel skip --out "$wheels")

fresh=$CARGO_TARGET_DIR/python-fresh
python3 -m venv --clear "$fresh"
"$fresh/bin/pip" install --quiet --no-compile --disable-pip-version-check -r python/tests/requirements.txt "$wheels"/erfgs-*.whl
"$fresh/bin/python" -m mypy --strict --cache-dir "$CARGO_TARGET_DIR/mypy" -p erfgs
"$fresh/bin/python" -m mypy --strict --cache-dir "$CARGO_TARGET_DIR/mypy" python/examples/*.py
(cd "$CARGO_TARGET_DIR" && "$fresh/bin/python" -m mypy.stubtest erfgs)
export ERFGS_RECORDINGS=$recordings ERFGS_PROGRAMS=$CARGO_TARGET_DIR/debug
"$fresh/bin/python" -m pytest -q -p no:cacheprovider -c python/pyproject.toml python/tests "$@"
