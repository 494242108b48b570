"""Public parsers with planted bugs: hilrig beside AFL++, by the processor time to the first crash.

    python compare.py HILRIG SOURCES [--seeds N] [--most SECONDS] [NAME ..]

SOURCES is a folder with clones of the libraries; one that is missing is cloned. Each bug is one line
that this script puts into a copy. Both searches have the same inputs to begin with, run alone on one
processor, and their processor time counts that of all their processes. Needs gcc, git and afl++.
"""
import argparse
import ctypes
import os
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
TRAP = "{ *(volatile int *)0 = 1; }"
LIBMODBUS = ["src/modbus.c", "src/modbus-data.c", "src/modbus-rtu.c"]
# The program around each library, if it has another name than LIBRARY_client.c.
CLIENTS = {
    "libmodbus": "modbus_server.c", "nanomodbus": "nanomodbus_server.c", "cat": "cat_server.c",
    "tinygps": "tinygps_client.cpp",
}


def nmea(text):
    total = 0
    for byte in text.encode():
        total ^= byte
    return f"${text}*{total:02X}\r\n".encode()


def crc_modbus(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return data + crc.to_bytes(2, "little")


def crc_slip(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return data + crc.to_bytes(2, "big")


def slip(data):
    escaped = crc_slip(data).replace(b"\xdb", b"\xdb\xdd").replace(b"\xc0", b"\xdb\xdc")
    return b"\xc0" + escaped + b"\xc0"


def cobs(data):
    parts = (data + b"\0").split(b"\0")[:-1]
    return b"".join(bytes([len(part) + 1]) + part for part in parts) + b"\0"


NMEA = [
    nmea("GPRMC,081836,A,3751.65,S,14507.36,E,000.0,360.0,130998,011.3,E"),
    nmea("GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"),
    nmea("GPGSA,A,3,04,05,,09,12,,,24,,,,,2.5,1.3,2.1"),
    nmea("GPGSV,3,1,11,03,03,111,00,04,15,270,00,06,01,010,00,13,06,292,00"),
    nmea("GPVTG,054.7,T,034.4,M,005.5,N,010.2,K"),
]
REQUESTS = [crc_modbus(bytes.fromhex(request)) for request in (
    "01030000000a", "010600010003", "0110000000020400010002", "011600040000ffff",
    "0117000000020004000204000a0102", "01050003ff00")]
# Name: repository and commit, sources, options, seeds, and bugs: file, line behind which, what is
# put there.
PARSERS = {
    "minmea": (
        "kosma/minmea@a8745af0462870c1297fa4b8ee1ce13192485c3c", ["minmea.c"], [], NMEA, {
            "month": ("minmea.c", "m = strtol(mArr, NULL, 10);", f"if (m > 12) {TRAP}"),
            "parts": ("minmea.c", "if (memcmp(frame->type.sentence_id, \"GSV\", "
                      "sizeof(frame->type.sentence_id)))\n        return false;",
                      f"if (frame->msg_nr > frame->total_msgs && frame->total_sats > 99) {TRAP}"),
            "gap": ("minmea.c", "if (memcmp(frame->type.sentence_id, \"GSV\", "
                    "sizeof(frame->type.sentence_id)))\n        return false;",
                    f"if (frame->sats[3].nr && !frame->sats[2].nr && frame->total_sats) {TRAP}"),
        }),
    "lwgps": (
        "MaJerle/lwgps@d3096e99cb3ac1966a395dbb71eed02cac1c1aed", ["lwgps/src/lwgps/lwgps.c"],
        ["-Ilwgps/src/include", "-DLWGPS_IGNORE_USER_OPTS"], NMEA, {
            "satellites": ("lwgps/src/lwgps/lwgps.c",
                           "ghandle->sats_in_use = ghandle->p.data.gga.sats_in_use;",
                           f"if (ghandle->sats_in_use > 64) {TRAP}"),
        }),
    "libmodbus": (
        "stephane/libmodbus@a1d00bfc40a8391f92b0dadd92e4122bf85bb6a5", LIBMODBUS, ["-Isrc", "-I."],
        REQUESTS, {
            "mask": ("src/modbus.c", "uint16_t or = (req[offset + 5] << 8) + req[offset + 6];",
                     f"if (or == 0x8000) {TRAP}"),
        }),
    "slip": (
        "marcinbor85/slip@9c3f2d12d1b99c1603f9b7d932cedf62d72e2f74", ["slip.c"], [],
        [slip(bytes.fromhex(message)) for message in ("0101c0db10", "02ff00", "030a0b0c0d0e0f")], {
            "length": ("slip.c", "if (slip->crc == 0) {",
                       f"if (slip->size > 2 && slip->descriptor->buf[0] == 0xFF) {TRAP}"),
        }),
    "cobs": (
        "cmcqueen/cobs-c@7afcc42cf7a7efa84f77360ec27bfc979e3cf93d", ["cobs.c"], [],
        [cobs(bytes.fromhex(data)) for data in ("1122003344", "00", "0102030405060708", "ff00ff")], {
            "code": ("cobs.c", "len_code = *src_read_ptr++;",
                     f"if (len_code == 0xFF && src_len > 3) {TRAP}"),
        }),
    "tinygps": (
        "mikalhart/TinyGPSPlus@0a205759da22a1c54c5f5285480fe6132592a4e2", ["src/TinyGPS++.cpp"],
        ["-Isrc"], NMEA, {
            "satellites": ("src/TinyGPS++.cpp", "hdop.commit();",
                           f"if (satellites.val > 99 && hdop.val > 9900) {TRAP}"),
            "date": ("src/TinyGPS++.cpp", "term[curTermOffset] = 0;",
                     "if (curTermOffset > 10 && curTermNumber == 9 && "
                     f"curSentenceType == GPS_SENTENCE_RMC) {TRAP}"),
        }),
    "nanomodbus": (
        "debevv/nanoMODBUS@035b8d596a954c2dd4bc40e3fa28a7cb2a8c0ec1", ["nanomodbus.c"], [],
        REQUESTS, {
            "quantity": ("nanomodbus.c", "const uint8_t byte_count_write = get_1(nmbs);",
                         f"if (read_quantity > 0x7D && byte_count_write == 0) {TRAP}"),
            "count": ("nanomodbus.c", "if (registers_bytes == 0)\n            "
                      "return send_exception_msg(nmbs, NMBS_EXCEPTION_ILLEGAL_DATA_VALUE);",
                      f"if (registers_bytes > 0xE0 && registers_bytes == 2 * quantity) {TRAP}"),
        }),
    "cat": (
        "marcinbor85/cAT@84fdca960b8cbc8c4b5d87cd1805815ca2a27b52", ["src/cat.c"], ["-Isrc"],
        [line.encode() for line in (
            'AT+PRINT=10,5,"some text"\r\n', "AT+GO=-7,20\r\n", "AT+GO?\r\n", "AT\r\n",
            "AT+PRINT=?\r\n")], {
            "number": ("src/cat.c", "val *= sign;", f"if (val > 99999 && sign < 0) {TRAP}"),
        }),
    "cjson": (
        "DaveGamble/cJSON@a29814f285cc531c00223743ad3c55cd38c0dc56", ["cJSON.c"], [],
        [line.encode() for line in (
            '{"id":3,"values":[1,2.5,-3],"ok":true}\n', '{"error":null,"text":"a\\u00e9b"}\n',
            '[{"x":1},{"x":2}]\n')], {
            "depth": ("cJSON.c", "static cJSON_bool parse_array(cJSON * const item, "
                      "parse_buffer * const input_buffer)\n{",
                      f"if (input_buffer->depth > 99) {TRAP}"),
            "number": ("cJSON.c", "item->valuedouble = number;",
                       f"if (number > 1e300) {TRAP}"),
        }),
}


def run(words, **more):
    subprocess.run(words, check=True, **more)


def used():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def reap():
    """Ends and collects what a search has left: its time counts as well."""
    children = Path(f"/proc/self/task/{os.getpid()}/children")
    while left := children.read_text().split():
        for pid in left:
            os.kill(int(pid), signal.SIGKILL)
        os.waitpid(int(left[0]), 0)


def timed(words, found, most, env):
    """Processor seconds until `found`, None if that is never; all of it."""
    before = used()
    search = subprocess.Popen(words, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    begun = time.monotonic()
    while search.poll() is None and not found() and time.monotonic() - begun < 4 * most:
        time.sleep(0.02)
    is_found = found()
    if search.poll() is None:
        search.send_signal(signal.SIGINT)
    try:
        search.wait(20)
    except subprocess.TimeoutExpired:
        search.kill()
        search.wait()
    reap()
    return used() - before if is_found else None


def build(name, bug, sources, work):
    repository, files, options, _, bugs = PARSERS[name]
    clone = sources / name
    repository, commit = repository.split("@")
    if not clone.exists():
        run(["git", "init", "-q", str(clone)])
        run(["git", "fetch", "-q", "--depth", "1", f"https://github.com/{repository}", commit],
            cwd=clone)
        run(["git", "checkout", "-q", "FETCH_HEAD"], cwd=clone)
    copy = work / f"{name}-{bug}"
    run(["cp", "-r", str(clone), str(copy)])
    if name == "libmodbus":
        version = "#define LIBMODBUS_VERSION_{} {}\n"
        texts = "".join(version.format(part, 0) for part in ("MAJOR", "MINOR", "MICRO"))
        (copy / "src/modbus-version.h").write_text(
            texts + '#define LIBMODBUS_VERSION_STRING "0"\n'
            "#define LIBMODBUS_VERSION_CHECK(a, b, c) 1\n")
        (copy / "config.h").write_text(
            '#define HAVE_DECL_TIOCSRS485 0\n#define HAVE_DECL_TIOCM_RTS 1\n'
            '#define HAVE_TERMIOS_H 1\n#include <termios.h>\n')
    file, line, bug_line = bugs[bug]
    text = (copy / file).read_text()
    assert text.count(line) == 1, f"{file}: {line} is there {text.count(line)} times"
    (copy / file).write_text(text.replace(line, f"{line}\n{bug_line}"))
    client = HERE / CLIENTS.get(name, f"{name}_client.c")
    is_cpp = client.suffix == ".cpp"
    common = ["-O1", "-w", f"-I{HERE}", "-I.", *options, str(client), *files]
    run(["g++" if is_cpp else "gcc", *common, "-o", "plain", "-lm"], cwd=copy)
    quiet = os.environ | {"AFL_QUIET": "1"}
    run(["afl-clang-fast++" if is_cpp else "afl-clang-fast", *common, "-o", "instrumented", "-lm"], cwd=copy, env=quiet)
    seeds = copy / "seeds"
    seeds.mkdir()
    for number, seed in enumerate(PARSERS[name][3]):
        (seeds / f"{number}.bin").write_bytes(seed)
    return copy


def main():
    words = argparse.ArgumentParser()
    words.add_argument("hilrig")
    words.add_argument("sources", type=Path)
    words.add_argument("names", nargs="*")
    words.add_argument("--seeds", type=int, default=3)
    words.add_argument("--most", type=int, default=60)
    words = words.parse_intermixed_args()
    hilrig = os.path.realpath(words.hilrig)
    sources = words.sources.resolve()
    sources.mkdir(parents=True, exist_ok=True)
    # PR_SET_CHILD_SUBREAPER: what AFL++ leaves behind is collected here.
    ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)
    afl_env = os.environ | {
        "AFL_BENCH_UNTIL_CRASH": "1", "AFL_NO_UI": "1", "AFL_SKIP_CPUFREQ": "1",
        "AFL_NO_AFFINITY": "1", "AFL_I_DONT_CARE_ABOUT_MISSING_CRASHES": "1",
        "AFL_SKIP_CRASHES": "1",
    }
    missed = 0
    with tempfile.TemporaryDirectory() as work:
        work = Path(work)
        for name in words.names or PARSERS:
            for bug in PARSERS[name][4]:
                folder = build(name, bug, sources, work)
                times = {"hilrig": [], "AFL++": []}
                for seed in range(1, words.seeds + 1):
                    ours, theirs = folder / f"hilrig-{seed}", folder / f"afl-{seed}"
                    search = [hilrig, "fuzz", "--exec", f'exec {folder}/plain "$HILRIG_DIR/port"',
                              "--virtual", "--corpus", str(folder / "seeds"), "--shrink", "0",
                              "--seed", str(seed), "--for", f"{words.most}s", "--out", str(ours)]
                    crash = lambda: any(ours.glob("findings/*crash*"))
                    times["hilrig"].append(timed(search, crash, words.most, os.environ))
                    search = ["afl-fuzz", "-i", str(folder / "seeds"), "-o", str(theirs),
                              "-s", str(seed), "-V", str(words.most), "-m", "none", "--",
                              str(folder / "instrumented"), "@@"]
                    crash = lambda: any(theirs.glob("default/crashes/id*"))
                    times["AFL++"].append(timed(search, crash, words.most, afl_env))
                never = float("inf")
                medians = {}
                for search, found in times.items():
                    each = [never if one is None else one for one in found]
                    medians[search] = statistics.median(each)
                    texts = " ".join("never" if one is None else f"{one:.1f}" for one in found)
                    print(f"{name} {bug}: {search} {texts} s", flush=True)
                missed += medians["hilrig"] >= 10 * medians["AFL++"] or medians["hilrig"] == never
    return missed > 0


if __name__ == "__main__":
    sys.exit(main())
