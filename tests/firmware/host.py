"""A rig of one node program, for tests of the program by itself: requests and answers by hand.

The wire is that of docs/nodes.md, binary form."""
import json
import struct
import subprocess
import tempfile

NEVER = 2**64 - 1
BYTES, LINE, NOTE, VIOLATION, OUTPUT = 1, 2, 3, 4, 5


class Node:
    """The program in virtual time: `run` goes from exchange to exchange as it asks."""

    def __init__(self, command, ports, settings, quantities=(), seed=1):
        self.log = tempfile.TemporaryFile("w+")
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.log
        )
        self.process.stdin.write(b"HRN1")
        self.now, self.next, self.exchanges = 0, 0, 0
        self.items = []
        hello = {
            "hilrig_node": 1,
            "name": "test",
            "role": "device",
            "seed": seed,
            "virtual": True,
            "ports": [{"name": name, "rate": 115200, "format": "8N1"} for name in ports],
            "quantities": list(quantities),
            "settings": settings,
        }
        kind, body = self.ask(b"H", json.dumps(hello).encode())
        assert kind == b"h", kind
        self.hello = json.loads(body)
        self.outputs = self.hello.get("outputs", [])

    def ask(self, kind, body):
        self.process.stdin.write(struct.pack("<I", len(body) + 1) + kind + body)
        self.process.stdin.flush()
        head = self.process.stdout.read(5)
        if len(head) < 5:
            status = self.process.wait(timeout=10)
            raise EOFError(f"the program ended with {status}: {self.said()}")
        (length,) = struct.unpack("<I", head[:4])
        return head[4:], self.process.stdout.read(length - 1)

    def exchange(self, now, given=()):
        """One exchange; what the program puts out is added to `items`."""
        body = struct.pack("<QH", now, len(given))
        for kind, port, payload in given:
            body += struct.pack("<BBHQ", kind, port, len(payload), now) + payload
        kind, body = self.ask(b"X", body)
        assert kind == b"x", kind
        self.now, self.exchanges = now, self.exchanges + 1
        self.next, count = struct.unpack("<QH", body[:10])
        assert self.next >= now, "the program asks for the past"
        at, fresh = 10, []
        for _ in range(count):
            kind, port, length, when = struct.unpack("<BBHQ", body[at : at + 12])
            at += 12
            assert when >= now, "an item is in the past"
            fresh.append((when, kind, port, body[at : at + length]))
            at += length
        assert at == len(body)
        self.items += fresh
        return fresh

    def run(self, until):
        """Exchanges until a moment in ns, as the program asks for them."""
        fresh = []
        while self.next <= until:
            fresh += self.exchange(self.next)
        return fresh + self.exchange(until)

    def send(self, port, data, byte_ns=86805):
        """Bytes that end one behind the other, from now on."""
        fresh = []
        for byte in data:
            fresh += self.run(self.now + byte_ns)
            fresh += self.exchange(self.now, [(BYTES, port, bytes([byte]))])
        return fresh

    def said(self):
        self.log.seek(0)
        return self.log.read()

    def end(self):
        body = b"E"
        self.process.stdin.write(struct.pack("<I", len(body)) + body)
        self.process.stdin.close()
        assert self.process.wait(timeout=10) == 0
        return self.said()


def text(items, port=0):
    """What a port sent, as text."""
    return b"".join(data for _, kind, at, data in items if kind == BYTES and at == port).decode()


def values(items, output):
    """Values of an output: when and what."""
    found = [(when, data) for when, kind, at, data in items if kind == OUTPUT and at == output]
    return [(when, struct.unpack("<d", data)[0]) for when, data in found]
