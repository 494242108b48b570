#!/bin/sh
# How fast foreign programs are in virtual time, beside the same run in real time, and what a stop
# costs with program and supervisor on one processor and on two:
#   benches/guest.sh [REPEATS=5]
# Each figure is the median of so many runs, of wall time and of processor time (supervisor and
# program together): the latter says on a busy machine what the former would be on a quiet one.
# Needs a release build, a C compiler, and Python with pyserial as $PYTHON. By hand.
set -eu
repeats=${1:-5}
here=$(cd "$(dirname "$0")/.." && pwd)
hilrig=${HILRIG:-${CARGO_TARGET_DIR:-$here/target}/release/hilrig}
python=${PYTHON:-python3}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
cp -r "$here"/tests/exec/programs/* .
sed -i 's/^duration.*/duration = "20s"/' sonar.toml
cc -O1 -o stops stops.c
sed 's/t.tv_sec < 1002/1/' poll.c > endless.c
cc -O1 -o endless endless.c
# Wall and processor seconds of one run.
once() {
    "$python" - "$hilrig" "$@" << 'END'
import resource, subprocess, sys, time
hilrig, *words = sys.argv[1:]
began = time.monotonic()
run = [hilrig, "run", "sonar.toml", "--exec-needs", "sonar", "--out", "out", *words]
subprocess.run(run, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
wall = time.monotonic() - began
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(f"{wall:.3f} {used.ru_utime + used.ru_stime:.3f}")
END
}
# The median of each column of REPEATS runs.
median() {
    for _ in $(seq "$repeats"); do once "$@"; done > runs
    for column in 1 2; do
        cut -d ' ' -f "$column" runs | sort -n | sed -n "$(((repeats + 1) / 2))p"
    done | paste -sd ' '
}
for program in "$python reader.py" ./endless; do
    real=$(once --exec "$program" | cut -d ' ' -f 1)
    set -- $(median --exec "$program" --virtual)
    echo "$program: 20 s take $real s in real time, $1 s in virtual time," \
        "$(echo "20 $1" | awk '{ printf "%.0f", $1 / $2 }') times;" \
        "$2 s of a processor, $(echo "20 $2" | awk '{ printf "%.0f", $1 / $2 }') times"
done
set -- $(median --exec 'exec 3<> "$HILRIG_PORT_SONAR"' --virtual)
idle=$2
for where in "" two; do
    set -- $(median --exec "./stops $where" --virtual)
    echo "a stop on ${where:-one} processor(s): $(echo "$1" | awk '{ printf "%.1f", $1 / 0.2 }') us," \
        "of a processor $(echo "$2 $idle" | awk '{ printf "%.1f", ($1 - $2) / 0.2 }') us"
done
