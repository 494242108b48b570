#!/usr/bin/env bash
# Runs each bridge of the package for Python with a real reader: Foxglove's protocol and MCAP
# reader, Debian's rospy, Cyclone DDS.
#
# usage: bash tests/bridges/run.sh [foxglove] [ros1] [ros2]
#
# HILRIG may name the program where it is built already.
set -euo pipefail
cd "$(dirname "$0")"
target=$(realpath -m "${CARGO_TARGET_DIR:-../../target}")
tools=$target/bridges
cmp -s requirements.txt "$tools/installed.txt" || {
    python3 -m venv "$tools"
    "$tools/bin/pip" install -q -r requirements.txt
    cp requirements.txt "$tools/installed.txt"
}
export HILRIG=${HILRIG:-$target/debug/hilrig} PYTHONDONTWRITEBYTECODE=1
"$tools/bin/python" prove.py "$@"
