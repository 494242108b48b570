#!/usr/bin/env bash
# The checks of this repository. The first that fails ends the run.
#
# usage: bash tests/run.sh [--all] [--seeds] [--since REV]
#
#   (nothing)     the checks of each landing: format, lints, the tests of the workspace but those of
#                 tests/long.txt, examples, the package for Python, the demo
#   --since REV   also the proofs and long tests whose files changed since REV
#   --all         also all long tests and all proofs: docs of the crates, bare metal, portable
#                 builds, coverage, a release beside other builds, simulated microcontrollers,
#                 clients of other languages, drivers with a defect, sessions of public drivers, a
#                 robot in a crate of its own; half an hour on two processors
#   --seeds       all seeds and cases of the tests, and not only the first ones
#
# What none of them runs, because it takes longer or needs a cluster: tests/mutants.sh,
# tests/browser/run.sh, tests/slurm/run.sh, tests/kubernetes/run.sh, tests/ci/run.sh,
# tests/exec/many.sh, tests/exec/generated.sh, tests/fuzz_programs/run.sh, tests/large/prove.sh; and
# what needs sources from GitHub: tests/avr_base/run.sh, tests/lidar_clients/vendor.sh.
#
# Needs Debian 12 and Rust 1.95 by rustup; installs what else is missing.
set -euo pipefail
cd "$(dirname "$0")/.."

all=false seeds=false since=
while [[ $# -gt 0 ]]; do
    case $1 in
    --all) all=true ;;
    --seeds) seeds=true ;;
    --since)
        since=${2:?tests/run.sh: --since needs a revision}
        git rev-parse --quiet --verify "$since^{commit}" >/dev/null || {
            echo "tests/run.sh: --since $since: unknown revision" >&2
            exit 2
        }
        shift
        ;;
    *)
        sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "$0" >&2
        exit 2
        ;;
    esac
    shift
done

# Tests of many seeds or generated cases run their beginning, or all of it.
if $seeds; then export HILRIG_TESTS=all; fi

# Steps and their seconds, for the table at the end.
steps=() seconds=()
begun=$SECONDS
step() {
    finish_step
    steps+=("$*")
    begun=$SECONDS
    printf '\n== [%4d s] %s\n' "$SECONDS" "$*"
}
finish_step() { [[ ${#steps[@]} -eq ${#seconds[@]} ]] || seconds+=($((SECONDS - begun))); }

# proof PATH..: whether the proof of these paths is to run.
proof() { $all || { [[ -n $since ]] && ! git diff --quiet "$since" -- "$@"; }; }

# apt PACKAGE..: what this machine lacks. As root in a container there is no sudo, and no need.
install() {
    local as_root=()
    [[ $EUID -eq 0 ]] || as_root=(sudo)
    "${as_root[@]}" apt-get update -qq
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -qq -y --no-install-recommends "$@" >/dev/null
}

step "what is needed"
command -v cargo >/dev/null || {
    echo "tests/run.sh: cargo is missing; install Rust 1.95 with rustup" >&2
    exit 1
}
missing=()
command -v cc >/dev/null && command -v readelf >/dev/null || missing+=(gcc libc6-dev binutils)
# Judges our captures; without it CI fails and others skip that test, saying so.
command -v tshark >/dev/null || missing+=(tshark)
# A page that no browser has shown is not tested; CI fails without one.
command -v chromium >/dev/null && command -v chromedriver >/dev/null ||
    missing+=(chromium chromium-driver)
# Write the dumps that the importers are tested with.
for tool in socat jpnevulator sigrok-cli tio strace hexyl xxd zip; do
    command -v "$tool" >/dev/null || missing+=("$tool")
done
command -v hexdump >/dev/null || missing+=(bsdextrautils)
# Holds programs in virtual time.
command -v gdb >/dev/null || missing+=(gdb)
if proof emulators protocols tests/simavr; then
    # Compile and simulate sketches for an ATmega2560, whose chips are ours.
    command -v avr-g++ >/dev/null && [[ -f /usr/include/simavr/sim_avr.h ]] ||
        missing+=(gcc-avr avr-libc arduino-core-avr libsimavr-dev libelf-dev)
fi
if proof nodes boards protocols emulators crates src tests/firmware; then
    command -v avr-g++ >/dev/null && [[ -f /usr/include/simavr/sim_avr.h ]] &&
        [[ -d /usr/share/arduino/hardware/mighty-1284p ]] ||
        missing+=(gcc-avr avr-libc arduino-core-avr arduino-mighty-1284p libsimavr-dev libelf-dev)
fi
if proof nodes boards protocols emulators firmware_core crates src scenarios tests/bare_metal \
    tests/cortex_m4 tests/firmware; then
    # Runs the robots' programs on a Cortex-M4.
    command -v qemu-system-arm >/dev/null && command -v arm-none-eabi-gcc >/dev/null ||
        missing+=(qemu-system-arm gcc-arm-none-eabi)
fi
if proof crates src devices tests/devices; then
    # Reads the described receiver.
    command -v gpsd >/dev/null && command -v gpspipe >/dev/null || missing+=(gpsd gpsd-clients)
fi
if proof python nodes crates tests/bridges; then
    # A node of ROS 1 reads a bridge.
    python3_rospy=/usr/lib/python3/dist-packages
    [[ -d $python3_rospy/rospy && -d $python3_rospy/sensor_msgs && -d $python3_rospy/nav_msgs &&
        -d $python3_rospy/tf2_msgs ]] &&
        command -v rosmaster >/dev/null ||
        missing+=(ros-core python3-rospy python3-rosmaster python3-sensor-msgs
            python3-nav-msgs python3-tf2-msgs)
fi
if proof protocols emulators crates tests/osc_clients; then
    # Drives the model car.
    command -v oscsend >/dev/null || missing+=(liblo-tools)
fi
if proof protocols fuzz tests/corpus tests/coverage.sh; then
    # Reads what the instrumented replay of the corpus writes.
    command -v llvm-cov-19 >/dev/null || missing+=(llvm-19)
fi
python3 -c 'import venv, ensurepip' 2>/dev/null || missing+=(python3-venv)
[[ ${#missing[@]} -eq 0 ]] || install "${missing[@]}"
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
# The interpreter itself: a manager of versions puts a script in front of it, which runs several
# shells, and the tests start hundreds. A virtual environment has its own.
if [[ -z ${VIRTUAL_ENV:-} ]]; then
    mkdir -p "$target/python"
    ln -sf "$(python3 -c 'import sys; print(sys.executable)')" "$target/python/python3"
    PATH=$target/python:$PATH
fi
# Read what is exported; pip has them, Debian 12 does not.
[[ -x $target/tools/bin/evo_ape ]] || {
    python3 -m venv "$target/tools" && "$target/tools/bin/pip" install -q mcap==1.6.0 evo==1.38.1
} &
readers=$!
# A port is watched by inotify, of which a user has 128 instances. Tests run side by side need more.
instances=/proc/sys/fs/inotify/max_user_instances
if [[ -w $instances && $(<$instances) -lt 1024 ]]; then echo 1024 >$instances; fi
cargo fmt --version >/dev/null 2>&1 || rustup component add rustfmt
cargo clippy --version >/dev/null 2>&1 || rustup component add clippy
cargo --version

step "format"
cargo fmt --all --check
rustfmt --edition 2024 --check tests/bare_metal/src/lib.rs tests/every_build/src/main.rs \
    tests/ray_oracle/src/lib.rs tests/ray_oracle/tests/rays.rs tests/ray_oracle/benches/ray_cast.rs \
    tests/outside/src/lib.rs tests/outside/tests/*.rs tests/outside/drivers/tests/*.rs \
    tests/lidar_clients/rust/src/main.rs \
    tests/mutants/src/main.rs \
    fuzz/src/lib.rs fuzz/src/bin/corpus.rs \
    fuzz/fuzz_targets/*.rs
# Crates beside the workspace have versions of their own, which a new dependency of ours changes;
# most of them are built with --all only. The check asks the registry, beside the compiler.
locked() {
    local folder
    for folder in fuzz nodes/cortex-m4 tests/*/ tests/*/*/; do
        [[ -f $folder/Cargo.lock ]] || continue
        (cd "$folder" && cargo update --quiet --workspace --locked) || {
            echo "tests/run.sh: $folder/Cargo.lock is old: cd $folder && cargo update --workspace" >&2
            return 1
        }
    done
}
locked &
locks=$!

# Clippy's driver is the compiler with the lints: the build of the tests is the pass of the lints,
# too. A pass of its own checks each crate of the registry once more.
CLIPPY_DRIVER=$(rustc --print sysroot)/bin/clippy-driver
export CLIPPY_DRIVER
denied=-D__CLIPPY_HACKERY__warnings__CLIPPY_HACKERY__
step "a lint is an error"
# Cargo passes lints to Clippy in this variable, which is not documented: a planted lint shows that
# it works.
planted=$target/planted
mkdir -p "$planted"
echo 'fn main() { let _ = 1 == 1; }' >"$planted/main.rs"
if CLIPPY_ARGS=$denied tests/compiler.sh rustc --emit=metadata --out-dir "$planted" "$planted/main.rs" \
    2>"$planted/log" || ! grep -q clippy::eq_op "$planted/log"; then
    cat "$planted/log" >&2
    echo "tests/run.sh: $CLIPPY_DRIVER lets a planted lint pass" >&2
    exit 1
fi

step "compiling the tests, with lints"
# By an option and not in the environment: tests that call Cargo get the compiler itself.
wrapper="build.rustc-workspace-wrapper='$PWD/tests/compiler.sh'"
tests() { CLIPPY_ARGS=$denied cargo --config "$wrapper" test --locked --workspace "$@"; }
tests --no-run
wait "$readers"
wait "$locks"

step "tests"
# The same cases on every run: a check that is red today and green tomorrow judges no change.
# Other cases: PROPTEST_RNG_SEED=N bash tests/run.sh, and `hilrig fuzz` for as long as one likes.
export PROPTEST_RNG_SEED=${PROPTEST_RNG_SEED:-1}
# An eighth of them without --seeds.
$seeds || export PROPTEST_CASES=${PROPTEST_CASES:-32}
# These wait for browsers, ports and programs most of their time, some of them in real time; the
# others compute. What computes yields to what waits: two processors are never idle, and nothing
# that runs in real time is late.
waiting=(cli exec page replay transport)
# Tests that a landing leaves out.
skipped=()
while read -r paths name; do
    # shellcheck disable=SC2086 # Paths with spaces between.
    [[ -z $paths || $paths == \#* ]] || proof ${paths//,/ } || skipped+=(--skip "$name")
done <tests/long.txt
names='import json, sys
targets = [t for p in json.load(sys.stdin)["packages"] for t in p["targets"] if t["kind"] == ["test"]]
print("\n".join(sorted({t["name"] for t in targets} - set(sys.argv[1:]))))'
cargo metadata --locked --no-deps --format-version 1 |
    python3 -c "$names" "${waiting[@]}" >"$target/computing"
computing() {
    renice -n 10 -p "$BASHPID" >/dev/null
    # shellcheck disable=SC2046 # One name a line.
    tests --no-fail-fast $(sed 's/^/--test /' "$target/computing") -- "${skipped[@]}"
}
units() {
    renice -n 10 -p "$BASHPID" >/dev/null
    tests --no-fail-fast --lib --bins -- "${skipped[@]}"
    tests --doc
}
pages() {
    # Twice as many threads as by default on two processors: most of them wait.
    RUST_TEST_THREADS=${RUST_TEST_THREADS:-4} tests --no-fail-fast --test cli --test page --test replay \
        --test transport -- "${skipped[@]}"
}
built=$target/debug
# Programs in virtual time. Then what users run: the examples, the package for Python, the programs
# of the docs, the described devices as pip's drivers read them, the demo. All of it is built by the
# tests.
programs() {
    tests --no-fail-fast --test exec -- "${skipped[@]}"
    for example in examples/*.rs; do
        # A client of a rig, for tests/exec/many.sh.
        [[ $example == examples/rust_client.rs ]] ||
            "$built/examples/$(basename "$example" .rs)" >/dev/null
    done
    CARGO_TARGET_DIR=$target HILRIG=$built/hilrig bash python/run.sh
    CARGO_TARGET_DIR=$target HILRIG=$built/hilrig bash tests/devices/run.sh
    "$built/hilrig" demo --out "$target/demo/tests"
}
lanes=(pages programs computing units)
lane() {
    "$1"
    echo "== $1: $SECONDS s"
}
# Each in a process group of its own, which ends with this script.
set -m
begun_lanes=()
for name in "${lanes[@]}"; do
    lane "$name" >"$target/$name.log" 2>&1 &
    begun_lanes+=("$!")
done
set +m
trap 'kill -- "${begun_lanes[@]/#/-}" 2>/dev/null || true' EXIT
tail -n +1 -q -f --pid="${begun_lanes[0]}" "$target/${lanes[0]}.log" &
shown=$!
failed=()
for lane in "${!lanes[@]}"; do
    wait "${begun_lanes[$lane]}" || failed+=("$target/${lanes[$lane]}.log")
done
trap - EXIT
wait "$shown" || true
for name in "${lanes[@]:1}"; do cat "$target/$name.log"; done
if [[ ${#failed[@]} -ne 0 ]]; then
    # Once more what failed: some readers see only the end of a log.
    printf '\n== what failed\n'
    sed -n '/^failures:$/,/^test result/p; /^error/p' "${failed[@]}"
    for log in "${failed[@]}"; do tail -n 40 "$log"; done
    exit 1
fi

# Two proofs run at a time: most of them leave a processor idle while they compile one crate, load
# packages, or wait for a program. What they print is shown when they end.
finish_step
logs=$target/proofs
mkdir -p "$logs"
declare -A proof_of=() proof_begun=()
stop_proofs() { for pid in "${!proof_of[@]}"; do kill -- "-$pid" 2>/dev/null || true; done; }
trap stop_proofs EXIT
# settle COUNT: waits until at most COUNT proofs run.
settle() {
    local pid code
    while [[ ${#proof_of[@]} -gt $1 ]]; do
        sleep 0.5
        for pid in "${!proof_of[@]}"; do
            if kill -0 "$pid" 2>/dev/null; then continue; fi
            code=0
            wait "$pid" || code=$?
            steps+=("${proof_of[$pid]}")
            seconds+=($((SECONDS - proof_begun[$pid])))
            printf '\n== [%4d s] %s: %d s\n' "$SECONDS" "${steps[-1]}" "${seconds[-1]}"
            cat "$logs/$pid.log"
            unset "proof_of[$pid]" "proof_begun[$pid]"
            if [[ $code -ne 0 ]]; then
                echo "tests/run.sh: ${steps[-1]}: failed, code $code" >&2
                exit 1
            fi
        done
    done
}
# prove NAME FUNCTION: runs a proof beside another one.
prove() {
    settle 1
    set -m
    (
        exec >"$logs/$BASHPID.log" 2>&1 </dev/null
        export CARGO_TARGET_DIR=$target HILRIG=$built/hilrig
        set -e
        "$2"
    ) &
    set +m
    proof_of[$!]=$1 proof_begun[$!]=$SECONDS
}

release() {
    rm -f "$target/release.done"
    cargo build --locked --release 2> >(tee "$target/release.log" >&2)
    if grep -A9 '^warning: ' "$target/release.log"; then return 1; fi
    touch "$target/release.done"
}
# Proofs that need the release wait for it: it is the first one.
released() { until [[ -e $target/release.done ]]; do sleep 1; done; }
figures() {
    released
    "$target"/release/hilrig experiment --all --out "$target/experiments"
    cmp docs/experiments.md "$target/experiments/experiments.md"
    "$target"/release/hilrig experiment --all --planted --out "$target/experiments/planted"
}
planted_defects() {
    local found=$target/planted-defects.md
    released
    sed '/^| check/,$d' docs/planted-defects.md >"$found"
    "$target"/release/hilrig campaign scenarios/*.toml scenarios/worlds/*.toml --mutants \
        --profile harsh --seeds 140000..140003 --markdown >>"$found"
    cmp docs/planted-defects.md "$found"
}
docs() { RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --no-deps --quiet; }
lints() {
    cargo clippy --locked -p hilrig-demo -- -D warnings
    cargo clippy --locked --no-default-features --lib -- -D warnings
    cargo clippy --locked -p hilrig-firmware --features host,large -- -D warnings
    # On stable. Nothing is linked, so libFuzzer's C++ is not compiled: it is said to be there.
    CUSTOM_LIBFUZZER_PATH=/dev/null \
        cargo clippy --locked --manifest-path fuzz/Cargo.toml --all-targets -- -D warnings
}
licences() {
    # Two minutes of compiling, once a machine.
    if command -v cargo-deny >/dev/null || cargo install --quiet --locked cargo-deny; then
        cargo deny --all-features check bans licenses sources
    else
        echo "SKIPPED: cargo-deny cannot be installed; the licences are not checked" >&2
    fi
}
coverage() { bash tests/coverage.sh; }
every_build() { bash tests/every_build/prove.sh; }
bare_metal() { bash tests/bare_metal/prove.sh; }
rays() { bash tests/ray_oracle/prove.sh; }
benches() { tests --benches --no-run; }
osc_clients() { bash tests/osc_clients/run.sh; }
bridges() { bash tests/bridges/run.sh; }
i2c_clients() { bash tests/i2c_clients/run.sh; }
simavr() { bash tests/simavr/run.sh; }
firmware() { bash tests/firmware/run.sh; }
cortex_m4() { bash tests/cortex_m4/run.sh; }
lidar_clients() { TELEMETRY=$built/examples/telemetry bash tests/lidar_clients/run.sh; }
drivers() { python3 tests/drivers/prove.py --seeds 20; }
public_drivers() { bash tests/replay/public_drivers/run.sh; }
devices() { bash tests/devices/run.sh --all; }
public_programs() { bash tests/exec/public_programs/run.sh --runs 2; }
hostile() { python3 tests/exec/hostile/prove.py; }
outside() { bash tests/outside/run.sh; }

# The longest first.
rm -f "$target/release.done"
if proof protocols emulators firmware_core crates src scenarios; then
    prove "a release" release
fi
if proof crates src devices tests/devices; then
    prove "the described devices: fuzzed, their table, the trophies, other means" devices
fi
if $all; then
    prove "public programs in virtual time" public_programs
fi
if proof crates/realtime src tests/exec/hostile; then
    prove "programs that attack their supervisor" hostile
fi
if proof protocols emulators firmware_core crates src; then
    prove "the figures of the reports: the page, and each row with its planted change" figures
fi
if proof Cargo.lock deny.toml; then
    prove "licences and sources of the dependencies" licences
fi
if proof nodes boards protocols emulators crates src tests/firmware; then
    prove "firmware without a board: sketches in simavr, as programs and as a device" firmware
fi
if proof crates src examples tests/outside; then
    prove "a robot, drivers and the examples in crates of their own" outside
fi
if proof protocols emulators firmware_core crates/engine crates/search crates/museum scenarios; then
    prove "the planted defects that harsh campaigns find: the page" planted_defects
fi
if proof nodes boards protocols emulators firmware_core crates src scenarios tests/bare_metal \
    tests/cortex_m4 tests/firmware; then
    prove "the robots' programs on a Cortex-M4 in QEMU, byte for byte" cortex_m4
fi
if proof Cargo.toml protocols emulators firmware_core crates src fuzz; then
    prove "the docs of the crates" docs
    prove "lints of other features: the demo, the library of another crate's test, coverage-guided targets" \
        lints
fi
if proof emulators/src/world tests/ray_oracle; then
    prove "the world's rays, judged by parry2d" rays
fi
if proof protocols emulators crates tests/lidar_clients; then
    prove "the lidar and the telemetry, judged by what pip and cargo give" lidar_clients
fi
if proof crates src tests/drivers; then
    prove "drivers with a defect: causes and cases over twenty seeds" drivers
fi
if proof crates/capture crates/realtime src tests/replay/public_drivers; then
    prove "sessions of public drivers, replayed to them" public_drivers
fi
if proof python nodes crates tests/bridges; then
    prove "bridges to Foxglove, ROS 1 and ROS 2, each with a reader" bridges
fi
if proof protocols firmware_core tests/bare_metal; then
    prove "bare metal: no std, no heap, 128 KiB" bare_metal
fi
if proof emulators protocols tests/simavr; then
    prove "chips on the bus of a simulated microcontroller" simavr
fi
if proof firmware_core tests/every_build; then
    prove "the mapper is the same in every build" every_build
fi
if proof protocols fuzz tests/corpus tests/coverage.sh; then
    prove "coverage of the decoders by the corpus" coverage
fi
if proof protocols emulators crates tests/osc_clients; then
    prove "the model car, driven by what pip and Debian give" osc_clients
fi
if proof Cargo.toml protocols emulators firmware_core crates src benches; then
    prove "the benches, with lints" benches
fi
if proof protocols emulators crates tests/i2c_clients; then
    prove "chips on I2C, read by the calls of smbus2" i2c_clients
fi
settle 0
trap - EXIT
if proof protocols emulators firmware_core crates src; then
    step "the demo: the builds of the tests, of a release and of a fresh clone give the same bytes"
    "$target"/release/hilrig demo --out "$target/demo/release" >/dev/null 2>&1
    # Takes the place of the tests' build, which is not needed any more.
    cargo demo --out "$target/demo/clone"
    for build in tests release; do
        for file in case.toml map.pgm; do
            cmp "$target/demo/$build/$file" "$target/demo/clone/$file"
        done
    done
fi

finish_step
printf '\n%8s  %s\n' seconds step
for i in "${!steps[@]}"; do printf '%8d  %s\n' "${seconds[i]}" "${steps[i]}"; done
printf '%8d  %s\n' "$SECONDS" "all checks passed"
$all || echo "not run: $((${#skipped[@]} / 2)) long tests (tests/long.txt) and the proofs of --all" \
    "(bash tests/run.sh --help)"
$seeds || echo "not run: most seeds and cases of some tests (--seeds)"
