#!/usr/bin/env bash
# Makes the pictures of the README and of these docs anew, in docs/img: page, light and dark, of
# three robots and of devices without one; reports and the robot's display.
#
# usage: bash docs/screenshots.sh
#
# Needs chromium, chromedriver, node and npm, and hilrig ($HILRIG, or target/debug/hilrig).
set -euo pipefail
cd "$(dirname "$0")/.."

bash tests/browser/run.sh --pictures
ls -l docs/img
