#!/usr/bin/env bash
# What docs/ci says, done: a root of Debian 12 as the second stage of the Containerfile makes it,
# and in it the steps of the snippets for GitHub and GitLab. By hand: it needs root, debootstrap
# and PyYAML.
#
# usage: bash tests/ci/run.sh HILRIG ROOT
#
# HILRIG is the program; ROOT is a folder for the root, kept, and taken as it is if it is there.
set -euo pipefail
cd "$(dirname "$0")/../.."
hilrig=$1 root=$(realpath -m "$2")
logs=$root/var/log project=/srv/project

[[ -x $root/bin/sh ]] || debootstrap --variant=minbase bookworm "$root"
mountpoint -q "$root/dev/pts" ||
    mount -t devpts devpts "$root/dev/pts" -o newinstance,ptmxmode=0666
mountpoint -q "$root/proc" || mount -t proc proc "$root/proc"
trap 'umount "$root/dev/pts" "$root/proc"' EXIT
ln -sf pts/ptmx "$root/dev/ptmx"
inside() {
    chroot "$root" env -i HOME=/srv PATH=/usr/local/bin:/usr/bin:/bin bash -c "$1"
}

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
echo "all steps did what they should"
