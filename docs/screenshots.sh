#!/usr/bin/env bash
# Makes the pictures of the README anew, in docs/img, by the tests that look at the same things.
#
# usage: bash docs/screenshots.sh
#
# Needs chromium and chromedriver (Debian: chromium, chromium-driver).
set -euo pipefail
cd "$(dirname "$0")/.."

mkdir -p docs/img
HILRIG_PICTURES=$PWD/docs/img CI=1 cargo test --locked --test page picture
ls -l docs/img
