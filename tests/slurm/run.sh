#!/usr/bin/env bash
# The recipe for Slurm of docs/campaigns.md on a Slurm of one node: an array of 4, of which one task
# is lost, one cancelled and one told to end before its time; submitted again, merged by a dependent
# job, and compared byte for byte with the campaign in one piece.
#
# usage: tests/slurm/run.sh
#
# HILRIG may name the program where it is built already. Needs root, slurmctld and slurmd (Debian:
# slurm-wlm) and munged (munge), no systemd: all three run as children of this script, with their
# files in a folder of its own. Takes some twenty seconds.
set -euo pipefail
cd "$(dirname "$0")"
docs=$(realpath ../../docs/campaigns.md)
scenario=$(realpath ../../scenarios/empty-room.toml)
target=$(realpath -m "${CARGO_TARGET_DIR:-../../target}")

fail() {
    echo "tests/slurm: $1: nothing was judged" >&2
    exit 1
}
[[ $EUID -eq 0 ]] || fail "not root, and only root can start a Slurm"
for program in munged slurmctld slurmd sbatch scancel; do
    command -v "$program" >/dev/null || fail "no $program (Debian: slurm-wlm, munge)"
done
[[ -n ${HILRIG:-} ]] ||
    CARGO_TARGET_DIR=$target cargo build --locked --quiet --manifest-path ../../Cargo.toml \
        --bin hilrig
hilrig=$(realpath "${HILRIG:-$target/debug/hilrig}")

dir=$(mktemp -d /tmp/hilrig-slurm.XXXXXX)
daemons=()
end() {
    status=$?
    # In the order in which they need each other: a slurmd that is asked to end finishes its tasks.
    scancel --user=root 2>/dev/null || true
    for ((i = ${#daemons[@]} - 1; i >= 0; i--)); do
        kill "${daemons[i]}" 2>/dev/null || true
        wait "${daemons[i]}" 2>/dev/null || true
    done
    if [[ $status -eq 0 ]]; then rm -rf "$dir"; else echo "logs are in $dir" >&2; fi
}
trap end EXIT
chmod 711 "$dir"

# until SECONDS COMMAND..: whether it succeeds within that time.
until_true() {
    local deadline=$((SECONDS + $1))
    shift
    until "$@"; do
        ((SECONDS < deadline)) || return 1
        sleep 0.1
    done
}

# --- A cluster of this machine. Its 32 processors are a claim, so that the recipe's tasks of eight
# run beside each other anywhere.
(umask 077 && head -c 128 /dev/urandom >"$dir/munge.key")
munged --foreground --force --key-file="$dir/munge.key" --socket="$dir/munge.socket" \
    --pid-file="$dir/munged.pid" --log-file="$dir/munged.log" --seed-file="$dir/munge.seed" \
    >>"$dir/munged.log" 2>&1 &
daemons+=($!)
free_port() {
    python3 -c 'import socket
s = socket.socket()
s.bind(("127.0.0.1", 0))
print(s.getsockname()[1])'
}
host=$(hostname -s)
cat >"$dir/slurm.conf" <<END
ClusterName=hilrig
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$(free_port)
SlurmdPort=$(free_port)
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$dir/munge.socket
CredType=cred/munge
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/spool
SlurmctldPidFile=$dir/slurmctld.pid
SlurmdPidFile=$dir/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SwitchType=switch/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=batch_sched_delay=0,sched_interval=1,bf_interval=1,sched_min_interval=0
SlurmdParameters=config_overrides
ReturnToService=2
NodeName=$host NodeAddr=127.0.0.1 CPUs=32 RealMemory=1024 State=UNKNOWN
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE State=UP
END
mkdir -p "$dir/state" "$dir/spool"
export SLURM_CONF=$dir/slurm.conf
until_true 10 test -S "$dir/munge.socket" || fail "munged does not start"
slurmctld -D -f "$SLURM_CONF" >"$dir/slurmctld.log" 2>&1 &
daemons+=($!)
slurmd -D -f "$SLURM_CONF" -N "$host" >"$dir/slurmd.log" 2>&1 &
daemons+=($!)
is_up() { [[ $(sinfo --noheader --format=%t 2>/dev/null) == idle ]]; }
until_true 20 is_up || fail "no Slurm can be started here"

# --- The recipe as it stands, but for what makes it short: 4 tasks of few runs of one scenario.
recipe() { # NUMBER: that block of bash below "On many machines"
    sed -n '/^## On many machines/,$p' "$docs" |
        awk -v wanted="$1" '/^```bash$/ { if (++n == wanted) inside = 1; next }
            /^```$/ { inside = 0 } inside'
}
here=$dir/work
mkdir -p "$here/scenarios"
cd "$here"
# No robot comes home to a tenth of a millimetre: every run fails, so there is a case to compare.
sed 's/^\[expect\]/&\nhome_within_mm = 0.1/' "$scenario" >scenarios/strict.toml
seeds=0..60
each=15
recipe 1 | sed "s/--array=0-15/--array=0-3/; s/--shards 16/--shards 4/; s/0\.\.100000/$seeds/" \
    >shards.sh
grep -q -- '--array=0-3 ' shards.sh && grep -q -- '--shards 4 ' shards.sh &&
    grep -q -- "--seeds $seeds " shards.sh || fail "docs/campaigns.md has another recipe"
recipe 2 >submit.sh
mkdir bin
ln -s "$hilrig" bin/hilrig
export PATH=$here/bin:$PATH

wrong() {
    echo "tests/slurm: $1" >&2
    squeue --format='%i %T %r' >&2 || true
    tail -n 5 shards-*.log slurm-*.out >&2 2>/dev/null || true
    exit 1
}
# state JOB: of a job or a task, that still runs or ended less than minutes ago.
state() { scontrol --oneliner show job "$1" | grep -o 'JobState=[A-Z_]*' | sort -u; }
is_state() { [[ $(state "$1") == "JobState=$2" ]]; }
has_begun() { [[ $(wc -l 2>/dev/null <"shards/$1/runs.jsonl") -ge 2 ]]; }
runs() { wc -l <"shards/$1/runs.jsonl"; }

echo "an array of four"
bash ./submit.sh >submitted.txt
merge=$(grep -o '[0-9]*$' submitted.txt)
array=$((merge - 1))
for task in 1 2 3; do
    until_true 60 has_begun "$task" || wrong "task $task does not begin"
done
echo "task 1 is lost, task 2 is cancelled, task 3 is told that its time is nearly over"
kill -9 "$(<shards/1/campaign.lock)"
scancel "${array}_2"
scancel --signal=TERM "${array}_3"
until_true 120 is_state "${array}_0" COMPLETED || wrong "task 0: $(state "${array}_0")"
for ended in 1:FAILED 2:CANCELLED 3:FAILED; do
    task=${ended%:*}
    until_true 60 is_state "${array}_$task" "${ended#*:}" ||
        wrong "task $task: $(state "${array}_$task"), expected ${ended#*:}"
    [[ $(runs "$task") -lt $each ]] || wrong "task $task was done before it could be stopped"
    cp "shards/$task/runs.jsonl" "before-$task.jsonl"
done
grep -q DependencyNeverSatisfied <(squeue --noheader --format=%r --jobs="$merge") ||
    wrong "the merge does not wait for what was lost"
grep -q '"cause":"' shards/0/runs.jsonl || wrong "no run failed, so exit code 1 was not tried"
[[ ! -e all ]] || wrong "merged before all was there"
scancel "$merge"

echo "the three are submitted again alone"
again=()
for task in 1 2 3; do
    again+=("$(sbatch --parsable --array="$task" shards.sh)")
done
dependency=afterok:$(IFS=:; echo "${again[*]}")
# The line of the recipe that merges, after other jobs.
sed -n '/^sbatch .*merge/p' submit.sh | sed 's/afterok:$shards/$dependency/' >merge.sh
export dependency
bash ./merge.sh >merged.txt
merge=$(grep -o '[0-9]*$' merged.txt)
until_true 200 is_state "$merge" COMPLETED || wrong "the merge: $(state "$merge")"
for task in 1 2 3; do
    [[ $(runs "$task") -eq $each ]] || wrong "task $task has $(runs "$task") runs"
    whole=$(grep -c '}$' "before-$task.jsonl" || true)
    cmp -s <(head -n "$whole" "before-$task.jsonl") <(head -n "$whole" "shards/$task/runs.jsonl") ||
        wrong "task $task did not go on where it stopped"
done

echo "the same in one piece"
hilrig campaign scenarios/*.toml --seeds "$seeds" --vary all --out one >one.txt 2>&1 ||
    [ $? -eq 1 ]
for file in campaign.json campaign.html plan.json; do
    cmp "one/$file" "all/$file" || wrong "$file differs"
done
diff -r one/groups all/groups || wrong "the smallest cases differ"
diff -r one/cases all/cases || wrong "the cases differ"
cmp <(sort one/runs.jsonl) <(sort all/runs.jsonl) || wrong "the runs differ"
echo "merged, it is the campaign in one piece: $(head -n 1 one.txt)"
