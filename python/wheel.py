"""Makes the wheel of the package from a command that is built already. The wheel contains the
command, so `pip install` of it needs no Rust and compiles nothing. The command uses no interface of
Python, so one wheel serves all versions from 3.9 on.

usage: python3 python/wheel.py HILRIG [FOLDER]

HILRIG is the command, e.g. target/release/hilrig; FOLDER gets the wheel [default: target/wheels].
The wheel's platform tag names the machine of the command, and the oldest C library with all symbols
that the command needs. It needs readelf (binutils).
"""

from __future__ import annotations

import base64
import hashlib
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Dict, List, Tuple

HERE = Path(__file__).resolve().parent
#: Libraries of every Linux that pip calls manylinux (PEP 600); another one would be missing there.
LIBRARIES = re.compile(
    r"(libc|libm|libdl|librt|libpthread|libgcc_s|ld-linux(-[\w-]+)?|ld64)\.so\.\d+"
)
#: Machines as readelf and as pip name them.
MACHINES = {
    "Advanced Micro Devices X86-64": "x86_64",
    "AArch64": "aarch64",
    "ARM": "armv7l",
    "Intel 80386": "i686",
    "IBM S/390": "s390x",
    "PowerPC64": "ppc64le",
    "RISC-V": "riscv64",
}
#: What the header of these machines must also have, for the tag to hold.
NEEDED = {
    "armv7l": r"Flags:.*hard-float ABI",
    "ppc64le": r"Data:.*little endian",
    "riscv64": r"Class: +ELF64",
    "s390x": r"Class: +ELF64",
    "x86_64": r"Class: +ELF64",
}
#: The time of all files: the same command gives the same wheel.
TIME = (2020, 1, 1, 0, 0, 0)


def platform_tag(binary: Path) -> str:
    """The platform on which `binary` runs, from its ELF header and the versions that it needs."""
    words = ["readelf", "--wide", "--file-header", "--dynamic", "--version-info", str(binary)]
    env = {**os.environ, "LC_ALL": "C"}
    try:
        shown = subprocess.run(words, capture_output=True, text=True, check=True, env=env).stdout
    except OSError as error:
        sys.exit(f"wheel.py: {error}: install readelf (binutils)")
    except subprocess.CalledProcessError as error:
        sys.exit(f"wheel.py: {error.stderr.strip()}, expected a Linux command")
    return tag_of(shown, binary)


def tag_of(shown: str, binary: Path) -> str:
    """The platform of `binary`, which readelf shows as `shown`."""
    needed = re.findall(r"\(NEEDED\).*\[(.+?)\]", shown)
    foreign = [name for name in needed if not LIBRARIES.fullmatch(name)]
    if foreign:
        sys.exit(f"wheel.py: {binary} needs {', '.join(foreign)}, which other machines may not have")
    versions = [
        (int(major), int(minor))
        for major, minor in re.findall(r"Name: GLIBC_(\d+)\.(\d+)", shown)
    ]
    if re.search(r"Name: GLIBC_ABI_DT_RELR\b", shown):
        # Packed relocations; a C library before 2.36 does not apply them.
        versions.append((2, 36))
    if not versions:
        sys.exit(f"wheel.py: {binary} names no version of the GNU C library, expected a Linux command")
    major, minor = max(versions)
    # 2.17 is the oldest that Rust supports.
    return f"manylinux_{major}_{max(minor, 17)}_{machine_of(shown, binary)}"


def machine_of(shown: str, binary: Path) -> str:
    """The machine of `binary` as pip names it."""
    named = re.search(r"^ *Machine: +(.*?) *$", shown, re.M)
    name = named[1] if named is not None else "no machine"
    machine = MACHINES.get(name)
    if machine is None or not re.search(NEEDED.get(machine, ""), shown):
        known = ", ".join(sorted(MACHINES.values()))
        sys.exit(f"wheel.py: {binary} is for {name}, expected a machine that pip knows: {known}")
    return machine


def package() -> Tuple[str, str, str]:
    """Version, metadata and entry points of the package, from its pyproject.toml."""
    import tomllib

    project = tomllib.loads((HERE / "pyproject.toml").read_text())["project"]
    cargo = tomllib.loads((HERE.parent / "Cargo.toml").read_text())
    version = cargo["workspace"]["package"]["version"]
    lines = [
        "Metadata-Version: 2.1",
        f"Name: {project['name']}",
        f"Version: {version}",
        f"Summary: {project['description']}",
        f"License: {project['license']}",
        f"Requires-Python: {project['requires-python']}",
    ]
    for extra, needs in project["optional-dependencies"].items():
        lines.append(f"Provides-Extra: {extra}")
        lines += [f"Requires-Dist: {need} ; extra == '{extra}'" for need in needs]
    lines += ["Description-Content-Type: text/markdown", "", (HERE / "README.md").read_text()]
    points: List[str] = []
    for group, entries in project["entry-points"].items():
        points += [f"[{group}]"] + [f"{name} = {target}" for name, target in entries.items()]
    return version, "\n".join(lines), "\n".join(points) + "\n"


def build(binary: Path, folder: Path) -> Path:
    """Writes the wheel; returns its path."""
    version, metadata, points = package()
    tag = f"py3-none-{platform_tag(binary)}"
    info = f"hilrig-{version}.dist-info"
    wheel = f"Wheel-Version: 1.0\nGenerator: hilrig\nRoot-Is-Purelib: false\nTag: {tag}\n"
    source = HERE / "src"
    files: Dict[str, bytes] = {
        path.relative_to(source).as_posix(): path.read_bytes()
        for path in sorted(source.rglob("*"))
        if path.is_file() and "__pycache__" not in path.parts
    }
    script = f"hilrig-{version}.data/scripts/hilrig"
    files[script] = binary.read_bytes()
    files[f"{info}/METADATA"] = metadata.encode()
    files[f"{info}/WHEEL"] = wheel.encode()
    files[f"{info}/entry_points.txt"] = points.encode()
    for licence in sorted(HERE.parent.glob("LICENSE-*")):
        files[f"{info}/licenses/{licence.name}"] = licence.read_bytes()
    rows = [f"{name},sha256={digest(data)},{len(data)}" for name, data in files.items()]
    files[f"{info}/RECORD"] = "\n".join([*rows, f"{info}/RECORD,,", ""]).encode()
    folder.mkdir(parents=True, exist_ok=True)
    out = folder / f"hilrig-{version}-{tag}.whl"
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            entry = zipfile.ZipInfo(name, TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o100755 if name == script else 0o100644) << 16
            archive.writestr(entry, data)
    return out


def digest(data: bytes) -> str:
    """The hash of a file as RECORD has it."""
    return base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3) or not Path(sys.argv[1]).is_file():
        sys.exit(__doc__)
    default = HERE.parent / "target" / "wheels"
    print(build(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) == 3 else default))
