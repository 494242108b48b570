#!/usr/bin/env bash
# Runs the three devices by other means, in real time, each read by the driver of tests/devices; and
# counts lines. They are what docs/devices.md compares the descriptions with.
#   tests/devices/side_by_side/run.sh PYTHON
# Needs socat, and aiohttp for pymodbus' simulator.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
python=$(realpath -s "${1:?usage: run.sh PYTHON}")
work=$(mktemp -d)
pids=()
finish() {
    kill "${pids[@]}" 2>/dev/null || true
    rm -rf "$work"
}
trap finish EXIT
cd "$work"

wait_for() {
    for _ in $(seq 100); do
        [[ -e dev && -e drv ]] && return
        sleep 0.05
    done
    echo "socat makes no pseudo-terminals" >&2
    exit 1
}

# The processor time of the process $1 in ticks.
ticks() {
    awk '{ print $14 + $15 }' "/proc/$1/stat"
}

# The device is ready: it has opened its terminal, and only waits.
wait_until_ready() {
    local name=$1 pid=$2 before now
    for _ in $(seq 600); do
        if ! kill -0 "$pid" 2>/dev/null; then
            echo "FAIL $name: the device has ended" >&2
            cat device.log >&2
            exit 1
        fi
        before=$(ticks "$pid")
        sleep 0.5
        now=$(ticks "$pid")
        if ((now - before < 5)) && find "/proc/$pid/fd" -lname "$(realpath dev)" | grep -q .; then
            return
        fi
    done
    echo "FAIL $name: the device does not open its terminal" >&2
    exit 1
}

# NAME READER COMMAND..: the device on one end of a pair of pseudo-terminals, a driver on the other.
# The driver runs once.
try() {
    local name=$1 reader=$2
    shift 2
    rm -f dev drv
    socat pty,raw,echo=0,link=dev pty,raw,echo=0,link=drv &
    pids+=($!)
    wait_for
    "$@" >device.log 2>&1 &
    pids+=($!)
    mkdir -p ports
    ln -sfn "$work/drv" ports/dev
    wait_until_ready "$name" "${pids[-1]}"
    if ! HILRIG_DIR=$work/ports PYTHONPATH=$here/../drivers timeout 120 "$python" \
        "$here/../drivers/with_$reader.py" >read.log 2>&1; then
        echo "FAIL $name" >&2
        cat read.log device.log >&2
        exit 1
    fi
    echo "$name: $(paste -sd ';' read.log)"
    kill "${pids[@]}" 2>/dev/null || true
    wait 2>/dev/null || true
    pids=()
}

try "pymodbus' simulator" minimalmodbus "$(dirname "$python")/pymodbus.simulator" --log error \
    --json_file "$here/modbus_simulator.json" --modbus_server line --modbus_device meter \
    --http_port 18081
try "socat + Python, meter" minimalmodbus "$python" "$here/modbus_socat.py"
try "socat + Python, receiver" pynmea2 "$python" "$here/gps_socat.py"
try "socat + Python, receiver" pyubx2 "$python" "$here/gps_socat.py"
try "socat + Python, sensor" pyserial "$python" "$here/cobs_socat.py"
wc -l "$here"/*.json "$here"/*.py "$here"/../../../devices/{modbus-meter,gps,cobs-sensor}.toml |
    sed "s#$here/##; s#\.\./\.\./\.\./##"
