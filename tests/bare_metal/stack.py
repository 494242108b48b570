#!/usr/bin/env python3
"""How much stack does an image need at most? Prints the deepest chain of calls from its entry.

    stack.py IMAGE ENTRY [WITHOUT..]

IMAGE is an ELF file for a Cortex-M whose compiler told the frame of each function (-Z
emit-stack-sizes); functions named WITHOUT and what only they call do not count. Each chain of calls
from ENTRY is followed through the instructions themselves: BL, and jumps that leave their function.
A call through a pointer is taken to reach the deepest of all functions whose address is anywhere in
the image's data or loaded by its code, four such calls within each other at most: formatting a
number takes two. Direct recursion has no bound, so it is an error.
"""
import bisect
import struct
import sys


# Calls through pointers within each other.
POINTERS = 4


def die(what):
    sys.exit(f"stack.py: {what}")


def sections(image):
    """Name, address, bytes, link and kind of each section."""
    offset, = struct.unpack_from("<I", image, 32)
    size, count, names = struct.unpack_from("<HHH", image, 46)
    rows = [struct.unpack_from("<10I", image, offset + size * i) for i in range(count)]
    text = rows[names][4]
    for name, kind, _, address, at, length, link, *_ in rows:
        end = image.index(b"\0", text + name)
        content = b"" if kind == 8 else image[at:at + length]
        yield image[text + name:end].decode(), address, content, link, kind


def symbols(image):
    table = list(sections(image))
    for _, _, content, link, kind in table:
        if kind != 2:
            continue
        strings = table[link][2]
        for name, value, size, info, _, _ in struct.iter_unpack("<IIIBBH", content):
            yield strings[name:strings.index(b"\0", name)].decode(), value, size, info & 15


def frames(content):
    """The frame of each function: its address, then the size as LEB128."""
    at, found = 0, {}
    while at < len(content):
        address, = struct.unpack_from("<I", content, at)
        at, size, shift = at + 4, 0, 0
        while True:
            byte = content[at]
            size |= (byte & 127) << shift
            at, shift = at + 1, shift + 7
            if byte < 128:
                break
        found[address & ~1] = size
    return found


def branch(first, second, at):
    """Where a 32-bit BL or B.W at `at` goes; None for any other instruction."""
    if first >> 11 != 0b11110 or second >> 15 != 1 or second >> 12 & 1 != 1:
        return None
    sign, j1, j2 = first >> 10 & 1, second >> 13 & 1, second >> 11 & 1
    far = sign << 24 | (1 - (j1 ^ sign)) << 23 | (1 - (j2 ^ sign)) << 22
    far |= (first & 0x3FF) << 12 | (second & 0x7FF) << 1
    return at + 4 + (far - (sign << 25))


def words_of(address, data):
    """The aligned words of `data`, which lies at `address`."""
    data = data[-address % 4:]
    return (word for word, in struct.iter_unpack("<I", data[:len(data) // 4 * 4]))


def main(path, entry, *without):
    image = open(path, "rb").read()
    content = {name: (address, data) for name, address, data, *_ in sections(image)}
    start, code = content[".text"]
    known = list(symbols(image))
    names = {value & ~1: name for name, value, _, kind in known if kind == 2}
    begins = sorted(names)
    marks = sorted((value & ~1, name[1]) for name, value, _, _ in known if name[:2] in ("$t", "$d"))
    size_of = frames(content[".stack_sizes"][1])

    def owner(address):
        index = bisect.bisect_right(begins, address) - 1
        return begins[index] if index >= 0 else None

    calls = {address: set() for address in begins}
    through_pointers, words = set(), set()
    ends = [address for address, _ in marks[1:]] + [start + len(code)]
    for (address, kind), end in zip(marks, ends):
        if not start <= address < start + len(code):
            continue
        at = address
        if kind == "d":
            words.update(words_of(address, code[address - start:end - start]))
            continue
        low = {}
        while at + 2 <= min(end, start + len(code)):
            first, = struct.unpack_from("<H", code, at - start)
            me = owner(at)
            if first >> 11 < 0b11101:
                if first & 0xFF87 == 0x4780:
                    through_pointers.add(me)
                at += 2
                continue
            second, = struct.unpack_from("<H", code, at - start + 2)
            goal = branch(first, second, at)
            if goal is not None and owner(goal) is not None and owner(goal) != me:
                calls[me].add(owner(goal))
            # movw and movt load an address in two halves.
            half = (first & 15) << 12 | (first >> 10 & 1) << 11
            half |= (second >> 12 & 7) << 8 | second & 255
            register = second >> 8 & 15
            if first & 0xFBF0 == 0xF240:
                low[register] = half
            elif first & 0xFBF0 == 0xF2C0 and register in low:
                words.add(half << 16 | low[register])
            at += 4
    for name in {".data", ".rodata"} & set(content):
        words.update(words_of(*content[name]))
    reachable = {word & ~1 for word in words if word & 1} & set(begins)

    left_out = {address for address in begins if names[address] in without}
    deepest, open_calls = {}, []

    def depth(address, pointers):
        if (address, pointers) in deepest:
            return deepest[address, pointers]
        if address in open_calls:
            chain = open_calls[open_calls.index(address):] + [address]
            die("recursion has no bound: " + " > ".join(names[one] for one in chain))
        open_calls.append(address)
        below = [depth(goal, pointers) for goal in calls[address] - left_out]
        if address in through_pointers and pointers > 0:
            outer, open_calls[:] = open_calls[:], []
            below += [depth(goal, pointers - 1) for goal in reachable - left_out]
            open_calls[:] = outer
        best = max(below, default=(0, ()))
        open_calls.pop()
        deepest[address, pointers] = size_of.get(address, 0) + best[0], (address, *best[1])
        return deepest[address, pointers]

    roots = [address for address in begins if names[address] == entry]
    if not roots or not size_of:
        die(f"{path}: expected a function {entry} and the frames of all: nothing was seen")
    total, chain = depth(roots[0], POINTERS)
    print(total, max(size_of.get(address, 0) for address in chain))
    for address in chain:
        print(f"{size_of.get(address, 0):8} {names[address]}", file=sys.stderr)


sys.setrecursionlimit(10_000)
main(*sys.argv[1:])
