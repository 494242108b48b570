#!/usr/bin/env bash
# How many changes of behaviour do the tests see? Random mutants of functions by cargo-mutants, each
# built and tested; the score is the share of viable ones that a test caught.
#
# usage: tests/mutants.sh PACKAGE [COUNT [SEED [FILE..]]]
#
#   tests/mutants.sh protocols                       all of it, with its own tests
#   tests/mutants.sh emulators 100 7                 100 mutants drawn by seed 7
#   tests/mutants.sh firmware_core 50 1 firmware_core/src/navigation.rs
#
# No part of the usual test run: it takes from minutes to a day. Survivors are in
# target/mutants/mutants.out/missed.txt; those that are equivalent stand in tests/mutants.txt with
# their reason, one line each as there, and are left out.
set -euo pipefail
cd "$(dirname "$0")/.."
[[ $# -ge 1 && $1 != -* ]] || { sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "$0" >&2; exit 2; }
package=$1 count=${2:-0} seed=${3:-1}
shift $(($# < 3 ? $# : 3))

command -v cargo-mutants >/dev/null || cargo install --locked cargo-mutants --version '^27' >&2
out=target/mutants
mkdir -p "$out"
files=()
for file in "$@"; do files+=(--file "$file"); done

# All mutants, without the equivalent ones; of those, COUNT by chance.
cargo mutants --list --package "$package" "${files[@]}" --colors never |
    grep -vxFf <(sed -n 's/^\([^#].*\) -- .*/\1/p' tests/mutants.txt) >"$out/all.txt"
total=$(wc -l <"$out/all.txt")
[[ $total -gt 0 ]] || { echo "tests/mutants.sh: no mutant in $package $*: nothing was seen" >&2; exit 2; }
if [[ $count -gt 0 && $count -lt $total ]]; then
    # Sorted by numbers of Park and Miller's generator, the first of which lie close together for
    # small seeds. (Of repeated text, shuf would draw half of the sample from one file.)
    awk -v x="$((seed % 2147483646 + 1))" '
        function next_number() { return x = x * 16807 % 2147483647 }
        BEGIN { for (i = 0; i < 10; i++) next_number() }
        { printf "%010d\t%s\n", next_number(), $0 }' "$out/all.txt" |
        LC_ALL=C sort | awk -v count="$count" 'NR <= count' | cut -f 2- >"$out/drawn.txt"
else
    cp "$out/all.txt" "$out/drawn.txt"
fi
echo "$(wc -l <"$out/drawn.txt") of $total mutants of $package" >&2

# Each by its whole name, its characters taken as they are.
names=()
while IFS= read -r name; do
    names+=(--re "^$(sed 's/[][\.*^$(){}?+|/&]/\\&/g' <<<"$name")$")
done <"$out/drawn.txt"
cargo mutants --package "$package" "${files[@]}" "${names[@]}" --output "$out" --jobs 2 \
    --minimum-test-timeout 60 --colors never --no-shuffle || true

caught=$(wc -l <"$out/mutants.out/caught.txt")
missed=$(wc -l <"$out/mutants.out/missed.txt")
late=$(wc -l <"$out/mutants.out/timeout.txt")
seen=$((caught + late))
viable=$((seen + missed))
[[ $viable -gt 0 ]] || { echo "tests/mutants.sh: no mutant of these builds: nothing was seen" >&2; exit 2; }
echo "$package: $seen of $viable viable mutants caught, $((100 * seen / viable)) %"
