#!/usr/bin/env bash
# Judges the described devices of `devices` by public drivers, as pip gives them, in virtual time.
#
# usage: tests/devices/run.sh [--all] [--write] [NAME..]
#
#   (nothing)   each driver reads its device
#   NAME..      these drivers or devices, also with damage, losses and silence
#   --all       all of them so, a fuzz run for each, the table of docs/devices.md, the trophies,
#               gpsd, and three devices by other means
#   --write     makes the table anew
#
# HILRIG names the program where it is built already.
set -euo pipefail
cd "$(dirname "$0")"
target=$(realpath -m "${CARGO_TARGET_DIR:-../../target}")
export PYTHONDONTWRITEBYTECODE=1
tools=$target/device-drivers
# Anew if another version is asked for.
cmp -s <(cat requirements.txt alone.txt) "$tools/installed.txt" || {
    rm -rf "$tools"
    python3 -m venv "$tools"
    "$tools/bin/pip" install -q -r requirements.txt
    "$tools/bin/pip" install -q --no-deps -r alone.txt
    cat requirements.txt alone.txt >"$tools/installed.txt"
}
export HILRIG=${HILRIG:-$target/debug/hilrig}
"$tools/bin/python" judge.py "$@"
if [[ ${1:-} == --all ]]; then
    "$tools/bin/python" trophies.py
    bash gpsd.sh
    bash side_by_side/run.sh "$tools/bin/python"
fi
