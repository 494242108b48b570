#!/usr/bin/env bash
# The described receiver, read by gpsd in virtual time.
#   tests/devices/gpsd.sh
# Needs gpsd and gpspipe (Debian: gpsd, gpsd-clients). HILRIG is the command.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat >"$work/scenario.toml" <<'SCENARIO'
schema = 1
name = "gpsd"
robot = "none"
duration = "20s"
device.dev = { description = "gps" }
SCENARIO
cat >"$work/program.sh" <<'PROGRAM'
gpsd -N -n -S 29477 "$HILRIG_DIR/dev" &
daemon=$!
sleep 2
gpspipe -w -n 8 localhost:29477
kill $daemon
wait
PROGRAM
"$HILRIG" run "$work/scenario.toml" --virtual --exec-may-end --exec-may-idle --out "$work/out" \
    --exec "exec bash $work/program.sh" >"$work/said" 2>&1 || true
# A fix in three dimensions at the place of the description, 48.1173 N 11.5167 E.
if ! grep -q '"class":"TPV".*"mode":3.*"lat":48.117300000,"lon":11.516700000' "$work/out/program.log"; then
    cat "$work/said" "$work/out/program.log" >&2
    echo "FAIL gpsd: no fix" >&2
    exit 1
fi
echo "gps: gpsd: a fix in three dimensions at 48.1173 N 11.5167 E"
