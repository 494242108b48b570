#!/usr/bin/env bash
# Tests the package for Python, the programs of the docs with it: pytest, in a venv of its own.
#
# usage: python/run.sh
#
# HILRIG may name the program where it is built already. The wheel is not built here: that takes as
# long as the program itself.
set -euo pipefail
cd "$(dirname "$0")"
target=$(realpath -m "${CARGO_TARGET_DIR:-../target}")
export PYTHONDONTWRITEBYTECODE=1

tools=$target/python
# Anew if another version is asked for.
cmp -s requirements.txt "$tools/installed.txt" || {
    python3 -m venv "$tools"
    "$tools/bin/pip" install -q -r requirements.txt
    cp requirements.txt "$tools/installed.txt"
}
[[ -n ${HILRIG:-} ]] ||
    cargo build --locked --quiet --manifest-path ../Cargo.toml --bin hilrig
export HILRIG=${HILRIG:-$target/debug/hilrig} PYTHONPATH=$PWD/src PATH=$tools/bin:$PATH
# Most of the time of these tests is waiting for rigs in real time.
python -m pytest -q -p no:cacheprovider -n 4 tests
