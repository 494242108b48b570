#!/bin/sh
# Programs in virtual time, each run N times while both processors are busy: one trace, one log.
#   tests/exec/many.sh [N=20] [NAME ..]
# Needs a C and a C++ compiler, Go and Java; Python with pyserial as $PYTHON. What is not there is
# named and left out. By hand: it takes some minutes.
set -eu
count=${1:-20}
[ $# -gt 0 ] && shift
wanted=${*:-robot reader poll static calls condition serialport tokio pipeline go java}
here=$(cd "$(dirname "$0")" && pwd)
target=${CARGO_TARGET_DIR:-$here/../../target}
hilrig=${HILRIG:-$target/release/hilrig}
client=${CLIENT:-$target/debug/examples/rust_client}
python=${PYTHON:-python3}
work=$(mktemp -d)
busy=
for _ in 1 2; do
    (while :; do :; done) &
    busy="$busy $!"
done
trap 'kill $busy; rm -rf "$work"' EXIT
cd "$work"
programs=$here/programs
cp "$programs"/* .
missing() { echo "$1: left out, $2"; }
cc -O1 -o poll poll.c && cc -O1 -static -o static poll.c && cc -O1 -o calls calls.c || missing poll "no C compiler"
c++ -O1 -pthread -o condition condition.cpp || missing condition "no C++ compiler"
go build -o go-client client.go || missing go "no Go"
javac Client.java || missing java "no Java"

failed=0
many() {
    name=$1 scenario=$2 command=$3
    shift 3
    : > "$name.seen"
    for _ in $(seq "$count"); do
        "$hilrig" run "$scenario" "$@" --exec "$command" --virtual --out "out-$name" \
            > "$name.said" 2>&1 || { [ $? -eq 1 ] || { cat "$name.said"; failed=1; return; }; }
        echo "$(sed -n 's/^ *trace //p' "$name.said")" \
            "$(cksum < "out-$name/program.log")" >> "$name.seen"
    done
    different=$(sort -u "$name.seen" | wc -l)
    verdict=$(grep -c "^  FAIL" "$name.said" || true)
    echo "$name: $count runs, $different different, $verdict failed checks," \
        "trace $(head -n 1 "$name.seen" | cut -d ' ' -f 1)"
    [ "$different" -eq 1 ] || failed=1
}
for one in $wanted; do
    sonar="sonar.toml"
    needs="--exec-needs sonar"
    case $one in
        robot) many robot "$here/../transport/short.toml" "$hilrig dut --dir \"\$HILRIG_DIR\"" ;;
        reader) many reader $sonar "$python reader.py" $needs ;;
        poll | static | calls | condition) many "$one" $sonar "./$one" $needs ;;
        serialport | tokio) many "$one" $sonar "$client $one" $needs ;;
        pipeline) many pipeline $sonar \
            'while read line; do echo "$line"; done < "$HILRIG_PORT_SONAR" | sed -u s/mm/MM/' \
            $needs ;;
        go) many go $sonar ./go-client $needs ;;
        java) many java $sonar "java Client" $needs ;;
    esac
done
exit $failed
