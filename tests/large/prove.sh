#!/usr/bin/env bash
# Proves that the large build maps a floor of 28 m: every wall, all rows at the PC, all waypoints.
# By hand: it compiles the whole command anew, four minutes on two cores.
#
# usage: tests/large/prove.sh [SEED..]      (1 to 5 if none are given)
set -euo pipefail
cd "$(dirname "$0")/../.."
target=${CARGO_TARGET_DIR:-target}/large
cargo build --quiet --locked --release --features large --target-dir "$target"
[[ $# -gt 0 ]] || set -- 1 2 3 4 5
status=0
for seed; do
    "$target/release/hilrig" run tests/large/floor.toml --seed "$seed" --out "$target/floor-$seed" ||
        status=1
done
exit "$status"
