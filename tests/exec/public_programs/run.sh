#!/usr/bin/env bash
# Public programs, unmodified, in virtual time: the table of docs/virtual-time.md.
#   tests/exec/public_programs/run.sh [--write] [--runs N] [NAME..]
# Installs what is missing by apt and pip. HILRIG is the command, a release build.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
target=$(realpath -m "${CARGO_TARGET_DIR:-$here/../../../target}")
export HILRIG=${HILRIG:-$target/release/hilrig} TOOLS=$target/public-programs
mapfile -t wanted < <(python3 -c "
import tomllib
rows = tomllib.load(open('$here/programs.toml', 'rb'))['program']
print('\n'.join(sorted({name for row in rows for name in row.get('apt', [])})))")
missing=()
for package in "${wanted[@]}"; do
    dpkg -s "$package" >/dev/null 2>&1 || missing+=("$package")
done
if [[ ${#missing[@]} -gt 0 ]]; then
    as_root=()
    [[ $EUID -eq 0 ]] || as_root=(sudo)
    "${as_root[@]}" apt-get update -qq
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -qq -y --no-install-recommends "${missing[@]}" >/dev/null
fi
cmp -s "$here/requirements.txt" "$TOOLS/installed.txt" || {
    rm -rf "$TOOLS"
    python3 -m venv "$TOOLS"
    "$TOOLS/bin/pip" install -q -r "$here/requirements.txt"
    cp "$here/requirements.txt" "$TOOLS/installed.txt"
}
exec "$TOOLS/bin/python" "$here/prove.py" "$@"
