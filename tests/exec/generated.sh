#!/bin/sh
# Generated C programs of threads, sleeps, pipes, polls and locks: each says the same in virtual
# time, twice with the same calls, and in real time, where it is the same in any order of
# its threads.
#   tests/exec/generated.sh [FIRST=1] [LAST=50]
# Needs a C compiler and Python. The first few are in the tests, the others by hand.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
hilrig=${HILRIG:-${CARGO_TARGET_DIR:-$here/../../target}/release/hilrig}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
cp "$here/programs/sonar.toml" .
bad=0
for seed in $(seq "${1:-1}" "${2:-50}"); do
    python3 "$here/programs/generate.py" "$seed" > program.c
    cc -O1 -pthread -o program program.c
    # In real time the port is a file; it is ended when it has said its last line.
    rm -f real
    HILRIG_PORT_SONAR=/dev/null timeout 120 ./program > real & pid=$!
    until grep -q ^sum real 2> /dev/null; do sleep 0.02; kill -0 $pid 2> /dev/null || break; done
    kill $pid 2> /dev/null || true
    wait $pid 2> /dev/null || true
    "$hilrig" run sonar.toml --exec-needs sonar --exec ./program --virtual --check --out out \
        > said 2>&1 || true
    if ! cmp -s real out/program.log || ! grep -q "ok   deterministic *both runs gave the same bytes" said; then
        echo "seed $seed:"
        diff real out/program.log || true
        grep deterministic said || cat said
        bad=$((bad + 1))
    fi
done
echo "${1:-1} to ${2:-50}: $bad differ"
[ $bad -eq 0 ]
