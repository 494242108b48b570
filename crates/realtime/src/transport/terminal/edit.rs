//! The line discipline: flow control, translation, line editing, echo.

use super::settings::{bits, has};
use super::{Code, DISABLED, Received, Terminal};

/// Columns between two tabulator stops.
const TAB: usize = 8;

impl Terminal {
    /// Processes an undamaged character with the line discipline.
    pub(super) fn discipline(&mut self, byte: u8, received: &mut Received) {
        let mut byte = byte;
        if self.input(bits::ISTRIP) {
            byte &= 0x7F;
        }
        if self.input(bits::IUCLC) && self.local(bits::IEXTEN) {
            byte = byte.to_ascii_lowercase();
        }
        if core::mem::take(&mut self.is_literal) {
            return self.plain(byte, received);
        }
        if self.is_flow_control(byte) || self.is_signal(byte, received) {
            return;
        }
        if self.stopped[0] && self.input(bits::IXON) && self.input(bits::IXANY) {
            self.stopped[0] = false;
        }
        match byte {
            b'\r' if self.input(bits::IGNCR) => return,
            b'\r' if self.input(bits::ICRNL) => byte = b'\n',
            b'\n' if self.input(bits::INLCR) => byte = b'\r',
            _ => {}
        }
        if !self.is_canonical() || !self.edit(byte, received) {
            self.plain(byte, received);
        }
    }

    const fn input(&self, flags: u32) -> bool {
        has(self.settings.input, flags)
    }

    const fn local(&self, flags: u32) -> bool {
        has(self.settings.local, flags)
    }

    const fn is_code(&self, byte: u8, code: Code) -> bool {
        byte != DISABLED && self.settings.code(code) == byte
    }

    fn is_flow_control(&mut self, byte: u8) -> bool {
        if !self.input(bits::IXON) {
            return false;
        }
        let (starts, stops) = (
            self.is_code(byte, Code::Start),
            self.is_code(byte, Code::Stop),
        );
        if starts {
            self.stopped[0] = false;
        } else if stops {
            self.stopped[0] = true;
        }
        starts || stops
    }

    /// No process gets the signal, because the client's terminal has no session; pending input is
    /// still discarded.
    fn is_signal(&mut self, byte: u8, received: &mut Received) -> bool {
        let codes = [Code::Interrupt, Code::Quit, Code::Suspend];
        let is_one = codes.into_iter().any(|code| self.is_code(byte, code));
        if !self.local(bits::ISIG) || !is_one {
            return false;
        }
        if !self.local(bits::NOFLSH) {
            received.ready.clear();
            received.flushes = true;
            self.forget();
            self.echo.clear();
        }
        self.stopped[0] &= !self.input(bits::IXON);
        if self.local(bits::ECHO) {
            self.echo_shown(byte);
        }
        true
    }

    /// Processes a character of the text.
    fn plain(&mut self, byte: u8, received: &mut Received) {
        if self.local(bits::ECHO) {
            match byte {
                b'\n' => self.echo_raw(byte),
                byte => self.echo_shown(byte),
            }
        }
        self.put_doubled(byte, received);
    }

    /// Whether a character edits or ends the line.
    fn edit(&mut self, byte: u8, received: &mut Received) -> bool {
        let extends = self.local(bits::IEXTEN);
        let is = |code| self.is_code(byte, code);
        if is(Code::Erase) || is(Code::Kill) || (extends && is(Code::WordErase)) {
            self.erase(byte);
        } else if extends && is(Code::Literal) {
            self.is_literal = true;
            if self.local(bits::ECHO | bits::ECHOCTL) {
                self.echo_raw(b'^');
                self.echo_raw(8);
            }
        } else if extends && is(Code::Reprint) && self.local(bits::ECHO) {
            self.echo_shown(byte);
            self.echo_raw(b'\n');
            for byte in self.line.clone() {
                self.echo_shown(byte);
            }
        } else if byte == b'\n' {
            if self.local(bits::ECHO) || self.local(bits::ECHONL) {
                self.echo_raw(byte);
            }
            self.put_end(byte, received);
        } else if is(Code::EndOfFile) {
            self.end_line(true, received);
        } else if is(Code::EndOfLine) || (extends && is(Code::SecondEndOfLine)) {
            if self.local(bits::ECHO) {
                self.echo_shown(byte);
            }
            self.put_end(byte, received);
        } else {
            return false;
        }
        true
    }

    /// The end of a line always has room: in a full line it replaces the last character.
    fn put_end(&mut self, byte: u8, received: &mut Received) {
        if self.unread + self.line.len() >= super::HOLDS && self.line.pop().is_some() {
            received.lost += 1;
        }
        self.put_doubled(byte, received);
        self.end_line(false, received);
    }

    fn erase(&mut self, byte: u8) {
        if self.line.is_empty() {
            return;
        }
        let shows = self.local(bits::ECHO);
        if self.is_code(byte, Code::Kill) {
            let wipes = self.local(bits::ECHOK | bits::ECHOKE | bits::ECHOE);
            if shows && !wipes {
                self.echo_shown(byte);
                if self.local(bits::ECHOK) {
                    self.echo_raw(b'\n');
                }
            }
            while let Some(gone) = self.line.pop() {
                self.wipe(gone, shows && wipes);
            }
            return;
        }
        if self.is_code(byte, Code::Erase) {
            let gone = self.line.pop().unwrap_or_default();
            if shows && !self.local(bits::ECHOE) {
                self.echo_shown(byte);
            } else {
                self.wipe(gone, shows);
            }
            return;
        }
        let mut has_word = false;
        while let Some(&last) = self.line.last() {
            let is_word = last.is_ascii_alphanumeric() || last == b'_';
            if has_word && !is_word {
                break;
            }
            has_word |= is_word;
            self.line.pop();
            self.wipe(last, shows);
        }
    }

    /// Removes a character from the screen.
    fn wipe(&mut self, byte: u8, shows: bool) {
        let columns = match byte.is_ascii_control() {
            true if self.local(bits::ECHOCTL) => 2,
            true => 0,
            false => 1,
        };
        for _ in 0..if shows { columns } else { 0 } {
            [8, b' ', 8].iter().for_each(|&byte| self.echo_raw(byte));
        }
    }

    /// Echoes a character, a control character as ^X.
    fn echo_shown(&mut self, byte: u8) {
        if self.local(bits::ECHOCTL) && byte.is_ascii_control() && byte != b'\t' {
            self.echo_raw(b'^');
            self.echo_raw(byte ^ 0o100);
        } else {
            self.echo_raw(byte);
        }
    }

    fn echo_raw(&mut self, byte: u8) {
        if self.echo.len() >= super::HOLDS {
            return;
        }
        let mut echo = core::mem::take(&mut self.echo);
        match has(self.settings.output, bits::OPOST) {
            true => self.output(byte, &mut echo),
            false => echo.push(byte),
        }
        self.echo = echo;
    }

    /// The bytes on the line for a character of the client.
    pub(super) fn output(&mut self, byte: u8, sent: &mut Vec<u8>) {
        let output = |flags| has(self.settings.output, flags);
        match byte {
            b'\n' if output(bits::ONLCR) => {
                self.column = 0;
                sent.extend_from_slice(b"\r\n");
            }
            b'\n' => {
                if output(bits::ONLRET) {
                    self.column = 0;
                }
                sent.push(byte);
            }
            b'\r' if output(bits::ONOCR) && self.column == 0 => {}
            b'\r' if output(bits::OCRNL) => {
                if output(bits::ONLRET) {
                    self.column = 0;
                }
                sent.push(b'\n');
            }
            b'\r' => {
                self.column = 0;
                sent.push(byte);
            }
            b'\t' => {
                let spaces = TAB - self.column % TAB;
                self.column += spaces;
                match output(bits::TABDLY) {
                    true => sent.extend(core::iter::repeat_n(b' ', spaces)),
                    false => sent.push(byte),
                }
            }
            8 => {
                self.column = self.column.saturating_sub(1);
                sent.push(byte);
            }
            byte => {
                let byte = match output(bits::OLCUC) {
                    true => byte.to_ascii_uppercase(),
                    false => byte,
                };
                self.column += usize::from(!byte.is_ascii_control());
                sent.push(byte);
            }
        }
    }
}
