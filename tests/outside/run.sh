#!/usr/bin/env bash
# Tests a robot in a crate of its own, which has nothing but a dependency on hilrig: every item that
# a user needs must be reachable from there.
#
# usage: tests/outside/run.sh
set -euo pipefail
cd "$(dirname "$0")"
# The same folder as the workspace, so that third parties' crates are compiled once.
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-../../target}"
cargo test --locked --quiet
