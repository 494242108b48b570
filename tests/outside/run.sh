#!/usr/bin/env bash
# Tests a robot in a crate of its own, which has nothing but a dependency on hilrig: every item that
# a user needs must be reachable from there.
#
# usage: tests/outside/run.sh
set -euo pipefail
cd "$(dirname "$0")"
# The same folder as the workspace, so that third parties' crates are compiled once.
CARGO_TARGET_DIR=$(realpath -m "${CARGO_TARGET_DIR:-../../target}")
export CARGO_TARGET_DIR
cargo test --locked --quiet
# A crate that tests its driver compiles no more than this; the package itself is none of them.
crates=$(cargo tree --locked --manifest-path ../../Cargo.toml -p hilrig --no-default-features \
    --edges normal,build --prefix none --format '{p}' | sed 's/ (.*//' | sort -u | wc -l)
if ((crates > 44)); then
    echo "tests/outside: hilrig without features is $crates crates, at most 44 are wanted" >&2
    exit 1
fi
# Drivers of the registry, in a crate that has hilrig without its command.
cd drivers
cargo test --locked --quiet
# The docs' examples, as a reader compiles them; one reads a file of the repository.
for example in judged_program own_device own_robot; do
    cargo run --locked --quiet --example "$example" >/dev/null
done
(cd ../../.. && "$CARGO_TARGET_DIR/debug/examples/connect" >/dev/null)
