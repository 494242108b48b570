#!/usr/bin/env bash
# Proves that protocols and firmware_core need neither std nor heap, and that each robot whose
# program runs on a microcontroller fits its board's RAM.
#
#   1. host:   a library without std, with its own panic handler and no allocator, builds;
#   2. teeth:  the same library with std, and with a heap, does not;
#   3. target: it builds for the Cortex-M4F of the robots' boards and links into 128 KiB of RAM;
#   4. stack:  the robot at work needs at most what its board has for it: of the STM32F407 (rescue)
#              64 KiB of core-coupled RAM, of the STM32F446 (yellow) what is left of the 128 KiB;
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

# shellcheck source=toolchain.sh
source toolchain.sh
sysroot=$(rustc --print sysroot)
linker=$(find "$sysroot/lib/rustlib" -name rust-lld -print -quit)
[[ -n $linker ]] || die "no rust-lld below $sysroot"
command -v readelf >/dev/null || die "readelf is missing (package binutils)"
ram=$((128 * 1024))

# Builds the image of a robot and measures it; its stack may take `stack_max` bytes, or with
# "shared" what the robot leaves of the RAM.
prove() {
    local name=$1 stack_max=$2 out=$CARGO_TARGET_DIR/$target/release
    say "$name: library for $target"
    # The compiler tells the stack frame of each function only to those who ask for the unstable.
    RUSTC_BOOTSTRAP=1 "${toolchain[@]}" cargo rustc --quiet --locked --release --target $target \
        --no-default-features --features "$name" "${build_std[@]}" -- -Z emit-stack-sizes
    image=$out/$name.elf
    "$linker" -flavor gnu -T board.ld --gc-sections "$out/libbare_metal.a" -o "$image" ||
        die "$name does not fit its board"

    # Without the robot in it, an image fits any board.
    symbols=$(readelf -sW "$image")
    local robot
    robot=$(($(awk '$8 == "ROBOT" { print $3 }' <<<"$symbols")))
    [[ $robot -gt 0 ]] || die "the image does not hold $name"
    [[ $stack_max != shared ]] || stack_max=$((ram - robot))

    # The deepest chain of calls; not counted is the codecs' exercise, which no robot calls.
    local stack largest
    read -r stack largest < <(python3 stack.py "$image" reset decode_everything) ||
        die "the stack of $name has no bound"
    printf '%-7s static  %7d of %d bytes\n' "$name" "$robot" "$ram"
    printf '%-7s stack   %7d of %d bytes at most, %d in its largest frame\n' \
        "$name" "$stack" "$stack_max" "$largest"
    ((stack <= stack_max)) || die "the stack of $name does not fit"
}

prove yellow shared
prove rescue $((64 * 1024))

# A loop's cycles on a Cortex-M4 without wait states: one an instruction, one more for each access
# to memory (none of them pipelined), three for the jumps. The largest loop with UXTB16, which adds
# two sums at a time, is the row kernel: it is in here only if the portable form is the one built.
if command -v llvm-objdump >/dev/null; then
    kernel=$(awk '$8 ~ /4slam3row4sums$/ { print $8 }' <<<"$symbols")
    [[ -n $kernel ]] || die "the image does not hold the row kernel"
    read -r instructions accesses < <(llvm-objdump -d --no-show-raw-insn \
        --disassemble-symbols="$kernel" "$image" | awk '
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
