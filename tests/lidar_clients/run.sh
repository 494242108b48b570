#!/usr/bin/env bash
# Judges the emulated RPLIDAR by clients of others, and messages of the telemetry link by the
# library of protocol buffers: what pip and cargo give, nothing of ours.
#
# usage: tests/lidar_clients/run.sh [SECONDS]    of scan a client, 6 if not given
#
# HILRIG and TELEMETRY may name the program and the example of `protocols` where they are built
# already.
set -euo pipefail
cd "$(dirname "$0")"
# The same folder as the workspace, so that third parties' crates are compiled once.
target=$(realpath -m "${CARGO_TARGET_DIR:-../../target}")
export CARGO_TARGET_DIR=$target
seconds=${1:-6}
export PYTHONDONTWRITEBYTECODE=1

fail() {
    echo "tests/lidar_clients: $1: nothing was judged" >&2
    exit 1
}

tools=$target/lidar-clients
# Anew if another version is asked for.
cmp -s requirements.txt "$tools/installed.txt" || {
    python3 -m venv "$tools" || fail "no venv can be made (Debian: python3-venv)"
    "$tools/bin/pip" install -q -r requirements.txt || fail "pip cannot install requirements.txt"
    cp requirements.txt "$tools/installed.txt"
}
cargo build --locked --quiet --manifest-path rust/Cargo.toml ||
    fail "cargo cannot build the client of rplidar_drv_rs"
[[ -n ${HILRIG:-} ]] ||
    cargo build --locked --quiet --manifest-path ../../Cargo.toml --bin hilrig
[[ -n ${TELEMETRY:-} ]] ||
    cargo build --locked --quiet --manifest-path ../../Cargo.toml -p hilrig-protocols \
        --example telemetry

export HILRIG=${HILRIG:-$target/debug/hilrig} LIDAR_CLIENT_RS=$target/debug/lidar-client
export TELEMETRY=${TELEMETRY:-$target/debug/examples/telemetry}
"$tools/bin/python" telemetry.py
"$tools/bin/python" judge.py "$seconds"
"$tools/bin/python" bugs.py --quick
