#!/bin/sh
# How fast foreign programs are in virtual time, beside the same run in real time, and what a stop
# costs with program and supervisor on one processor and on two:
#   benches/guest.sh
# Needs a release build, a C compiler, and Python with pyserial as $PYTHON. By hand, on a quiet
# machine.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
hilrig=${HILRIG:-${CARGO_TARGET_DIR:-$here/target}/release/hilrig}
python=${PYTHON:-python3}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
cp "$here"/tests/exec/programs/* .
sed -i 's/^duration.*/duration = "20s"/' sonar.toml
cc -O1 -o stops stops.c
sed 's/t.tv_sec < 1002/1/' poll.c > endless.c
cc -O1 -o endless endless.c
seconds() { date +%s.%N; }
wall() {
    from=$(seconds)
    "$hilrig" run sonar.toml --exec-needs sonar --out out "$@" > said 2>&1 || true
    echo "$from $(seconds)" | awk '{ printf "%.3f", $2 - $1 }'
}
for program in "$python reader.py" ./endless; do
    real=$(wall --exec "$program")
    virtual=$(wall --exec "$program" --virtual)
    echo "$program: 20 s take $real s in real time, $virtual s in virtual time:" \
        "$(echo "$real $virtual" | awk '{ printf "%.0f", $1 / $2 }') times"
done
idle=$(wall --exec 'exec 3<> "$HILRIG_PORT_SONAR"' --virtual)
for where in "" two; do
    took=$(wall --exec "./stops $where" --virtual)
    echo "a stop on ${where:-one} processor(s):" \
        "$(echo "$took $idle" | awk '{ printf "%.1f", ($1 - $2) / 0.2 }') us"
done
