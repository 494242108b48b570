#!/usr/bin/env bash
# Public drivers, used as pip gives them. A session of each with its device is captured. The
# capture then takes the place of the device, for the same driver: at once, later and more slowly,
# in virtual time and in real time. With the driver broken in one place the replay says where it
# parts. If the driver only listens, the case of the capture is red for the broken driver and green
# for the sound one.
#   tests/replay/public_drivers/run.sh [NAME..]
# Needs python3 with venv. HILRIG is the command.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
target=$(realpath -m "${CARGO_TARGET_DIR:-$here/../../../target}")
hilrig=$(realpath "${HILRIG:-$target/debug/hilrig}")
export PYTHONDONTWRITEBYTECODE=1
# A folder of its own: other proofs fill theirs at the same time.
tools=$target/public-drivers
wanted="pyserial==3.5 minimalmodbus==2.1.1 pymodbus==3.16.1 pynmea2==1.19.0 pygmc==0.14.2
    obd==0.7.3 tfmini==0.3.2 pyubx2==1.4.0"
if [[ "$(cat "$tools/installed" 2>/dev/null)" != "$wanted" ]]; then
    python3 -m venv "$tools"
    # shellcheck disable=SC2086
    "$tools/bin/pip" install -q $wanted
    echo "$wanted" > "$tools/installed"
fi
python=$(realpath -s "$tools/bin/python")
all="minimalmodbus pymodbus obd pygmc pyubx2 tfmini pynmea2"

fail() {
    echo "FAIL $1" >&2
    cat said >&2
    exit 1
}

# Waits until a command holds: the ports are there, or the device is ready.
await() {
    for _ in {1..600}; do
        "$@" && return
        sleep 0.05
    done
    : > said
    fail "$*: not within 30 s"
}

# The session: the device on one side of a tap, the driver on the other.
capture() {
    mkdir -p tap
    "$hilrig" record --tap "dev=pty:$PWD/tap/dev" "drv=pty:$PWD/tap/drv" -o session.pcapng \
        > record 2>&1 &
    local tap=$!
    await test -e tap/dev -a -e tap/drv
    "$python" "$here/devices.py" "$1" tap/dev > device 2>&1 &
    local device=$!
    trap 'kill "$tap" "$device" 2>/dev/null || true' EXIT
    await grep -qs ready device
    "$python" "$here/drivers.py" "$1" tap/drv as > said 2>&1 || fail "$1: the session itself"
    kill -INT "$tap"
    wait "$tap" || true
    kill "$device" 2>/dev/null || true
    wait "$device" 2>/dev/null || true
    trap - EXIT
    cp said session
}

# One replay: NAME MODE OPTION..
replayed() {
    local name=$1 mode=$2
    shift 2
    "$hilrig" replay session.pcapng --expect --exec-may-end --exec-wait 60s --out out "$@" \
        --exec "exec '$python' '$here/drivers.py' $name \"\$HILRIG_PORT_DEV\" $mode" > said 2>&1
}

# All of one driver, in a folder of its own.
prove() {
    local name=$1 driver
    capture "$name"
    for mode in as late slow; do
        replayed "$name" "$mode" --virtual || fail "$name $mode, virtual time"
    done
    replayed "$name" late || fail "$name late, real time"
    if [[ $name == pynmea2 ]]; then
        driver="exec '$python' '$here/drivers.py' $name \"\$HILRIG_PORT_DEV\""
        "$hilrig" case from session.pcapng -o case.toml --virtual --exec-may-end \
            --sound "$driver as" --exec "$driver broken" > said 2>&1 || fail "$name: case from"
        grep -q "the case is red today" said || fail "$name broken: expected red"
        "$hilrig" case check case.toml --virtual --exec-may-end \
            --exec "$driver broken" --exec "$driver as" > said 2>&1 || fail "$name: case check"
    else
        if replayed "$name" broken --virtual; then fail "$name broken: expected a divergence"; fi
        grep -q "^DIVERGENCE at " said || fail "$name broken: expected words"
    fi
    echo "$name: $(wc -l < session) lines; as captured, late, slow: the same; broken:"
    grep -A 3 "DIVERGENCE\|^red" said | sed 's/^/    /' | head -4
}

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# One after the other: each starts programs in real time, which are not to be held up.
for name in ${*:-$all}; do
    [[ " $all " == *" $name "* ]] || {
        echo "$0: no driver $name; expected some of $all" >&2
        exit 2
    }
    mkdir "$work/$name"
    (cd "$work/$name" && prove "$name")
done
