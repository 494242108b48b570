//! Messages of the node protocol on the host's standard streams.

use semihosting::fs::File;
use semihosting::io::{Read as _, Write as _};

/// Longest message either way.
const MESSAGE_MAX: usize = 256 << 10;
/// Bytes read at once. QEMU allocates a buffer of this size for each read.
const READ_MAX: usize = 4 << 10;
/// First bytes of the rig's stream.
const MAGIC: [u8; 4] = *b"HRN1";

/// The streams, and a buffer for each.
pub(crate) struct Wire {
    from: File,
    to: File,
    input: [u8; MESSAGE_MAX],
    /// Start of the next message, and end of the read bytes.
    came: (usize, usize),
    output: [u8; MESSAGE_MAX],
    written: usize,
    items: u16,
}

/// A request of the rig.
#[derive(Clone, Copy)]
pub(crate) struct Request {
    /// Its type.
    pub(crate) kind: u8,
    /// Place of its body.
    body: (usize, usize),
}

/// An item of an exchange.
pub(crate) struct Item<'a> {
    /// Kind of the item.
    pub(crate) kind: u8,
    /// The port.
    pub(crate) port: u8,
    /// Nanoseconds since the run began.
    pub(crate) at: u64,
    /// Content of the item.
    pub(crate) payload: &'a [u8],
}

impl Wire {
    /// Opens the streams and waits for the rig.
    pub(crate) fn open() -> Self {
        let from = File::open(c"/dev/stdin").expect("standard input opens");
        let to = File::create(c"/dev/stdout");
        let mut wire = Self {
            from,
            to: to.expect("standard output opens"),
            input: [0; MESSAGE_MAX],
            came: (0, 0),
            output: [0; MESSAGE_MAX],
            written: 0,
            items: 0,
        };
        wire.fill(MAGIC.len());
        assert!(
            wire.input.starts_with(&MAGIC),
            "the rig speaks the form for people; this board speaks the binary form alone (leave \
             out --json-nodes)"
        );
        wire.came.0 = MAGIC.len();
        wire
    }

    /// Reads until `len` bytes have come that are not taken.
    fn fill(&mut self, len: usize) {
        let (start, end) = self.came;
        if end - start >= len {
            return;
        }
        if start + len > MESSAGE_MAX || start == end {
            self.input.copy_within(start..end, 0);
            self.came = (0, end - start);
        }
        assert!(len <= MESSAGE_MAX, "the rig sent a message of {len} bytes");
        while self.came.1 - self.came.0 < len {
            let end = self.input.len().min(self.came.1 + READ_MAX.max(len));
            let read = self.from.read(&mut self.input[self.came.1..end]);
            match read.expect("standard input can be read") {
                // The rig is gone.
                0 => semihosting::process::exit(1),
                read => self.came.1 += read,
            }
        }
    }

    /// The next request.
    pub(crate) fn next(&mut self) -> Request {
        self.fill(5);
        let len = number(&self.input[self.came.0..], 4);
        let len = usize::try_from(len).unwrap_or(usize::MAX);
        self.fill(len.saturating_add(4));
        let start = self.came.0;
        self.came.0 += 4 + len;
        Request {
            kind: self.input[start + 4],
            body: (start + 5, start + 4 + len),
        }
    }

    /// Whether a greeting is of version 1 of the protocol.
    pub(crate) fn is_known_version(&self, request: Request) -> bool {
        const KEY: &[u8] = b"\"hilrig_node\":";
        let body = &self.input[request.body.0..request.body.1];
        let found = body.windows(KEY.len()).position(|part| part == KEY);
        found.is_some_and(|at| {
            let value = body[at + KEY.len()..].trim_ascii_start();
            value.starts_with(b"1") && !value.get(1).is_some_and(u8::is_ascii_digit)
        })
    }

    /// Time and items of an exchange.
    pub(crate) fn exchange(&self, request: Request) -> (u64, Items<'_>) {
        let body = &self.input[request.body.0..request.body.1];
        (number(body, 8), Items(&body[10..]))
    }

    /// Writes an answer.
    pub(crate) fn answer(&mut self, kind: u8, body: &[u8]) {
        self.written = 5;
        self.output[4] = kind;
        self.put(body);
        self.send();
    }

    /// Begins the answer to an exchange.
    pub(crate) fn begin_reply(&mut self) {
        self.output[4] = b'x';
        self.written = 15;
        self.items = 0;
    }

    /// Adds an item whose payload `fill` writes into the given room; it is left out if that is
    /// empty. Returns the length.
    pub(crate) fn item(
        &mut self,
        kind: u8,
        port: u8,
        at: u64,
        room: usize,
        fill: impl FnOnce(&mut [u8]) -> usize,
    ) -> usize {
        let start = self.written;
        let len = fill(&mut self.output[start + 12..start + 12 + room]);
        if len > 0 {
            self.put(&[kind, port]);
            self.put(&u16::try_from(len).unwrap_or(u16::MAX).to_le_bytes());
            self.put(&at.to_le_bytes());
            self.written += len;
            self.items += 1;
        }
        len
    }

    /// Ends the answer to an exchange and sends it.
    pub(crate) fn reply(&mut self, next: u64) {
        self.output[5..13].copy_from_slice(&next.to_le_bytes());
        self.output[13..15].copy_from_slice(&self.items.to_le_bytes());
        self.send();
    }

    fn put(&mut self, bytes: &[u8]) {
        self.output[self.written..][..bytes.len()].copy_from_slice(bytes);
        self.written += bytes.len();
    }

    fn send(&mut self) {
        let len = u32::try_from(self.written - 4).unwrap_or(u32::MAX);
        self.output[..4].copy_from_slice(&len.to_le_bytes());
        let sent = self.to.write_all(&self.output[..self.written]);
        sent.expect("standard output can be written");
    }
}

/// Items of an exchange.
pub(crate) struct Items<'a>(&'a [u8]);

impl<'a> Iterator for Items<'a> {
    type Item = Item<'a>;

    fn next(&mut self) -> Option<Item<'a>> {
        let (head, rest) = self.0.split_at_checked(12)?;
        let len = usize::from(u16::from_le_bytes([head[2], head[3]]));
        let (payload, rest) = rest.split_at_checked(len)?;
        self.0 = rest;
        Some(Item {
            kind: head[0],
            port: head[1],
            at: number(&head[4..], 8),
            payload,
        })
    }
}

/// The little-endian number in the first `len` bytes.
fn number(bytes: &[u8], len: usize) -> u64 {
    let bytes = bytes[..len].iter().rev();
    bytes.fold(0, |number, &byte| number << 8 | u64::from(byte))
}
