#!/usr/bin/env bash
# Firmware without a board: sketches, built with the Arduino's own core, run unmodified in simavr
# against the rig's devices and chips, and as a device.
#
# usage: bash tests/firmware/run.sh [--bench]      HILRIG: the command; built if not given
#
# Installs what it needs: gcc-avr, avr-libc, arduino-core-avr, arduino-mighty-1284p, libsimavr-dev,
# libelf-dev.
set -euo pipefail
cd "$(dirname "$0")/../.."

here=$PWD/tests/firmware
out=$(realpath -m "${CARGO_TARGET_DIR:-target}")/firmware
hilrig=${HILRIG:-}

missing=()
command -v avr-g++ >/dev/null || missing+=(gcc-avr avr-libc)
[[ -f /usr/share/arduino/hardware/arduino/avr/cores/arduino/Arduino.h ]] ||
    missing+=(arduino-core-avr)
[[ -d /usr/share/arduino/hardware/mighty-1284p ]] || missing+=(arduino-mighty-1284p)
[[ -f /usr/include/simavr/sim_avr.h ]] || missing+=(libsimavr-dev)
[[ -f /usr/include/libelf.h ]] || missing+=(libelf-dev)
if [[ ${#missing[@]} -gt 0 ]]; then
    as_root=()
    [[ $EUID -eq 0 ]] || as_root=(sudo)
    "${as_root[@]}" apt-get update -qq
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -qq -y --no-install-recommends "${missing[@]}" >/dev/null
fi
if [[ -z $hilrig ]]; then
    cargo build --locked --release
    hilrig=$(realpath -m "${CARGO_TARGET_DIR:-target}")/release/hilrig
fi

fail() {
    echo "tests/firmware: $1" >&2
    exit 1
}

mkdir -p "$out"
make -s -C nodes/simavr OUT="$out"
export HILRIG_SIMAVR_NODE=$out/hilrig-simavr
build() { [[ $out/$2 -nt $1 && $out/$2 -nt $here/build.sh ]] || bash "$here/build.sh" "$1" "$3" "$out/$2"; }
for board in uno mega mighty; do
    build "$here/sketches/probe.cpp" "probe-$board.elf" "$board"
done
# The Leonardo's Serial is USB, which is not simulated.
sed 's/Serial\b/Serial1/g' "$here/sketches/probe.cpp" >"$out/probe1.cpp"
build "$out/probe1.cpp" probe1-leonardo.elf leonardo
sketches=(station base tfmini lx16a mh_z19 pms5003 mt_sics level polled sleeps)
for sketch in "${sketches[@]}"; do
    build "$here/sketches/$sketch.cpp" "$sketch.elf" mega
    case $sketch in
    level | sleeps) cp "$here/mt_sics.toml" "$out/$sketch.toml" ;;
    polled) cp "$here/station.toml" "$out/polled.toml" ;;
    *) cp "$here/$sketch.toml" "$out/" ;;
    esac
done

echo "== the node program by itself"
python3 "$here/test_node.py" "$HILRIG_SIMAVR_NODE" "$out" boards

# run SKETCH OUT WIRES..: a sketch as the program under test.
run() {
    local sketch=$1 folder=$2
    shift 2
    "$hilrig" run "$out/$sketch.toml" --firmware "$out/$sketch.elf" --board arduino-mega \
        "${@/#/--wire=}" "${options[@]}" --out "$folder"
}
options=()
# says FOLDER PATTERN COUNT: the sketch said so at least that often on its console.
says() {
    local found
    found=$(grep -cE "serial: $2" "$1/node-program.log" || true)
    [[ $found -ge $3 ]] || fail "$1: \"$2\" $found times, expected $3 at least"
}

echo "== our sketch: two UARTs, I2C, EEPROM, watchdog, 60 s, twice the same bytes"
options=(--firmware-may-reset)
for turn in 1 2; do
    run station "$out/station-$turn" ranger=i2c imu=i2c scale=serial1 pc=serial2
    hashes[turn]=$(grep -o '"[a-z_]*\(hash\|fingerprint\)": *"[^"]*"' "$out/station-$turn/result.json")
done
[[ -n ${hashes[1]} && ${hashes[1]} == "${hashes[2]}" ]] || fail "two runs differ: ${hashes[*]}"
options=()
says "$out/station-1" "start=1" 1
says "$out/station-1" "start=2" 1
says "$out/station-1" "cause=8" 1
says "$out/station-1" "chip=104" 40
says "$out/station-1" "cg=10025" 40

echo "== sketches for serial devices"
run tfmini "$out/tfmini" it=serial1
says "$out/tfmini" "cm 1[0-4][0-9] strength 900" 15
run lx16a "$out/lx16a" it=serial1
says "$out/lx16a" "to (300 at 300|700 at 700) mv 7412" 8
run mh_z19 "$out/mh_z19" it=serial1
says "$out/mh_z19" "ppm 6[0-9][0-9]" 4
run pms5003 "$out/pms5003" it=serial1
says "$out/pms5003" "pm2.5 1[0-9]" 8
run mt_sics "$out/mt_sics" it=serial1
says "$out/mt_sics" "stable 100.25" 8

echo "== an interrupt at low level"
run level "$out/level" it=serial1
says "$out/level" "runs=(50|100|500)\r?$" 3

# START, SLA+W, data, repeated START and SLA+R acknowledged, data not; WHO_AM_I. 1.1 of 5 V are 225
# of 1024. The flag is clear, set by an edge, and clear.
echo "== flags that a program polls"
options=(--firmware-may-idle)
run polled "$out/polled" ranger=i2c imu=i2c scale=serial1 pc=serial2
options=()
says "$out/polled" "bus 8 24 40 16 64 88 104" 10
says "$out/polled" "analog 225 0 225 0" 10
says "$out/polled" "flags 0 16 0" 10

echo "== firmware that is not seen to work"
# fails OPTIONS.. WORDS: a sketch of which the check says WORDS.
fails() {
    local status=0 words=${*: -1}
    "$hilrig" run "${@:1:$#-1}" --board arduino-mega --out "$out/fails" >"$out/fails.txt" 2>&1 || status=$?
    [[ $status -eq 1 ]] && grep -q "FAIL program-goes-on .*$words" "$out/fails.txt" ||
        fail "exit code $status, expected \"$words\": $(<"$out/fails.txt")"
}
sed 's/^duration = .*/duration = "25s"/' "$out/station.toml" >"$out/hangs.toml"
fails "$out/hangs.toml" --firmware "$out/station.elf" --wire={ranger=i2c,imu=i2c,scale=serial1,pc=serial2} \
    "watchdog reset it once, at 22"
# The device is at a port that the sketch does not use.
fails "$out/mt_sics.toml" --firmware "$out/mt_sics.elf" --wire=it=serial2 "sends only at its start"
fails "$out/tfmini.toml" --firmware "$out/tfmini.elf" --wire=it=serial2 "to serial2, which the firmware does not use"
# The sketch asks at 9600 baud.
printf '%s\n' 'schema = 1' 'name = "rate"' 'robot = "none"' 'duration = "5s"' '[device.it.text]' \
    'baud = 19200' 'command = [{ request = "SI", reply = "S S 100.25 g" }]' >"$out/other_rate.toml"
fails "$out/other_rate.toml" --firmware "$out/mt_sics.elf" --wire=it=serial1 "both sides read garbage"


# Data sheet of the ATmega2560: 3.4 ms to erase and write, 1.8 ms for one of them; the clock of
# Timer 1 stands in power-down.
echo "== the time of the EEPROM, and sleep"
fails "$out/sleeps.toml" --firmware "$out/sleeps.elf" --wire=it=serial1 "timer . cannot wake the chip from power-down"
says "$out/fails" "written us=34[0-2][0-9]" 1
says "$out/fails" "written us=18[0-2][0-9]" 2
says "$out/fails" "idle: ticked" 1
says "$out/fails" "power-down: barked" 1
! grep -q "power-down: ticked" "$out/fails/node-program.log" || fail "Timer 1 woke the chip"

echo "== from Python"
PYTHONPATH=$PWD/python/src HILRIG=$hilrig python3 - "$out" <<'PYTHON'
import pathlib, sys, hilrig

out = pathlib.Path(sys.argv[1])
wires = {"it": "serial1"}
result = hilrig.firmware(out / "mh_z19.toml", out / "mh_z19.elf", "arduino-mega", wires=wires, out=out / "python")
result.assert_passed()
assert (result.folder / "node-program.log").read_text().count("ppm 6") >= 4
PYTHON

echo "== an AVR program as the base of the robot rescue"
"$hilrig" run "$out/base.toml" --out "$out/base"

if [[ ${1:-} == --bench ]]; then
    echo "== speed"
    python3 "$here/bench.py" "$HILRIG_SIMAVR_NODE" "$out" boards
fi
echo "tests/firmware: all passed"
