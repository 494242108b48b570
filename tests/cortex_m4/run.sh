#!/usr/bin/env bash
# The robots' own programs on a Cortex-M4 in QEMU: the board layer by itself, then a whole mission
# each of rescue and of yellow, byte for byte that of the program compiled for the host. Then
# unmodified UART firmware on two machines in real time, as a smoke test.
#
# usage: bash tests/cortex_m4/run.sh [--bench]      HILRIG: the command; built if not given
#
# Installs what it needs: qemu-system-arm, gcc-arm-none-eabi, and the target thumbv7em-none-eabihf
# by rustup.
set -euo pipefail
cd "$(dirname "$0")/../.."

target=thumbv7em-none-eabihf
folder=$(realpath -m "${CARGO_TARGET_DIR:-target}")
out=$folder/cortex_m4
hilrig=${HILRIG:-}
here=tests/cortex_m4

say() { printf '== cortex-m4: %s\n' "$*"; }
die() {
    printf 'tests/cortex_m4: %s\n' "$*" >&2
    exit 1
}

mkdir -p "$out"
missing=()
command -v qemu-system-arm >/dev/null || missing+=(qemu-system-arm)
command -v arm-none-eabi-gcc >/dev/null || missing+=(gcc-arm-none-eabi)
if [[ ${#missing[@]} -gt 0 ]]; then
    as_root=()
    [[ $EUID -eq 0 ]] || as_root=(sudo)
    "${as_root[@]}" apt-get update -qq
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -qq -y --no-install-recommends "${missing[@]}" >/dev/null
fi
if [[ -z $hilrig ]]; then
    cargo build --locked --release
    hilrig=$folder/release/hilrig
fi

say "the firmware"
# shellcheck source=../bare_metal/toolchain.sh
source tests/bare_metal/toolchain.sh
(
    cd nodes/cortex-m4
    export CARGO_TARGET_DIR=$folder/cortex-m4
    cargo fmt --check
    [[ ${#build_std[@]} -eq 0 ]] || toolchain+=(RUSTC_BOOTSTRAP=1)
    "${toolchain[@]}" cargo build --quiet --locked --release --target $target "${build_std[@]}"
)
elf=$folder/cortex-m4/$target/release

say "without QEMU the command names the package"
status=0
PATH=/nowhere "$hilrig" run scenarios/yellow-reactive.toml --firmware "$elf/yellow" \
    --board cortex-m4 2>"$out/missing" || status=$?
[[ $status -eq 2 ]] && grep -q 'apt install qemu-system-arm' "$out/missing" ||
    die "exit code $status: $(<"$out/missing")"

say "words that do not fit the firmware end it"
# refused WORDS EXPECTED
refused() {
    local status=0
    qemu-system-arm -M mps2-an386 -kernel "$elf/yellow" -display none -monitor none -serial none \
        -nic none -icount shift=2,sleep=off -semihosting-config \
        "enable=on,target=native,arg=firmware$1" </dev/null >"$out/refused" 2>&1 || status=$?
    [[ $status -eq 2 ]] && grep -q "$2" "$out/refused" || die "$1: exit code $status: $(<"$out/refused")"
}
refused ,arg=defaults=7 'of other defaults or another version'
refused ,arg=map=7 "expected that of this firmware"
refused ,arg=port=lidar:1,arg=port=lidar:1 'two ports of the rig'

say "the board layer by itself"
python3 $here/test_echo.py "$elf/echo" tests/firmware
"$hilrig" node check "exec qemu-system-arm -M mps2-an386 -kernel '$elf/echo' -display none \
    -monitor none -serial none -nic none -icount shift=2,sleep=off -semihosting-config \
    enable=on,target=native,arg=firmware,arg=port=uart:1" --send abc

hash_of() { grep -o '"trace_hash": *"[^"]*"' "$1/result.json"; }

# both NAME SCENARIO VERDICT: the program in the rig's process, and on the board. VERDICT is the
# exit code of both.
both() {
    local name=$1 scenario=$2 native=$out/$1-native board=$out/$1-board status=0
    "$hilrig" run "$scenario" --out "$native" >/dev/null 2>&1 || status=$?
    [[ $status -eq $3 ]] || die "$name: exit code $status of the native run"
    status=0
    "$hilrig" run "$scenario" --firmware "$elf/$name" --board cortex-m4 --out "$board" \
        >"$out/$name.txt" 2>&1 || status=$?
    tail -n 20 "$out/$name.txt"
    [[ $status -eq $3 ]] || die "$name: exit code $status of the run on the board"
    [[ -n $(hash_of "$native") && $(hash_of "$native") == "$(hash_of "$board")" ]] ||
        die "$name: $(hash_of "$native") natively, $(hash_of "$board") on the board"
    python3 $here/same.py "$native/capture.pcapng" "$board/capture.pcapng"
    grep '^load' "$board/node-program.log" || die "$name: its load was not reported"
}

say "rescue: a whole mission, byte for byte"
# What the radio says of the heading is judged on the board: the time of each pose is not in it.
sed '/^heading_rms_deg_max/d' scenarios/rescue-flat.toml >"$out/rescue.toml"
both rescue "$out/rescue.toml" 0
say "rescue: 14 s with breaks, an unplugged lidar, a wrong rate, an overrun and flipped bits"
sed '/^heading_rms_deg_max/d; s/^duration = .*/duration = "14s"/' scenarios/rescue-flat.toml |
    cat - $here/faults.toml >"$out/faults.toml"
both rescue "$out/faults.toml" 1
say "rescue: 4 s without orders, which the scripted PC hears alike"
sed '/^waypoints_m/,/^\]/d; /^\[expect\]/,/^$/d
    s/^duration = .*/duration = "4s"\nprogram.start_mode = "explore"/' scenarios/rescue-flat.toml \
    >"$out/orders.toml"
both rescue "$out/orders.toml" 0
say "yellow: a whole mission, byte for byte"
both yellow scenarios/yellow-reactive.toml 0

say "QEMU ends with hilrig, even while it waits for gdb"
"$hilrig" run scenarios/yellow-reactive.toml --firmware "$elf/yellow" --board cortex-m4 --gdb 47133 \
    --out "$out/killed" >/dev/null 2>&1 &
started=$!
is_there() { pgrep -f 'tcp::47133 -S' >/dev/null; }
for _ in {1..100}; do is_there && break || sleep 0.1; done
is_there || die "QEMU never waited for gdb"
kill -KILL $started
wait $started 2>/dev/null || true
for _ in {1..100}; do is_there || break; sleep 0.1; done
! is_there || die "QEMU stayed behind"

say "a firmware with a defect gives other bytes"
sed '/^robot = /a program.defects = ["YM-03"]' scenarios/yellow-reactive.toml >"$out/defect.toml"
status=0
"$hilrig" run "$out/defect.toml" --firmware "$elf/yellow" --board cortex-m4 \
    --out "$out/defect" >/dev/null 2>&1 || status=$?
[[ $status -le 1 && -n $(hash_of "$out/defect") ]] || die "exit code $status of the defect's run"
[[ $(hash_of "$out/defect") != "$(hash_of "$out/yellow-native")" ]] || die "the hash sees no defect"
! python3 $here/same.py "$out/yellow-native/capture.pcapng" "$out/defect/capture.pcapng" \
    >"$out/defect.txt" 2>&1 || die "the comparison sees no defect"
grep -q . "$out/defect.txt" || die "the comparison does not say where they differ"

# smoke BOARD FLASH-START SENSOR-UART PC-UART [OPTION]: what the firmware says is judged by the
# device that it reports to. The rig's time stands while the machine is late, QEMU's does not: then
# a run is not judged (exit code 3).
smoke() {
    local board=$1 image=$out/mh_z19-$1.elf status=0
    arm-none-eabi-gcc -mcpu=cortex-m4 -mthumb -O2 -Wall -Wextra -Werror -ffreestanding -nostdlib \
        ${5:+"$5"} "-Wl,--defsym=FLASH_START=$2" -T $here/uart/board.ld $here/uart/mh_z19.c \
        -o "$image"
    "$hilrig" run $here/uart/mh_z19.toml --firmware "$image" --board "$board" --wire "sensor=$3" \
        --wire "pc=$4" --out "$out/smoke-$board" 2>/dev/null || status=$?
    [[ $status -eq 0 || $status -eq 3 ]] || die "$board: exit code $status"
    "$hilrig" decode "$out/smoke-$board/capture.pcapng" >"$out/smoke.txt" 2>&1
    grep -q '"ppm 006[0-9][0-9]' "$out/smoke.txt" ||
        die "$board: the firmware never reported a value of the sensor"
}
say "unmodified UART firmware, in real time"
smoke mps2-an386 0 uart0 uart1
smoke netduinoplus2 0x08000000 usart1 usart2 -DSTM32

say "unmodified firmware that only reads: nothing is observed, at a rate that stty does not know"
printf '%s\n' 'schema = 1' 'name = "mute"' 'robot = "none"' 'duration = "2s"' \
    'device.rx = { description = "crsf" }' >"$out/mute.toml"
arm-none-eabi-gcc -mcpu=cortex-m4 -mthumb -O2 -ffreestanding -nostdlib -DMUTE \
    -Wl,--defsym=FLASH_START=0 -T $here/uart/board.ld $here/uart/mh_z19.c -o "$out/mute.elf"
# mute FAILURES [OPTION]: how often the check may fail.
mute() {
    local status=0
    "$hilrig" run "$out/mute.toml" --firmware "$out/mute.elf" --board mps2-an386 --wire rx=uart0 \
        ${2:+"$2"} --out "$out/mute" >"$out/mute.txt" 2>&1 || status=$?
    [[ $status -ne 2 && $(grep -c 'FAIL program-goes-on .* nothing and printed' "$out/mute.txt") -eq $1 ]] ||
        die "mute firmware ${2:-}: exit code $status: $(<"$out/mute.txt")"
}
mute 1
mute 0 --firmware-may-idle

if [[ ${1:-} == --bench ]]; then
    say "speed beside life"
    avr=()
    if command -v avr-g++ >/dev/null && [[ -f /usr/include/simavr/sim_avr.h ]]; then
        bash tests/firmware/build.sh tests/firmware/sketches/station.cpp mega "$out/station.elf"
        avr=(tests/firmware/station.toml "$out/station.elf")
        avr+=(ranger=i2c imu=i2c scale=serial1 pc=serial2)
    fi
    python3 $here/bench.py "$hilrig" "$elf" "$out" "${avr[@]}"
fi
echo "tests/cortex_m4: all passed"
