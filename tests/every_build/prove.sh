#!/usr/bin/env bash
# Proves that the mapper finds the same poses and draws the same maps in every build: debug and
# release, with the forms of its inner loops for x86-64 and with those that a Cortex-M4 gets. The
# optimised build with those for x86-64 is the one that "cargo test" asks itself.
#
# usage: tests/every_build/prove.sh
set -euo pipefail
cd "$(dirname "$0")"
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-../../target}/every_build"

expected=$(grep -o '0x[0-9a-f_]*' ../../firmware_core/tests/mapping/same.rs | head -1 | tr -d x_)
for build in "" "--features portable" "--release --features portable"; do
    # shellcheck disable=SC2086
    print=$(cargo run --quiet --locked $build)
    printf '%-30s %s\n' "${build:---}" "$print"
    [[ $print == "${expected#0}" ]] || {
        echo "every build: expected ${expected#0}, as firmware_core/tests/mapping/same.rs has it" >&2
        exit 1
    }
done
