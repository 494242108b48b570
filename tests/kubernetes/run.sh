#!/usr/bin/env bash
# The recipe for Kubernetes of docs/campaigns.md against the schema of Kubernetes, and copies of it
# that are misspelt, which must not pass. What its script does is tried in tests/cli/campaign.rs.
#
# usage: tests/kubernetes/run.sh
set -euo pipefail
cd "$(dirname "$0")"
target=$(realpath -m "${CARGO_TARGET_DIR:-../../target}")

fail() {
    echo "tests/kubernetes: $1: nothing was judged" >&2
    exit 1
}
tools=$target/kubernetes
# Anew if another version is asked for.
cmp -s requirements.txt "$tools/installed.txt" || {
    python3 -m venv "$tools" || fail "no venv can be made (Debian: python3-venv)"
    "$tools/bin/pip" install -q -r requirements.txt || fail "pip cannot install requirements.txt"
    cp requirements.txt "$tools/installed.txt"
}
recipe=$tools/recipe.yaml
awk '/^```yaml$/ && ++n == 1 { inside = 1; next } /^```$/ { inside = 0 } inside' \
    ../../docs/campaigns.md >"$recipe"
grep -q '^kind: Job$' "$recipe" || fail "docs/campaigns.md has another recipe"
"$tools/bin/kubernetes-validate" --strict "$recipe"
for word in backoffLimitPerIndex terminationGracePeriodSeconds requests completionMode; do
    grep -q "$word" "$recipe" || fail "the recipe has no $word"
    # Without its last letter.
    sed "s/$word/${word%?}/" "$recipe" >"$tools/misspelt.yaml"
    ! "$tools/bin/kubernetes-validate" --strict --quiet "$tools/misspelt.yaml" 2>/dev/null || {
        echo "tests/kubernetes: ${word%?} passes" >&2
        exit 1
    }
done
