#!/usr/bin/env bash
# Programs with planted bugs under `hilrig fuzz --exec`, by hand: how many cases a second in
# real and in virtual time, and what coverage is worth. Needs python3 and gcc.
#   tests/fuzz_programs/run.sh HILRIG [SECONDS [SEEDS [CASES]]]
set -u
hilrig=$(realpath "$1") seconds=${2:-60} seeds=${3:-5} cases=${4:-150}
here=$(realpath "$(dirname "$0")")
# The interpreter itself: a wrapper around it would be started under supervision as well.
python=$(python3 -c 'import sys; print(sys.executable)')
work=$(mktemp -d) && trap 'rm -rf "$work"' EXIT && cd "$work" || exit 2

rate() { # NAME OPTION..
    local name=$1; shift
    "$hilrig" fuzz --exec "exec $python -S -I $here/gripper.py" --link gripper \
        --scenario "$here/gripper.toml" --for "${seconds}s" --shrink 20 --out "$name" "$@" > "$name.txt" 2>&1
    echo "$name: $(grep -o '[0-9]* cases, [0-9.]*/s, [0-9]* findings' "$name.txt" | tail -1)"
    ls "$name/findings" 2>/dev/null | sed 's/^/    /'
}
rate real
rate virtual --virtual
again=0
for finding in virtual/findings/*/; do
    sed "s|^hilrig|$hilrig|" "$finding/repeat.txt" | sh > again.txt 2>&1
    grep -q "^seen again" again.txt && cmp -s "$finding/capture.pcapng" "$finding/repeated.pcapng" \
        && again=$((again + 1))
done
echo "seen again with the same bytes: $again of $(ls virtual/findings | wc -l)"

"$hilrig" fuzz --coverage-runtime hilrig-coverage.c
gcc -O1 -c hilrig-coverage.c && gcc -O1 "$here/nested.c" -o without &&
    gcc -O1 -fsanitize-coverage=trace-pc "$here/nested.c" hilrig-coverage.o -o with || exit 2
for program in with without; do
    for seed in $(seq "$seeds"); do
        "$hilrig" fuzz --exec "exec ./$program" --virtual --scenario "$here/sonar.toml" --link sonar \
            --case 1s --cases "$cases" --seed "$seed" --shrink 0 --out "$program-$seed" > out.txt 2>&1
        found=$(grep -o 'crash-.*first in case [0-9]*' out.txt | head -1)
        echo "$program, seed $seed: ${found:-nothing}; $(grep -o '[0-9]* cases, [0-9.]*/s' out.txt | tail -1)"
    done
done
