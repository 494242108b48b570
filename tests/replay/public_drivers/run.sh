#!/usr/bin/env bash
# Public drivers, used as pip gives them. A session of each with its device is captured; the capture
# is
# then the device: for the same driver at once, later and more slowly, in virtual time and in real
# time. With the driver broken in one place the replay says where it parts, or, if the driver only
# listens, the case of the capture with the sound driver as its reference does.
#   tests/replay/public_drivers/run.sh [NAME..]
# Needs python3 with venv. HILRIG is the command.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
target=${CARGO_TARGET_DIR:-$here/../../../target}
hilrig=$(realpath "${HILRIG:-$target/debug/hilrig}")
tools=$target/tools
[[ -x $tools/bin/pip ]] || python3 -m venv "$tools"
"$tools/bin/pip" install -q pyserial==3.5 minimalmodbus==2.1.1 pymodbus==3.16.1 pynmea2==1.19.0 \
    pygmc==0.14.2 obd==0.7.3 tfmini==0.3.2 pyubx2==1.4.0
python=$(realpath -s "$tools/bin/python")
names=${*:-minimalmodbus pymodbus obd pygmc pyubx2 tfmini pynmea2}
work=$(mktemp -d)
pids=()
finish() {
    kill "${pids[@]}" 2>/dev/null || true
    rm -rf "$work"
}
trap finish EXIT
cd "$work"

fail() {
    echo "FAIL $1" >&2
    cat said >&2
    exit 1
}

# The session: the device on one side of a tap, the driver on the other.
capture() {
    mkdir -p "$1"
    "$hilrig" record --tap "dev=pty:$work/$1/dev" "drv=pty:$work/$1/drv" -o "$1.pcapng" \
        > "$1.record" 2>&1 &
    local tap=$!
    pids+=("$tap")
    until [[ -e $1/dev && -e $1/drv ]]; do sleep 0.05; done
    "$python" "$here/devices.py" "$1" "$work/$1/dev" 2> "$1.device" &
    local device=$!
    pids+=("$device")
    sleep 1
    "$python" "$here/drivers.py" "$1" "$work/$1/drv" as > said 2>&1 || fail "$1: the session itself"
    kill -INT "$tap"
    wait "$tap" || true
    kill "$device" 2>/dev/null || true
    wait "$device" 2>/dev/null || true
    cp said "$1.session"
}

# One replay: NAME MODE OPTION..
replayed() {
    local name=$1 mode=$2
    shift 2
    "$hilrig" replay "$name.pcapng" --expect --exec-may-end --exec-wait 60s --out "out-$name" "$@" \
        --exec "exec '$python' '$here/drivers.py' $name \"\$HILRIG_PORT_DEV\" $mode" > said 2>&1
}

for name in $names; do
    capture "$name"
    for mode in as late slow; do
        replayed "$name" "$mode" --virtual || fail "$name $mode, virtual time"
    done
    replayed "$name" late || fail "$name late, real time"
    case $name in
        pynmea2)
            driver="exec '$python' '$here/drivers.py' $name \"\$HILRIG_PORT_DEV\""
            "$hilrig" case from "$name.pcapng" -o "$name.toml" --virtual --exec-may-end \
                --sound "$driver as" --exec "$driver broken" > said 2>&1 || fail "$name: case from"
            grep -q "the case is red today" said || fail "$name broken: expected red"
            "$hilrig" case check "$name.toml" --virtual --exec-may-end \
                --exec "$driver broken" --exec "$driver as" > said 2>&1 || fail "$name: case check"
            ;;
        *)
            if replayed "$name" broken --virtual; then fail "$name broken: expected a divergence"; fi
            grep -q "^DIVERGENCE at " said || fail "$name broken: expected words"
            ;;
    esac
    echo "$name: $(wc -l < "$name.session") lines; as captured, late, slow: the same conversation; broken:"
    grep -A 3 "DIVERGENCE\|^red" said | sed 's/^/    /' | head -4
done
