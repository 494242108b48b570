#!/usr/bin/env bash
# Proves that the world's rays hit what parry2d says they hit.
#
# usage: tests/ray_oracle/prove.sh
set -euo pipefail
cd "$(dirname "$0")"
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-../../target}/ray_oracle"
cargo test --quiet --locked
