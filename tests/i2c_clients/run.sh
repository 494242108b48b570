#!/usr/bin/env bash
# Judges both chips on I2C by their data sheets: a client in Python has the calls of the library
# smbus2 and sends the documented frames. A sketch on a simulated board reads both in
# tests/firmware/run.sh.
#
# usage: bash tests/i2c_clients/run.sh      HILRIG: the command; built if not given
set -euo pipefail
cd "$(dirname "$0")"
target=$(realpath -m "${CARGO_TARGET_DIR:-../../target}")
[[ -n ${HILRIG:-} ]] || {
    cargo build --locked --quiet --manifest-path ../../Cargo.toml --bin hilrig
    HILRIG=$target/debug/hilrig
}
folder=$(mktemp -d)
"$HILRIG" up bench.toml --dir "$folder/ports" >"$folder/log" 2>&1 &
rig=$!
trap 'kill $rig 2>/dev/null; wait $rig 2>/dev/null || true; rm -rf "$folder"' EXIT
for _ in $(seq 100); do
    grep -q "running until" "$folder/log" && break
    kill -0 $rig 2>/dev/null || { cat "$folder/log" >&2 && exit 1; }
    sleep 0.1
done
PYTHONDONTWRITEBYTECODE=1 python3 chips.py "$folder/ports"
