//! A model of a terminal: its settings, and the line discipline of a serial port.
//!
//! A pseudo-terminal has the kernel's line discipline. It lacks the work of a UART and its driver
//! below that: characters with wrong parity or without a stop bit, breaks, characters with fewer
//! than eight bits. This module adds it. In virtual time this module does all the work, because the
//! kernel would act at its own times; the pseudo-terminal stays raw.
//!
//! Sources: termios(3), POSIX.1-2024 chapter 11, and the behaviour of Linux' `n_tty`, which the
//! tests compare on a pseudo-terminal.

mod edit;
mod kernel;
mod settings;

use std::collections::VecDeque;

use engine::rig::line::{Mark, MarkDamage};
pub use settings::{Code, Settings};
use settings::{bits, has};

/// Maximum number of bytes for a client that does not read.
pub(crate) const HOLDS: usize = 4095;
/// The value that disables a special character.
const DISABLED: u8 = 0;

/// A terminal between a line and its client.
#[derive(Clone, Debug, Default)]
pub struct Terminal {
    settings: Settings,
    /// Whether this model does all the work of the line discipline.
    is_whole: bool,
    /// An incomplete line, in canonical mode.
    line: Vec<u8>,
    /// Lengths of the lines that the client can read, in canonical mode, and whether a character
    /// that is not read (VEOF) ended the line.
    lines: VecDeque<(usize, bool)>,
    /// Bytes that its client can read.
    unread: usize,
    /// Whether the next character is literal.
    is_literal: bool,
    /// Whether the other end has sent a stop character, and whether the client has suspended its
    /// output.
    stopped: [bool; 2],
    /// Bytes to echo when output continues.
    echo: Vec<u8>,
    column: usize,
    /// Damaged characters so far: without a stop bit, with wrong parity, breaks.
    damaged: [u32; 3],
    /// Characters so far that lost bits because the client uses fewer than eight.
    cut: u64,
    /// Start or stop characters that the client's driver sends between its bytes.
    urgent: Vec<u8>,
    /// Bytes that the client can read; `None` if the kernel holds them.
    held: Option<VecDeque<u8>>,
    /// Whether the client has taken bytes since the last `take_is_read`.
    is_read: bool,
}

/// Result of arriving characters.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Received {
    /// Bytes that become readable.
    pub ready: Vec<u8>,
    /// Number of characters without room.
    pub lost: usize,
    /// Whether the client's unread bytes are discarded, before all of `ready`.
    pub flushes: bool,
}

impl Terminal {
    /// A terminal with `settings` that does all the work of the line discipline.
    pub fn whole(settings: Settings) -> Self {
        Self {
            settings,
            is_whole: true,
            held: Some(VecDeque::new()),
            ..Self::default()
        }
    }

    /// Its settings.
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Whether this model does all the work of the line discipline.
    pub const fn is_whole(&self) -> bool {
        self.is_whole
    }

    /// Bytes that the client can read.
    pub const fn unread(&self) -> usize {
        self.unread
    }

    /// Sets the number of unread bytes after another process has read some.
    pub(crate) fn correct_unread(&mut self, unread: usize) {
        self.took(self.unread.saturating_sub(unread));
    }

    /// Whether bytes have arrived that the client has not read, including those of an incomplete
    /// line.
    pub const fn is_waiting(&self) -> bool {
        self.unread > 0 || !self.line.is_empty()
    }

    /// Whether this model, not the kernel, holds the bytes that the client can read.
    pub(crate) const fn holds(&self) -> bool {
        self.held.is_some()
    }

    /// Holds `bytes` until the client reads them; `false` if the kernel holds the bytes.
    pub(super) fn hold(&mut self, bytes: &[u8]) -> bool {
        let held = self.held.as_mut();
        held.map(|held| held.extend(bytes)).is_some()
    }

    /// Returns the held bytes; the kernel holds them from now on.
    pub(super) fn release(&mut self) -> Vec<u8> {
        self.held.take().map(Vec::from).unwrap_or_default()
    }

    /// Takes the first `len` held bytes; `None` if the kernel holds the bytes.
    pub(crate) fn take(&mut self, len: usize) -> Option<Vec<u8>> {
        let held = self.held.as_mut()?;
        let bytes: Vec<u8> = held.drain(..len.min(held.len())).collect();
        self.is_read |= !bytes.is_empty();
        Some(bytes)
    }

    /// Whether the client has taken bytes since the last call.
    pub(super) const fn take_is_read(&mut self) -> bool {
        core::mem::replace(&mut self.is_read, false)
    }

    /// Whether `poll` reports input: with VTIME 0 only once VMIN bytes are there, as in n_tty.
    pub(crate) fn is_polled_readable(&self) -> bool {
        let (least, time) = (
            self.settings.code(Code::Least),
            self.settings.code(Code::Time),
        );
        let least = if time == 0 {
            usize::from(least).max(1)
        } else {
            1
        };
        match self.is_canonical() {
            true => !self.lines.is_empty(),
            false => self.unread >= least,
        }
    }

    /// Whether each arriving character becomes readable at once and unchanged.
    pub(crate) fn is_transparent(&self) -> bool {
        // With BRKINT a break discards unread bytes.
        const CHANGES: u32 = bits::BRKINT
            | bits::ISTRIP
            | bits::IUCLC
            | bits::IXON
            | bits::IGNCR
            | bits::ICRNL
            | bits::INLCR
            | bits::PARMRK;
        const EDITS: u32 = bits::ISIG | bits::ICANON | bits::ECHO | bits::ECHONL;
        let code = |code| self.settings.code(code);
        self.is_whole
            && self.holds()
            && !self.is_literal
            && self.settings.input & CHANGES == 0
            && self.settings.local & EDITS == 0
            && self.settings.character_mask() == u8::MAX
            && code(Code::Time) == 0
            && code(Code::Least) <= 1
    }

    /// The first held bytes, at most `most`.
    pub(crate) fn first_held(&self, most: usize) -> impl Iterator<Item = u8> {
        let held = self.held.iter().flatten();
        held.copied().take(most)
    }

    /// Whether enough bytes have arrived for a read to return.
    pub fn is_readable(&self) -> bool {
        match self.is_canonical() {
            true => !self.lines.is_empty(),
            false => self.unread >= usize::from(self.settings.code(Code::Least)).max(1),
        }
    }

    /// Whether a read finds the end of input.
    pub fn is_at_end(&self) -> bool {
        self.is_canonical() && self.lines.front().is_some_and(|(len, _)| *len == 0)
    }

    /// Damaged characters so far: without a stop bit, with wrong parity, breaks.
    pub const fn damaged_count(&self) -> [u32; 3] {
        self.damaged
    }

    /// Whether the client's output is stopped, by the other end or by itself.
    pub fn is_stopped(&self) -> bool {
        self.stopped != [false; 2]
    }

    /// Suspends or resumes the client's output (TCOOFF, TCOON).
    pub const fn suspend(&mut self, is_stopped: bool) {
        self.stopped[1] = is_stopped;
    }

    /// Sends the stop or start character of the client's driver (TCIOFF, TCION).
    pub fn send_flow(&mut self, stops: bool) {
        let code = match stops {
            true => Code::Stop,
            false => Code::Start,
        };
        let code = self.settings.code(code);
        if code != DISABLED {
            self.urgent.push(code);
        }
    }

    /// Whether the terminal itself has bytes to send.
    pub(super) fn has_own(&self) -> bool {
        !self.urgent.is_empty() || !self.echo.is_empty() && !self.is_stopped()
    }

    /// Takes the bytes that the terminal itself sends: flow control at once, echo while output is
    /// not stopped.
    pub fn take_own(&mut self) -> Vec<u8> {
        let mut own = core::mem::take(&mut self.urgent);
        if !self.is_stopped() {
            own.append(&mut self.echo);
        }
        own
    }

    /// Applies new settings of the client. Returns the bytes that become readable.
    pub fn set(&mut self, settings: Settings) -> Vec<u8> {
        let was_canonical = self.is_canonical();
        self.settings = settings;
        if !has(settings.input, bits::IXON) {
            self.stopped[0] = false;
        }
        if !self.is_whole || was_canonical == self.is_canonical() {
            return Vec::new();
        }
        self.is_literal = false;
        self.lines.clear();
        if !was_canonical {
            // Bytes that are already there count as a line.
            if self.unread > 0 {
                self.lines.push_back((self.unread, false));
            }
            return Vec::new();
        }
        let ready = core::mem::take(&mut self.line);
        self.unread += ready.len();
        ready
    }

    /// Whether the client reads by lines.
    pub const fn is_canonical(&self) -> bool {
        self.settings.is_canonical()
    }

    /// Number of bytes that a read returns now, at most `wanted`. `None` in canonical mode if no
    /// complete line has arrived.
    pub fn readable(&self, wanted: usize) -> Option<usize> {
        match self.is_canonical() {
            true => self.lines.front().map(|(len, _)| (*len).min(wanted)),
            false => Some(self.unread.min(wanted)),
        }
    }

    /// Records that the client has read `len` bytes, or the end of input.
    pub fn took(&mut self, len: usize) {
        self.unread = self.unread.saturating_sub(len);
        if let Some((left, is_ended)) = self.lines.front_mut() {
            *left = left.saturating_sub(len);
            // A completely read line that ends with an end of file ends with this read.
            if *left == 0 || (*is_ended && len == 0) {
                self.lines.pop_front();
            }
        }
    }

    /// Discards the client's unread bytes.
    pub fn forget(&mut self) {
        self.unread = 0;
        if let Some(held) = &mut self.held {
            held.clear();
        }
        self.line.clear();
        self.lines.clear();
        self.is_literal = false;
    }

    /// Handles the client's last close: the settings stay, waiting bytes are discarded, and the
    /// kernel holds none.
    pub fn close(&mut self) {
        self.forget();
        if self.is_whole {
            self.held = Some(VecDeque::new());
        }
        self.stopped = [false; 2];
        self.echo.clear();
        self.urgent.clear();
    }

    /// Returns the bytes on the line for `bytes` of the client.
    pub fn send(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mask = self.settings.character_mask();
        self.count_cut(bytes);
        if !self.is_whole || !has(self.settings.output, bits::OPOST) {
            return bytes.iter().map(|byte| byte & mask).collect();
        }
        let mut sent = Vec::with_capacity(bytes.len());
        for &byte in bytes {
            self.output(byte, &mut sent);
        }
        sent.iter_mut().for_each(|byte| *byte &= mask);
        sent
    }

    /// Processes arriving bytes with damaged characters among them.
    pub fn receive(&mut self, bytes: &[u8], marks: &[Mark]) -> Received {
        self.count_cut(bytes);
        let mut received = Received::default();
        let mut marks = marks.iter().peekable();
        for place in 0..=bytes.len() {
            while let Some(mark) =
                marks.next_if(|mark| mark.before <= place || place == bytes.len())
            {
                self.damaged(*mark, &mut received);
            }
            if let Some(&byte) = bytes.get(place) {
                self.character(byte & self.settings.character_mask(), &mut received);
            }
        }
        received
    }

    /// Counts characters that lose bits because the line has fewer.
    fn count_cut(&mut self, bytes: &[u8]) {
        let mask = self.settings.character_mask();
        self.cut += bytes.iter().filter(|&&byte| byte & !mask != 0).count() as u64;
    }

    /// Number of characters so far, in both directions, that lost bits because the client uses
    /// fewer than eight.
    pub const fn cut(&self) -> u64 {
        self.cut
    }

    /// Processes a character that the UART reports as damaged.
    fn damaged(&mut self, mark: Mark, received: &mut Received) {
        let input = self.settings.input;
        let value = mark.value & self.settings.character_mask();
        let is_marked = has(input, bits::PARMRK);
        self.damaged[match mark.damage {
            MarkDamage::Framing => 0,
            MarkDamage::Parity => 1,
            MarkDamage::Break => 2,
        }] += 1;
        match mark.damage {
            MarkDamage::Break if has(input, bits::IGNBRK) => {}
            MarkDamage::Break if has(input, bits::BRKINT) => {
                received.ready.clear();
                received.flushes = true;
                self.forget();
            }
            MarkDamage::Break if is_marked => self.put_all(&[0xFF, 0, 0], received),
            MarkDamage::Break => self.put_all(&[0], received),
            _ if !has(input, bits::INPCK) => self.put_all(&[value], received),
            _ if has(input, bits::IGNPAR) => {}
            _ if is_marked => self.put_all(&[0xFF, 0, value], received),
            _ => self.put_all(&[0], received),
        }
    }

    /// Processes an undamaged character.
    fn character(&mut self, byte: u8, received: &mut Received) {
        if !self.is_whole {
            // The kernel does the other work, except for steps that would destroy the marks.
            let is_marked = has(self.settings.input, bits::PARMRK);
            let strips = is_marked && has(self.settings.input, bits::ISTRIP);
            let byte = if strips { byte & 0x7F } else { byte };
            return self.put_doubled(byte, received);
        }
        self.discipline(byte, received);
    }

    /// Makes an undamaged character readable; doubles it if it looks like a mark.
    fn put_doubled(&mut self, byte: u8, received: &mut Received) {
        match byte == 0xFF && has(self.settings.input, bits::PARMRK) {
            true => self.put_all(&[byte, byte], received),
            false => self.put_all(&[byte], received),
        }
    }

    /// Makes a group of characters readable, or none of them.
    fn put_all(&mut self, bytes: &[u8], received: &mut Received) {
        if !self.is_whole {
            received.ready.extend_from_slice(bytes);
            return;
        }
        if self.unread + self.line.len() + bytes.len() > HOLDS {
            received.lost += 1;
        } else if self.is_canonical() {
            self.line.extend_from_slice(bytes);
        } else {
            self.unread += bytes.len();
            received.ready.extend_from_slice(bytes);
        }
    }

    /// Makes the current line readable.
    fn end_line(&mut self, is_ended: bool, received: &mut Received) {
        let len = self.line.len();
        self.lines.push_back((len, is_ended));
        self.unread += len;
        received.ready.append(&mut self.line);
    }
}

#[cfg(test)]
mod tests;
