#!/usr/bin/env bash
# Judges the emulated AVR base by the fielded firmware itself, both builds of it, in simavr: random
# sequences of requests, and whether chip and emulation send the same bytes.
#
# usage: bash tests/avr_base/run.sh [SEQUENCES [SEED]]
#        2,600 sequences if not given; of build 5f54f4d an eighth
#
# The firmware is public (GitHub: janblumenkamp/rcj2015_base) and no part of this repository. It is
# cloned, or taken from the repository that RCJ2015_BASE names. HILRIG_SHOW=KIND prints sequences
# that differ. Where it does not pass, FIDELITY.md says why.
# Needs gcc-avr, avr-libc, libsimavr-dev, libelf-dev, gcc and git.
set -euo pipefail
cd "$(dirname "$0")/../.."
out=$(realpath -m "${CARGO_TARGET_DIR:-target}")/avr-base

fail() {
    echo "tests/avr_base: $1: nothing was judged" >&2
    exit 1
}
command -v avr-gcc >/dev/null || fail "no avr-gcc (Debian: gcc-avr, avr-libc)"
[[ -f /usr/include/simavr/sim_avr.h ]] || fail "no simavr (Debian: libsimavr-dev)"

mkdir -p "$out"
source=${RCJ2015_BASE:-$out/source}
remote=https://github.com/janblumenkamp/rcj2015_base
[[ -d $source ]] || git clone -q --bare "$remote" "$source" ||
    fail "the firmware cannot be cloned; RCJ2015_BASE may name a copy"

# The options of the firmware's own Makefile.
flags=(-DF_CPU=16000000 -mmcu=atmega2560 -g -Os -w -funsigned-char -funsigned-bitfields
    -fpack-struct -fshort-enums -ffunction-sections -fdata-sections -Wl,--gc-sections
    -Wl,--relax -mcall-prologues -std=gnu99)
for build in b77a6df 5f54f4d; do
    [[ -f $out/$build.elf ]] && continue
    mkdir -p "$out/$build"
    git -C "$source" archive "$build" | tar x -C "$out/$build"
    (cd "$out/$build" && avr-gcc "${flags[@]}" -I. -Isys ./*.c sys/*.c -lm -o "$out/$build.elf")
done
gcc -O2 -Wall -Wextra -I/usr/include/simavr tests/avr_base/chip.c -o "$out/chip" -lsimavr -lelf -lm

# A filter without a match passes with no test run: that is no success.
HILRIG_AVR_BASE=$out HILRIG_SEQUENCES=${1:-2600} HILRIG_SEED=${2:-49} \
    cargo test --locked -p hilrig-emulators --test simavr random_sequences -- --nocapture |
    tee "$out/judged.log"
grep -q "test result: ok. 1 passed" "$out/judged.log"
