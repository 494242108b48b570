#!/usr/bin/env bash
# Programs with planted bugs under `hilrig fuzz --exec`, by hand: how many cases a second in
# real and in virtual time, and what coverage is worth. Needs python3, gcc, g++ and rustc.
#   tests/fuzz_programs/run.sh HILRIG [SECONDS [SEEDS [CASES [PROGRAM..]]]]
# With SECONDS 0 no rates are measured, with SEEDS 0 nothing about coverage.
set -u
hilrig=$(realpath "$1") seconds=${2:-60} seeds=${3:-10} cases=${4:-128}
shift $(($# < 4 ? $# : 4))
here=$(realpath "$(dirname "$0")")
work=$(mktemp -d) && trap 'rm -rf "$work"' EXIT && cd "$work" || exit 2

rate() { # NAME OPTION..
    local name=$1 TIMEFORMAT='%U %S'; shift
    { time "$hilrig" fuzz --exec "exec $python -S -I $here/gripper.py" --link gripper \
        --scenario "$here/gripper.toml" --for "${seconds}s" --shrink 0 --out "$name" "$@" \
        > "$name.txt" 2>&1; } 2> "$name.time"
    echo "$name: $(grep -o '[0-9]* cases, [0-9.]*/s, [0-9]* findings' "$name.txt" | tail -1)," \
        "processor $(awk '{ print $1 + $2 }' "$name.time") s"
    ls "$name/findings" 2>/dev/null | sed 's/^/    /'
}

# Both at once, so that the machine is as busy for the one as for the other.
rates() {
    # The interpreter itself: a wrapper around it would be started under supervision as well.
    python=$(python3 -c 'import sys; print(sys.executable)')
    rate real &
    rate virtual --virtual
    wait $!
    local again=0 finding
    for finding in virtual/findings/*/; do
        sed "s|^hilrig|$hilrig|" "$finding/repeat.txt" | sh > again.txt 2>&1
        grep -q "^seen again" again.txt \
            && cmp -s "$finding/capture.pcapng" "$finding/repeated.pcapng" && again=$((again + 1))
    done
    echo "seen again with the same bytes: $again of $(ls virtual/findings | wc -l)"
}

build() { # PROGRAM: NAME-with, NAME-without
    local name=${1%.*} source=$here/nested/$1 sancov=-fsanitize-coverage=trace-pc,trace-cmp
    case $1 in
    *.rs)
        rustc -O "$source" -o "$name-without" && rustc -O "$source" -o "$name-with" \
            -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=3 \
            -Cllvm-args=-sanitizer-coverage-trace-pc-guard \
            -Cllvm-args=-sanitizer-coverage-trace-compares \
            -Cllvm-args=-max-loads-per-memcmp=0 -Clink-arg=hilrig-coverage.o ;;
    *.cpp)
        g++ -O1 "$source" -o "$name-without" &&
            g++ -O1 $sancov -fno-builtin "$source" hilrig-coverage.o -o "$name-with" ;;
    *)
        gcc -O1 "$source" -o "$name-without" &&
            gcc -O1 $sancov -fno-builtin "$source" hilrig-coverage.o -o "$name-with" ;;
    esac
}

# In which case the bug of PROGRAM is found; "never" if in none.
first() { # PROGRAM SEED
    local link=sonar most=2 out=$1-$2 found
    [[ $1 == frames-* ]] && link=gripper
    # A search goes on where it was: so it ends soon after the bug.
    while [ "$most" -le "$cases" ]; do
        "$hilrig" fuzz --exec "exec ./$1" --virtual --scenario "$here/$link.toml" --link "$link" \
            --case 1s --cases "$most" --seed "$2" --shrink 0 --out "$out" > "$out.txt" 2>&1
        found=$(sed -n 's/.*-crash-.*first in case \([0-9]*\)$/\1/p' "$out.txt" | head -1)
        [ -n "$found" ] && echo "$found" && return
        most=$((most * 2))
    done
    echo never
}

coverage() { # PROGRAM..
    "$hilrig" fuzz --coverage-runtime hilrig-coverage.c && gcc -O1 -c hilrig-coverage.c || exit 2
    local program how seed found
    for program in "$@"; do
        build "$program" || exit 2
        for how in with without; do
            found=$(for seed in $(seq "$seeds"); do
                first "${program%.*}-$how" "$seed"
            done | sort -V)
            echo "$program $how coverage: median $(sed -n "$(((seeds + 1) / 2))p" <<< "$found") of" $found
        done
    done
}

[ "$seconds" = 0 ] || rates
# The first four were there when the search was made, the others judge it.
[ $# = 0 ] && set -- sonar.c commands.c frames.c states.c lengths.c ranges.cpp words.rs
[ "$seeds" = 0 ] || coverage "$@"
