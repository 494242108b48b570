#!/usr/bin/env bash
# Emulated chips judged by a microcontroller that is simulated by others: sketches, built with the
# Arduino's own core, run in simavr, on a bus and pins behind which our models are.
#
# usage: bash tests/simavr/run.sh
#
# Needs gcc-avr, avr-libc, arduino-core-avr, libsimavr-dev, libelf-dev and gcc. Takes some seconds
# beside the compilation of the test.
set -euo pipefail
cd "$(dirname "$0")/../.."

readonly arduino=/usr/share/arduino/hardware/arduino/avr
readonly sources=$PWD/tests/simavr
out=$(realpath -m "${CARGO_TARGET_DIR:-target}")/simavr

fail() {
    echo "tests/simavr: $1: nothing was judged" >&2
    exit 1
}
command -v avr-g++ >/dev/null || fail "no avr-g++ (Debian: gcc-avr)"
[[ -f $arduino/cores/arduino/Arduino.h ]] || fail "no core (Debian: arduino-core-avr)"
[[ -f /usr/include/simavr/sim_avr.h ]] || fail "no simavr (Debian: libsimavr-dev)"

# The core is compiled once. Its compiler of 2015 lacks DECIMAL_DIG, which the core asks for.
mkdir -p "$out/core"
flags=(-mmcu=atmega2560 -DF_CPU=16000000L -DARDUINO=10819 -DARDUINO_AVR_MEGA2560
    -DARDUINO_ARCH_AVR -DDECIMAL_DIG=9 -Os -w -ffunction-sections -fdata-sections
    -I"$arduino/cores/arduino" -I"$arduino/variants/mega" -I"$arduino/libraries/Wire/src")
core=("$arduino"/cores/arduino/{abi,HardwareSerial,HardwareSerial0,main,new,Print,Stream,WString}.cpp
    "$arduino"/cores/arduino/{hooks,WInterrupts,wiring,wiring_digital}.c
    "$arduino"/libraries/Wire/src/Wire.cpp "$arduino"/libraries/Wire/src/utility/twi.c)
compile() {
    case $1 in
    *.cpp) avr-g++ "${flags[@]}" -std=gnu++11 -fno-exceptions -fno-threadsafe-statics -c "$1" -o "$2" ;;
    *) avr-gcc "${flags[@]}" -std=gnu11 -c "$1" -o "$2" ;;
    esac
}
objects=()
for source in "${core[@]}"; do
    object=$out/core/$(basename "$source").o
    [[ $object -nt $source ]] || compile "$source" "$object"
    objects+=("$object")
done
for sketch in odometer ranger; do
    compile "$sources/$sketch.cpp" "$out/$sketch.o"
    avr-g++ -mmcu=atmega2560 -Os -Wl,--gc-sections "$out/$sketch.o" "${objects[@]}" -lm \
        -o "$out/$sketch.elf"
done
gcc -O2 -Wall -Wextra -I/usr/include/simavr "$sources/harness.c" -o "$out/harness" \
    -lsimavr -lelf -lm

# With the whole workspace, as which it was built before: alone, other features mean another build.
HILRIG_SIMAVR=$out cargo test --locked --workspace --test simavr
