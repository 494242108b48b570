#!/usr/bin/env bash
# Proves that protocols and firmware_core need neither std nor heap, and that the robot fits its
# board's RAM.
#
#   1. host:   a library without std, with its own panic handler and no allocator, builds;
#   2. teeth:  the same library with std, and with a heap, does not;
#   3. target: it builds for the Cortex-M4F of the seed's board, an STM32F407, and links into its
#              128 KiB of RAM;
#   4. stack:  the robot at work needs at most the 64 KiB of core-coupled RAM beside it;
#   5. cycles: the search's inner loop takes no more than the model of the processor says.
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
# What a program does on a PC is no part of the board's.
must_fail mutant_host 'no global memory allocator found'

[[ ${1:-} == --host ]] && exit 0

# The toolchain's own target if rustup has it or can fetch it; else Debian's compiler, which comes
# with the source of its library. That source fits no other compiler.
if rustup target list --installed 2>/dev/null | grep -qx $target ||
    timeout 120 rustup target add $target >/dev/null 2>&1; then
    toolchain=(env)
    build_std=()
else
    say "rustup cannot fetch $target: using Debian's rustc-web and its library source"
    if ! dpkg -s rustc-web rust-web-src >/dev/null 2>&1; then
        apt-get update -qq
        DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends \
            rustc-web rust-web-src >/dev/null || die "cannot install rustc-web and rust-web-src"
    fi
    debian_rustc=$(dpkg -L rustc-web | grep -m1 'bin/rustc$')
    toolchain=(env RUSTC="$debian_rustc")
    build_std=(-Z build-std=core)
fi
say "library for $target"
# The compiler tells the stack frame of each function only to those who ask for the unstable.
RUSTC_BOOTSTRAP=1 "${toolchain[@]}" cargo rustc --quiet --locked --release --target $target \
    "${build_std[@]}" -- -Z emit-stack-sizes

sysroot=$(rustc --print sysroot)
linker=$(find "$sysroot/lib/rustlib" -name rust-lld -print -quit)
[[ -n $linker ]] || die "no rust-lld below $sysroot"
out=$CARGO_TARGET_DIR/$target/release
say "image with 128 KiB of RAM"
"$linker" -flavor gnu -T board.ld --gc-sections "$out/libbare_metal.a" -o "$out/robot.elf" ||
    die "the robot does not fit its board"

# Without the robot in it, an image fits any board.
command -v readelf >/dev/null || die "readelf is missing (package binutils)"
symbols=$(readelf -sW "$out/robot.elf")
robot=$(($(awk '$8 == "ROBOT" { print $3 }' <<<"$symbols")))
[[ $robot -gt 0 ]] || die "the image does not hold the robot"

# The frame of each function that was not inlined, as its address (four bytes) and size (LEB128).
read -r _ _ offset size _ < <(readelf -SW "$out/robot.elf" | sed -n 's/.*\.stack_sizes//p')
frames=$(od -An -v -tu1 -w1 -j $((16#$offset)) -N $((16#$size)) "$out/robot.elf" | awk '
    at < 4 { address += $1 * 256 ^ at++; next }
    { size += $1 % 128 * 128 ^ digit++ }
    $1 < 128 { print address - address % 2, size; at = address = size = digit = 0 }')
frame_of() {
    local address
    address=$(awk -v name="$1" '$8 == name { print $2 }' <<<"$symbols")
    awk -v address=$((16#$address & ~1)) '$1 == address { print $2 }' <<<"$frames"
}

# Nothing recurses, so no chain of calls takes more than all frames together: coarse, but sound.
# Not counted: the codecs' exercise, which no robot calls.
codecs=$(frame_of decode_everything)
stack=$(awk -v sum=-"$codecs" '{ sum += $2 } END { print sum }' <<<"$frames")
largest=$(awk '{ print $2 }' <<<"$frames" | sort -n | tail -1)
printf 'static  %7d of %d bytes\n' $robot $((128 * 1024))
printf 'stack   %7d of %d bytes at most, %d in the largest frame\n' \
    "$stack" $((64 * 1024)) "$largest"
((stack <= 64 * 1024)) || die "the stack does not fit"

# A loop's cycles on a Cortex-M4 without wait states: one an instruction, one more for each access
# to memory (none of them pipelined), three for the jumps. The largest loop with UXTB16, which adds
# two sums at a time, is the row kernel: it is in here only if the portable form is the one built.
if command -v llvm-objdump >/dev/null; then
    kernel=$(awk '$8 ~ /4slam3row4sums$/ { print $8 }' <<<"$symbols")
    [[ -n $kernel ]] || die "the image does not hold the row kernel"
    read -r instructions accesses < <(llvm-objdump -d --no-show-raw-insn \
        --disassemble-symbols="$kernel" "$out/robot.elf" | awk '
        $1 ~ /^[0-9a-f]+:$/ {
            at[++n] = substr($1, 1, length($1) - 1); name[n] = $2
            if (match($0, /0x[0-9a-f]+ </)) target[n] = substr($0, RSTART + 2, RLENGTH - 4)
        }
        END {
            for (i = 1; i <= n; i++) {
                if (name[i] !~ /^b/ || target[i] == "" || target[i] "" > at[i] "") continue
                count = memory = found = 0
                for (j = 1; j <= i; j++) {
                    if (at[j] "" < target[i] "") continue
                    count++
                    memory += name[j] ~ /^(ldr|str)/
                    found += name[j] ~ /^uxtb16/
                }
                if (found && count > best) { best = count; accesses = memory }
            }
            print best + 0, accesses + 0
        }')
    cycles=$((instructions + accesses + 3))
    model=$(awk '/^const CYCLES_PER_ROW/ { print $5 + 0 }' ../../firmware_core/src/slam/effort.rs)
    printf 'search  %7d cycles a point and row of 32 poses (%d instructions, %d accesses), %d in the model\n' \
        "$cycles" "$instructions" "$accesses" "$model"
    ((instructions > 0 && cycles <= model)) || die "the model of the processor is too fast"
else
    say "skipped: llvm-objdump is missing (package llvm), the inner loop is not counted"
fi
