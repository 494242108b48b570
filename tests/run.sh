#!/usr/bin/env bash
# Every check of this repository, cheapest first; the first that fails ends the run.
#
# usage: bash tests/run.sh
#
# Needs Debian 12 and Rust 1.95 by rustup; installs what else is missing. From nothing it takes
# some twenty minutes on two cores, most of them spent compiling.
set -euo pipefail
cd "$(dirname "$0")/.."

started=$SECONDS
step() { printf '\n== [%4d s] %s\n' $((SECONDS - started)) "$*"; }

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
command -v cc >/dev/null && command -v readelf >/dev/null || install gcc libc6-dev binutils
# Judges our captures; without it CI fails and others skip that test, saying so.
command -v tshark >/dev/null || install tshark
# A page that no browser has shown is not tested; CI fails without one.
command -v chromium >/dev/null && command -v chromedriver >/dev/null ||
    install chromium chromium-driver
# Write the dumps that the importers are tested with.
for tool in socat jpnevulator sigrok-cli tio; do
    command -v "$tool" >/dev/null || install "$tool"
done
# Compile and simulate sketches for an ATmega2560, whose chips are ours.
command -v avr-g++ >/dev/null && [[ -f /usr/include/simavr/sim_avr.h ]] ||
    install gcc-avr avr-libc arduino-core-avr libsimavr-dev libelf-dev
# Drives the model car.
command -v oscsend >/dev/null || install liblo-tools
# Reads what the instrumented replay of the corpus writes.
command -v llvm-cov-19 >/dev/null || install llvm-19
# Read what is exported; pip has them, Debian 12 does not.
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
[[ -x $target/tools/bin/evo_ape ]] || {
    python3 -m venv "$target/tools" 2>/dev/null || {
        install python3-venv
        python3 -m venv "$target/tools"
    }
    "$target/tools/bin/pip" install -q mcap==1.6.0 evo==1.38.1
}
cargo fmt --version >/dev/null 2>&1 || rustup component add rustfmt
cargo clippy --version >/dev/null 2>&1 || rustup component add clippy
cargo --version

step "format"
cargo fmt --all --check
rustfmt --edition 2024 --check tests/bare_metal/src/lib.rs tests/every_build/src/main.rs \
    tests/outside/src/lib.rs tests/outside/tests/*.rs tests/lidar_clients/rust/src/main.rs \
    tests/mutants/src/main.rs \
    fuzz/src/lib.rs fuzz/src/bin/corpus.rs \
    fuzz/fuzz_targets/*.rs

step "bare metal: no std, no heap, 128 KiB"
bash tests/bare_metal/prove.sh

step "the mapper is the same in every build"
bash tests/every_build/prove.sh

step "coverage of the decoders by the corpus"
bash tests/coverage.sh

step "compiling the tests"
cargo test --locked --workspace --no-run

# The tests wait for ports and browsers half of their time. What only needs the processor is done
# then, and gives way. (Not at idle priority: whoever gets no turn at all may hold a lock.)
lints_and_builds() {
    renice -n 10 "$BASHPID"
    step "lints"
    cargo clippy --locked --workspace --all-targets -- -D warnings
    cargo clippy --locked -p hilrig-firmware --features host,large -- -D warnings
    # The coverage-guided targets, on stable. Nothing is linked, so libFuzzer's C++ is not
    # compiled: it is said to be there already.
    CUSTOM_LIBFUZZER_PATH=/dev/null CARGO_TARGET_DIR=$target \
        cargo clippy --locked --manifest-path fuzz/Cargo.toml --all-targets -- -D warnings
    step "docs"
    RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --no-deps --quiet
    step "compiling the robot in a crate of its own"
    CARGO_TARGET_DIR=$target cargo test --locked --manifest-path tests/outside/Cargo.toml --no-run
    step "compiling a release"
    # Without the page and MCAP, which have no part in it and take two minutes to compile.
    cargo build --locked --release --no-default-features 2> >(tee "$target/demo.log" >&2)
    ! grep -A9 '^warning: ' "$target/demo.log"
}
beside=$target/beside.log
# A process group of its own, which ends with this script.
set -m
(lints_and_builds) >"$beside" 2>&1 &
builds=$!
set +m
trap 'kill -- -"$builds" 2>/dev/null || true' EXIT

step "tests"
# The same cases on every run: a check that is red today and green tomorrow judges nobody's change.
# Other cases: PROPTEST_RNG_SEED=N bash tests/run.sh, and `hilrig fuzz` for as long as one likes.
PROPTEST_RNG_SEED=${PROPTEST_RNG_SEED:-1} cargo test --locked --workspace

step "examples"
# Built by the tests. One is a client of a rig, for tests/exec/many.sh.
for example in examples/*.rs; do
    [[ $example == examples/rust_client.rs ]] && continue
    "$target/debug/examples/$(basename "$example" .rs)" >/dev/null
done

built=$target/debug
step "the package for Python, and the programs of the docs"
CARGO_TARGET_DIR=$target HILRIG=$built/hilrig bash python/run.sh

step "the model car, driven by what pip and Debian give"
CARGO_TARGET_DIR=$target HILRIG=$built/hilrig bash tests/osc_clients/run.sh

step "chips on the bus of a simulated microcontroller"
CARGO_TARGET_DIR=$target bash tests/simavr/run.sh

step "what was linted and compiled beside the tests"
status=0
wait "$builds" || status=$?
trap - EXIT
cat "$beside"
[[ $status -eq 0 ]] || exit "$status"

# With nothing beside them: these clients read for minutes without a pause, and must not be late.
step "the lidar and the telemetry, judged by what pip and cargo give"
CARGO_TARGET_DIR=$target HILRIG=$built/hilrig TELEMETRY=$built/examples/telemetry \
    bash tests/lidar_clients/run.sh

step "a robot in a crate of its own"
CARGO_TARGET_DIR=$target bash tests/outside/run.sh

step "the demo: the builds of the tests, of a release and of a fresh clone give the same bytes"
"$target"/debug/hilrig demo --out target/demo/tests >/dev/null 2>&1
"$target"/release/hilrig demo --out target/demo/release >/dev/null 2>&1
# Takes the place of the tests' build, which nobody needs any more.
cargo run --locked --no-default-features -- demo --out target/demo/clone
for build in tests release; do
    for file in case.toml map.pgm; do
        cmp "target/demo/$build/$file" "target/demo/clone/$file"
    done
done

step "all checks passed"
