#!/usr/bin/env bash
# Proves that protocols and firmware_core need neither std nor heap, and that the robot fits the
# RAM of its board.
#
#   1. host:   a library without std, with its own panic handler and no allocator, builds;
#   2. teeth:  the same library with std, and with a heap, does not;
#   3. target: it builds for the Cortex-M4F of the seed's board and links into 128 KiB of RAM.
#
# usage: tests/bare_metal/prove.sh [--host]      --host: steps 1 and 2 only
set -euo pipefail
cd "$(dirname "$0")"

target=thumbv7em-none-eabihf
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-../../target}/bare_metal"

say() { printf '== bare metal: %s\n' "$*"; }
die() { printf 'bare metal: %s\n' "$*" >&2; exit 1; }

say "host library without std and heap"
cargo build --quiet --locked

# A mutant that fails for another reason than its sin would prove nothing.
must_fail() {
    local feature=$1 reason=$2 output
    if output=$(cargo build --quiet --locked --features "$feature" 2>&1); then
        die "$feature builds: this proof has no teeth"
    fi
    grep -qF "$reason" <<<"$output" || die "$feature fails for another reason: $output"
}
say "with std, and with a heap, it must not build"
must_fail mutant_std 'duplicate lang item `panic_impl`'
must_fail mutant_heap 'no global memory allocator found'

[[ ${1:-} == --host ]] && exit 0

# The toolchain's own target if rustup has it or can fetch it; else Debian's compiler, which comes
# with the source of its library. That source fits no other compiler.
if rustup target list --installed 2>/dev/null | grep -qx $target ||
    timeout 120 rustup target add $target >/dev/null 2>&1; then
    build=(cargo build --quiet --locked --release --target $target)
else
    say "rustup cannot fetch $target: using Debian's rustc-web and its library source"
    if ! dpkg -s rustc-web rust-web-src >/dev/null 2>&1; then
        apt-get update -qq
        DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends \
            rustc-web rust-web-src >/dev/null || die "cannot install rustc-web and rust-web-src"
    fi
    debian_rustc=$(dpkg -L rustc-web | grep -m1 'bin/rustc$')
    build=(env RUSTC="$debian_rustc" RUSTC_BOOTSTRAP=1
        cargo build --quiet --locked --release --target $target -Z build-std=core)
fi
say "library for $target"
"${build[@]}"

sysroot=$(rustc --print sysroot)
linker=$(find "$sysroot/lib/rustlib" -name rust-lld -print -quit)
[[ -n $linker ]] || die "no rust-lld below $sysroot"
out=$CARGO_TARGET_DIR/$target/release
say "image with 128 KiB of RAM"
"$linker" -flavor gnu -T board.ld --gc-sections "$out/libbare_metal.a" -o "$out/robot.elf" ||
    die "the robot does not fit its board"

# Without the robot in it, an image fits any board.
command -v readelf >/dev/null || die "readelf is missing (package binutils)"
robot=$(readelf -sW "$out/robot.elf" | awk '$8 == "ROBOT" { print $3 }')
[[ -n $robot ]] || die "the image does not hold the robot"
printf 'static RAM of the robot: %d of %d bytes\n' "$((robot))" $((128 * 1024))
