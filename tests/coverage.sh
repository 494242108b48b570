#!/usr/bin/env bash
# How much of the decoders the committed corpus reaches, and the floor that it must not fall below.
#
# usage: bash tests/coverage.sh
#
# Needs llvm-19, whose tools read what rustc 1.95 writes. Takes some ten seconds.
set -euo pipefail
cd "$(dirname "$0")/.."

# Lines of the wire formats' decoders, per cent. Raise it when the corpus grows.
readonly floor=87

out=${CARGO_TARGET_DIR:-$PWD/target}/coverage
mkdir -p "$out"
rm -f "$out"/*.profraw
(
    cd fuzz
    # An incremental build counts fewer of the lines that nothing calls.
    CARGO_INCREMENTAL=0 CARGO_TARGET_DIR=$out RUSTFLAGS="-Cinstrument-coverage" LLVM_PROFILE_FILE=$out/%p.profraw \
        cargo build --locked --quiet --no-default-features --features robots --bin corpus
)
LLVM_PROFILE_FILE=$out/replay-%p.profraw "$out/debug/corpus" replay tests/corpus
llvm-profdata-19 merge -sparse "$out"/replay-*.profraw -o "$out/replay.profdata"
sources=protocols/src
llvm-cov-19 export --format=text --summary-only --instr-profile="$out/replay.profdata" \
    "$out/debug/corpus" $sources/{decode,avr,xv11,pcui,panel,telemetry,peripherals,rle,hc06}.rs \
    $sources/xv11/{reading,turn}.rs $sources/pcui/message.rs $sources/hc06/lines.rs \
    $sources/rplidar/{answer,capsule,decoder,node,request}.rs $sources/telemetry/decoder.rs \
    $sources/car_board/{command,frame}.rs $sources/odometer/reading.rs $sources/perception.rs \
    > "$out/summary.json"
percent=$(sed -n 's/.*"totals":{.*"lines":{"count":[0-9]*,"covered":[0-9]*,"percent":\([0-9]*\).*/\1/p' \
    "$out/summary.json")
echo "the corpus reaches $percent % of the decoders' lines, floor $floor %"
[[ $percent -ge $floor ]]
