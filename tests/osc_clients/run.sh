#!/usr/bin/env bash
# The model car driven over UDP by clients of others: python-osc, and oscsend of liblo.
#
# usage: tests/osc_clients/run.sh
#
# HILRIG may name the program where it is built already. Needs oscsend (Debian: liblo-tools). Takes
# some ten seconds, as a car has to drive.
set -euo pipefail
cd "$(dirname "$0")"
target=$(realpath -m "${CARGO_TARGET_DIR:-../../target}")
export CARGO_TARGET_DIR=$target PYTHONDONTWRITEBYTECODE=1

fail() {
    echo "tests/osc_clients: $1: nothing was judged" >&2
    exit 1
}
command -v oscsend >/dev/null || fail "no oscsend (Debian: liblo-tools)"
tools=$target/osc-clients
# Anew if another version is asked for.
cmp -s requirements.txt "$tools/installed.txt" || {
    python3 -m venv "$tools" || fail "no venv can be made (Debian: python3-venv)"
    "$tools/bin/pip" install -q -r requirements.txt || fail "pip cannot install requirements.txt"
    cp requirements.txt "$tools/installed.txt"
}
[[ -n ${HILRIG:-} ]] ||
    cargo build --locked --quiet --manifest-path ../../Cargo.toml --bin hilrig
HILRIG=${HILRIG:-$target/debug/hilrig} "$tools/bin/python" drive.py
