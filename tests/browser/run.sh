#!/usr/bin/env bash
# Page, report and campaign.html in a real browser: each function at three sizes, light and dark,
# judged by axe-core; with --pictures the pictures of the docs are made anew.
#
# usage: bash tests/browser/run.sh [--pictures] [rescue] [yellow] [apollo13] [custom] [devices]
#
# Needs chromium, chromedriver, node and npm, and hilrig ($HILRIG, or target/debug/hilrig). Takes a
# minute: by hand, not in tests/run.sh, whose page tests cover the functions at one size.
set -euo pipefail
cd "$(dirname "$0")/../.."

target=${CARGO_TARGET_DIR:-target}
export HILRIG=${HILRIG:-$target/debug/hilrig}
[[ -x $HILRIG ]] || {
    echo "tests/browser/run.sh: $HILRIG is missing; cargo build, or set HILRIG" >&2
    exit 1
}
axe=$target/tools/axe
[[ -f $axe/node_modules/axe-core/axe.min.js ]] || {
    mkdir -p "$axe"
    (cd "$axe" && npm install --silent --no-save --no-audit --no-fund axe-core@4.10.3)
}
AXE=$axe/node_modules/axe-core/axe.min.js
export AXE
exec node tests/browser/judge.mjs "$@"
