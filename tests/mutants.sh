#!/usr/bin/env bash
# How many changes of behaviour do the tests see? Random mutants as cargo-mutants lists them, all
# compiled in at once behind a switch (tests/mutants), each tried by those of the package's own
# tests that come by its place; the score is the share of viable ones that a test caught.
#
# usage: tests/mutants.sh PACKAGE [COUNT [SEED [FILE..]]]
#
#   tests/mutants.sh hilrig-protocols                       all of it
#   tests/mutants.sh hilrig-emulators 100 7                 100 mutants drawn by seed 7
#   tests/mutants.sh hilrig-firmware 50 1 'firmware_core/src/navigation/**'
#   tests/mutants.sh hilrig-engine 300 1 'crates/engine/src/rig/**' 'crates/engine/src/run/**'
#
# No part of the usual test run: it takes from minutes to hours. Survivors are in
# target/mutants/missed.txt; those that are equivalent stand in tests/mutants.txt with their reason,
# one line each as there, and are left out. Mutants of constants cannot be switched: they stand in
# target/mutants/unswitched.txt, `cargo mutants --re NAME` judges one. Two runs at a time need two
# folders: OUT=target/other. What some of its tests see, a quick look: TESTS='--lib'. Tests of other
# packages that use this one count with WITH='hilrig-realtime hilrig:rig': unit tests of the first,
# tests/rig of the second. REACH=1 names those that no test comes by, without a trial.
set -euo pipefail
cd "$(dirname "$0")/.."
[[ $# -ge 1 && $1 != -* ]] || { sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "$0" >&2; exit 2; }
package=$1 count=${2:-0} seed=${3:-1}
shift $(($# < 3 ? $# : 3))

command -v cargo-mutants >/dev/null || cargo install --locked cargo-mutants --version '^27' >&2
out=${OUT:-target/mutants}
mkdir -p "$out"
files=()
for file in "$@"; do files+=(--file "$file"); done
cargo mutants --list --json --package "$package" "${files[@]}" --colors never >"$out/list.json"
CARGO_TARGET_DIR=target/mutants/tool cargo run --quiet --release --locked \
    --manifest-path tests/mutants/Cargo.toml -- \
    "$package" "$out/list.json" "$out" "$count" "$seed" tests/mutants.txt
