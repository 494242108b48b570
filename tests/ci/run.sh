#!/usr/bin/env bash
# Executes docs/ci: a root of Debian 12 as the second stage of the Containerfile makes it, and in
# it the steps of the snippets for GitHub and GitLab. Then a root with Python only: the wheel, the
# first test of docs/python.md, and the three snippets with pytest. By hand: it needs root,
# debootstrap and PyYAML.
#
# usage: bash tests/ci/run.sh HILRIG ROOT
#
# HILRIG is the program, of a release; ROOT is a folder for the roots, kept, and used if it exists.
set -euo pipefail
cd "$(dirname "$0")/../.."
hilrig=$1 roots=$(realpath -m "$2") project=/srv/project
mounted=()
leave() { ((${#mounted[@]} == 0)) || umount "${mounted[@]}"; }
trap leave EXIT

# enter NAME [PACKAGES]: a root, made if it is missing, for the commands of `inside`.
enter() {
    root=$roots/$1 logs=$roots/$1/var/log
    [[ -x $root/bin/sh ]] ||
        debootstrap --variant=minbase ${2:+--include="$2"} bookworm "$root" >"$roots/$1.log"
    mount -t devpts devpts "$root/dev/pts" -o newinstance,ptmxmode=0666
    mount -t proc proc "$root/proc"
    mounted+=("$root/dev/pts" "$root/proc")
    ln -sf pts/ptmx "$root/dev/ptmx"
    # The registry of this machine, and its certificates.
    [[ ! -f /etc/pip.conf ]] || cp /etc/pip.conf "$root/etc/pip.conf"
    mkdir -p "$root/etc/ssl/certs"
    cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"
}
inside() {
    chroot "$root" env -i HOME=/srv PATH="/srv/venv/bin:/usr/local/bin:/usr/bin:/bin" bash -c "$1"
}
mkdir -p "$roots"
enter container

# The Containerfile: its RUN of the second stage, its COPY, its CMD.
again=$(sed -e '1,/^FROM docker.io\/library\/debian/d' -e ':a;/\\$/{N;s/\\\n//;ba}' \
    docs/ci/Containerfile | sed -n 's/^RUN //p')
echo "container: $again"
inside "$again" >"$logs/apt.log" 2>&1
cp "$hilrig" "$root/usr/local/bin/hilrig"
shown=$(sed -n 's/^CMD \[\(.*\)\]/\1/p' docs/ci/Containerfile | tr -d '",')
inside "$shown" >"$logs/help.log"
grep -q "^Usage: hilrig" "$logs/help.log"

# A user's project: a scenario in tests/, the program beside it.
rm -rf "${root:?}$project" && mkdir -p "$root$project/tests"
cp docs/connect/robot.py "$root$project/robot.py"
cp docs/connect/robot.toml "$root$project/tests/robot.toml"
steps() {
    while IFS= read -r step; do
        echo "$1: ${step#set -e; }"
        inside "cd $project; $step" >"$logs/$1.log" 2>&1 || {
            tail -n 20 "$logs/$1.log"
            return 1
        }
    done < <(python3 tests/ci/steps.py "docs/ci/$1.yml" "${@:2}")
    grep -q 'failures="0"' "$root$project/junit.xml"
    rm -r "$root$project/junit.xml" "$root$project/hilrig-out"
}
steps github "scenarios=tests/*.toml" "program=python3 robot.py" "hilrig=nowhere"
steps gitlab

# As an image of Python: pip installs without Debian's veto.
enter python python3-venv,ca-certificates
inside "! command -v cargo rustc cc"
rm -rf "${root:?}$project" "$root/srv/venv" && mkdir -p "$root$project/wheels"
wheel=$(python3 python/wheel.py "$hilrig" "$root$project/wheels")
wheel=wheels/$(basename "$wheel")
inside "python3 -m venv /srv/venv"
begun=$(date +%s%N)
inside "cd $project; pip install $wheel pyserial pytest" >"$logs/pip.log"
echo "pip install: $((($(date +%s%N) - begun) / 1000000)) ms"
python3 tests/ci/first_test.py docs/python.md "$root$project"
inside "cd $project; pytest --hilrig-virtual" | tee "$logs/first.log"
grep -q " 1 passed" "$logs/first.log"
for snippet in github gitlab woodpecker; do
    # Each from a fresh environment.
    rm -rf "$root/srv/venv" && inside "python3 -m venv /srv/venv"
    while IFS= read -r step; do
        echo "$snippet: ${step#set -e; }"
        inside "cd $project; $step" >"$logs/$snippet.log" 2>&1 || {
            tail -n 20 "$logs/$snippet.log"
            exit 1
        }
    done < <(python3 tests/ci/steps.py "docs/ci/pytest-$snippet.yml" "HILRIG_WHEEL=$wheel")
    grep -q 'failures="0"' "$root$project/junit.xml"
    grep -q 'tests="1"' "$root$project/junit.xml"
    rm "$root$project/junit.xml"
done
echo "all steps did what they should"
