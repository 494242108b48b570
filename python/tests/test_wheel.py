"""The platform tag of a wheel, from what readelf shows."""

import importlib.util
import shutil
import struct
import sys
from pathlib import Path

import pytest

_SPEC = importlib.util.spec_from_file_location("wheel", Path(__file__).parent.parent / "wheel.py")
wheel = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(wheel)

X86 = "Advanced Micro Devices X86-64"
HARD = "0x5000400, Version5 EABI, hard-float ABI"


def shown(
    machine=X86, versions=("GLIBC_2.34",), needed=("libc.so.6",), bits=64, end="little", flags="0x0"
):
    """The lines of readelf that count, in its form."""
    lines = [f"  Class:                             ELF{bits}"]
    lines += [f"  Data:                              2's complement, {end} endian"]
    lines += [f"  Machine:                           {machine}"]
    lines += [f"  Flags:                             {flags}"]
    lines += [f" 0x0000000000000001 (NEEDED)       Shared library: [{name}]" for name in needed]
    lines += [f"  0x0010:   Name: {name}  Flags: none  Version: 3" for name in versions]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("tag", "header"),
    [
        ("manylinux_2_34_x86_64", {}),
        ("manylinux_2_17_x86_64", {"versions": ["GLIBC_2.4", "GLIBC_2.2.5", "GCC_3.3"]}),
        ("manylinux_2_28_x86_64", {"versions": ["GLIBC_2.9", "GLIBC_2.28"]}),
        # glibc 2.36 brought packed relocations, and this version with them.
        ("manylinux_2_36_x86_64", {"versions": ["GLIBC_2.34", "GLIBC_ABI_DT_RELR"]}),
        ("manylinux_2_39_x86_64", {"versions": ["GLIBC_2.39", "GLIBC_ABI_DT_RELR"]}),
        ("manylinux_2_34_aarch64", {"machine": "AArch64", "needed": ["ld-linux-aarch64.so.1"]}),
        ("manylinux_2_34_armv7l", {"machine": "ARM", "bits": 32, "flags": HARD}),
        ("manylinux_2_34_i686", {"machine": "Intel 80386", "needed": ["ld-linux.so.2"], "bits": 32}),
        ("manylinux_2_34_riscv64", {"machine": "RISC-V"}),
        ("manylinux_2_34_ppc64le", {"machine": "PowerPC64", "needed": ["ld64.so.2"]}),
    ],
)
def test_the_tag_is_that_of_the_command(tag, header) -> None:
    assert wheel.tag_of(shown(**header), Path("hilrig")) == tag


@pytest.mark.parametrize(
    ("said", "header"),
    [
        ("needs libudev.so.1, which other machines", {"needed": ["libc.so.6", "libudev.so.1"]}),
        ("names no version of the GNU C library", {"versions": []}),
        ("is for MIPS R3000, expected a machine", {"machine": "MIPS R3000"}),
        # Soft floats, 32 bits, and the other byte order are other platforms.
        ("is for ARM, expected", {"machine": "ARM", "flags": "0x5000200, soft-float ABI"}),
        ("is for RISC-V, expected", {"machine": "RISC-V", "bits": 32}),
        ("is for Advanced Micro Devices X86-64, expected", {"bits": 32}),
        ("is for PowerPC64, expected", {"machine": "PowerPC64", "end": "big"}),
    ],
)
def test_a_command_that_no_tag_fits_is_refused(said, header) -> None:
    with pytest.raises(SystemExit, match=said):
        wheel.tag_of(shown(**header), Path("hilrig"))


@pytest.mark.skipif(not shutil.which("readelf"), reason="needs readelf (binutils)")
def test_the_machine_is_that_of_the_file_and_not_that_of_the_builder(tmp_path) -> None:
    """A command of this machine with the number of another one in its header (ELF: e_machine)."""
    command = bytearray(Path(shutil.which("true")).read_bytes())
    for number, machine in [(62, "x86_64"), (183, "aarch64")]:
        struct.pack_into("<H", command, 18, number)
        path = tmp_path / machine
        path.write_bytes(command)
        assert wheel.platform_tag(path).endswith(machine)


def test_what_readelf_cannot_show_is_an_error_without_a_trace(tmp_path, monkeypatch) -> None:
    script = tmp_path / "hilrig"
    script.write_text("#!/bin/sh\n")
    if shutil.which("readelf"):
        with pytest.raises(SystemExit, match="expected a Linux command"):
            wheel.platform_tag(script)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SystemExit, match="install readelf"):
        wheel.platform_tag(Path(sys.executable))
