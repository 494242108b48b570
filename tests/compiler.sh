#!/usr/bin/env bash
# The compiler of tests/run.sh: Clippy's driver ($CLIPPY_DRIVER), so that the build of the tests is
# the pass of the lints, too. Cargo calls it with the path of the compiler and the options of one
# crate.
#
# The unit tests of a library contain all of its code. Clippy judges it there, so the library itself
# is compiled without the lints, in five sixths of the time; its warnings are errors all the same.
#
# Unit tests of three crates run for about a second at each level of optimisation. At level 0 they
# compile in a quarter of the time. Those of two more compute: level 1 compiles them in half the
# processor time of level 2 (110 s), and they then run for 9 s longer. Other tests link these
# crates at their own levels.
case " $* " in
*" --test "*) ;;
*" --crate-type lib "*) exec "$@" -D warnings ;;
esac
case " $* " in
*" --crate-name hilrig_engine "*" --test "* | *" --crate-name hilrig_realtime "*" --test "* | \
    *" --crate-name protocols "*" --test "*)
    set -- "$@" -C opt-level=0
    ;;
*" --crate-name emulators "*" --test "* | *" --crate-name firmware_core "*" --test "*)
    set -- "$@" -C opt-level=1
    ;;
esac
exec "$CLIPPY_DRIVER" "$@"
