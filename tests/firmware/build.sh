#!/usr/bin/env bash
# Builds a sketch with Debian's Arduino core, as the Arduino IDE would for that board.
#
# usage: bash tests/firmware/build.sh SKETCH.cpp BOARD OUT.elf     BOARD: uno mega leonardo mighty
set -euo pipefail

readonly arduino=/usr/share/arduino/hardware/arduino/avr
readonly mighty=/usr/share/arduino/hardware/mighty-1284p/variants/standard
sketch=$1 board=$2 out=$3

fail() {
    echo "tests/firmware: $1" >&2
    exit 1
}
command -v avr-g++ >/dev/null || fail "no avr-g++: apt install gcc-avr avr-libc"
[[ -f $arduino/cores/arduino/Arduino.h ]] || fail "no core: apt install arduino-core-avr"

variant=$arduino/variants
case $board in
uno) mcu=atmega328p name=UNO variant+=/standard ;;
mega) mcu=atmega2560 name=MEGA2560 variant+=/mega ;;
leonardo) mcu=atmega32u4 name=LEONARDO variant+=/leonardo ;;
mighty) mcu=atmega1284p name=MIGHTY variant=$mighty ;;
*) fail "unknown board $board, expected uno, mega, leonardo or mighty" ;;
esac
[[ -d $variant ]] || fail "no $variant: apt install arduino-mighty-1284p"

# The compiler of 2015 lacks DECIMAL_DIG, which the core asks for.
flags=(-mmcu=$mcu -DF_CPU=16000000L -DARDUINO=10819 "-DARDUINO_AVR_$name" -DARDUINO_ARCH_AVR
    -DDECIMAL_DIG=9 -DUSB_VID=0x2341 -DUSB_PID=0x8036 -Os -w -ffunction-sections -fdata-sections
    -I"$arduino/cores/arduino" -I"$variant" -I"$(dirname "$sketch")")
for library in EEPROM SPI SoftwareSerial Wire; do
    flags+=(-I"$arduino/libraries/$library/src")
done
libraries=("$arduino"/libraries/{SPI/src/SPI,SoftwareSerial/src/SoftwareSerial,Wire/src/Wire}.cpp
    "$arduino"/libraries/Wire/src/utility/twi.c)

compile() {
    case $1 in
    *.c) avr-gcc "${flags[@]}" -std=gnu11 -c "$1" -o "$2" ;;
    *.S) avr-gcc "${flags[@]}" -x assembler-with-cpp -c "$1" -o "$2" ;;
    *) avr-g++ "${flags[@]}" -std=gnu++11 -fpermissive -fno-exceptions -fno-threadsafe-statics \
        -x c++ -c "$1" -o "$2" ;;
    esac
}

# The core is compiled once a board.
core=$(dirname "$out")/core-$board
mkdir -p "$core"
objects=()
for source in "$arduino"/cores/arduino/*.{c,cpp,S} "${libraries[@]}"; do
    object=$core/$(basename "$source").o
    [[ $object -nt $source ]] || compile "$source" "$object"
    objects+=("$object")
done
# Of an archive, the linker takes what the sketch uses.
archive=$core/core.a
rm -f "$archive"
avr-ar rcs "$archive" "${objects[@]}"
compile "$sketch" "${out%.elf}.o"
avr-gcc -mmcu=$mcu -Os -Wl,--gc-sections "${out%.elf}.o" "$archive" -lm -o "$out"
