# Sourced: a compiler for the Cortex-M4F, `$target`, as `toolchain` (a command's prefix) and
# `build_std` (options of cargo). `say` and `die` are the caller's.
#
# The toolchain's own target if rustup has it or can fetch it; else Debian's compiler, which comes
# with the source of its library. That source fits no other compiler.
# shellcheck disable=SC2034,SC2154 # The caller's.
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
