//! Command set of the line-terminated family, in the manner of the HC-05.
//!
//! ```text
//! AT+UART=230400,0,0 CR LF          a setting: its reply is OK CR LF
//! AT+UART CR LF                     a question: +UART:230400,0,0 CR LF OK CR LF
//! ```
//!
//! `AT+BAUDn` and `AT+PINnnnn` of the other families are not understood.

use super::reply::{DIGITS_MAX, Role, decimal};
use super::{BAUD_RATES, NAME_MAX, Parity, put};
use crate::LineConfig;

/// End of every line, in both directions.
pub const LINE_END: [u8; 2] = *b"\r\n";

/// A command of the line-terminated family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineCommand<'a> {
    /// `AT`: are you there?
    Attention,
    /// `AT+VERSION`.
    Version,
    /// `AT+NAME=xyz` or `AT+NAME:xyz`, at most 20 characters.
    Name(&'a [u8]),
    /// `AT+NAME`: asks for the name.
    AskName,
    /// `AT+PSWD="1234"`, four digits in quotes.
    Pin([u8; 4]),
    /// `AT+PSWD`: asks for the PIN.
    AskPin,
    /// `AT+UART=rate,stop,parity`: stop 0 is one stop bit, 1 two; parity 0 none, 1 odd, 2 even.
    Uart(LineConfig),
    /// `AT+UART`: asks for the line coding.
    AskUart,
    /// `AT+ROLE`: asks for the role.
    AskRole,
    /// `AT+ADDR`: asks for the address.
    AskAddress,
    /// `AT+ORGL`: restores the default settings.
    Restore,
    /// `AT+RESET`: start again.
    Reset,
}

impl<'a> LineCommand<'a> {
    /// The command of `line`, without its line end, if any. A question may end in `?`.
    pub fn parse(line: &'a [u8]) -> Option<Self> {
        let rest = line.strip_prefix(b"AT")?;
        if rest.is_empty() {
            return Some(Self::Attention);
        }
        let rest = rest.strip_prefix(b"+")?;
        let name_len = rest.iter().take_while(|byte| byte.is_ascii_uppercase());
        let (name, argument) = rest.split_at(name_len.count());
        match argument {
            [] | [b'?'] => Self::question(name),
            [b'=', value @ ..] => Self::setting(name, value),
            [b':', value @ ..] if name == b"NAME" => Self::setting(name, value),
            _ => None,
        }
    }

    fn question(name: &[u8]) -> Option<Self> {
        match name {
            b"VERSION" => Some(Self::Version),
            b"NAME" => Some(Self::AskName),
            b"PSWD" => Some(Self::AskPin),
            b"UART" => Some(Self::AskUart),
            b"ROLE" => Some(Self::AskRole),
            b"ADDR" => Some(Self::AskAddress),
            b"ORGL" => Some(Self::Restore),
            b"RESET" => Some(Self::Reset),
            _ => None,
        }
    }

    fn setting(name: &[u8], value: &'a [u8]) -> Option<Self> {
        match name {
            b"NAME" => {
                let is_line = value.iter().all(|byte| !LINE_END.contains(byte));
                (is_line && (1..=NAME_MAX).contains(&value.len())).then_some(Self::Name(value))
            }
            b"PSWD" => {
                let [b'"', pin @ .., b'"'] = value else {
                    return None;
                };
                let pin = <[u8; 4]>::try_from(pin).ok()?;
                pin.iter().all(u8::is_ascii_digit).then_some(Self::Pin(pin))
            }
            b"UART" => uart(value).map(Self::Uart),
            _ => None,
        }
    }

    /// Writes the command with its line end into the front of `out` and returns its length. `None`
    /// if `out` is too small or an argument is not allowed.
    pub fn encode(self, out: &mut [u8]) -> Option<usize> {
        let len = match self {
            Self::Attention => put(out, &[b"AT", &LINE_END]),
            Self::Version => put(out, &[b"AT+VERSION", &LINE_END]),
            Self::Name(name) => put(out, &[b"AT+NAME=", name, &LINE_END]),
            Self::AskName => put(out, &[b"AT+NAME", &LINE_END]),
            Self::Pin(pin) => put(out, &[b"AT+PSWD=\"", &pin, b"\"", &LINE_END]),
            Self::AskPin => put(out, &[b"AT+PSWD", &LINE_END]),
            Self::Uart(line) => put_uart(out, b"AT+UART=", line, &[&LINE_END]),
            Self::AskUart => put(out, &[b"AT+UART", &LINE_END]),
            Self::AskRole => put(out, &[b"AT+ROLE", &LINE_END]),
            Self::AskAddress => put(out, &[b"AT+ADDR", &LINE_END]),
            Self::Restore => put(out, &[b"AT+ORGL", &LINE_END]),
            Self::Reset => put(out, &[b"AT+RESET", &LINE_END]),
        }?;
        let line = &out[..len - LINE_END.len()];
        (LineCommand::parse(line) == Some(self)).then_some(len)
    }
}

/// A reply of the line-terminated family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineReply<'a> {
    /// `OK`.
    Done,
    /// `VERSION:3.0-20170609`, then `OK`.
    Version(&'a str),
    /// `+NAME:xyz`, then `OK`.
    Name(&'a [u8]),
    /// `+PIN:"1234"`, then `OK`.
    Pin([u8; 4]),
    /// `+UART:38400,0,0`, then `OK`.
    Uart(LineConfig),
    /// `+ROLE:0`, then `OK`.
    Role(Role),
    /// `+ADDR:98d3:31:f0a1b2`, then `OK`; a guess, in the layout of the HC-05.
    Address([u8; 6]),
    /// `ERROR:(0)`, as in the HC-05: a guess, no report has the exact text.
    Unknown,
}

impl LineReply<'_> {
    /// Writes the reply with its line ends into the front of `out` and returns its length. `None`
    /// if `out` is too small or a value is not allowed.
    pub fn encode(self, out: &mut [u8]) -> Option<usize> {
        const OK: &[u8] = b"\r\nOK\r\n";
        match self {
            Self::Done => put(out, &[b"OK\r\n"]),
            Self::Version(version) => put(out, &[b"VERSION:", version.as_bytes(), OK]),
            Self::Name(name) => put(out, &[b"+NAME:", name, OK]),
            Self::Pin(pin) => put(out, &[b"+PIN:\"", &pin, b"\"", OK]),
            Self::Uart(line) => put_uart(out, b"+UART:", line, &[OK]),
            Self::Role(Role::Slave) => put(out, &[b"+ROLE:0", OK]),
            Self::Role(Role::Master) => put(out, &[b"+ROLE:1", OK]),
            Self::Address(address) => {
                let mut hex = [[0; 2]; 6];
                for (pair, byte) in hex.iter_mut().zip(address) {
                    *pair = [byte >> 4, byte & 0xF].map(|n| b"0123456789abcdef"[usize::from(n)]);
                }
                let [a, b, c, d, e, f] = &hex;
                put(out, &[b"+ADDR:", a, b, b":", c, b":", d, e, f, OK])
            }
            Self::Unknown => put(out, &[b"ERROR:(0)\r\n"]),
        }
    }
}

/// Line coding from `rate,stop,parity`.
fn uart(value: &[u8]) -> Option<LineConfig> {
    let mut fields = value.split(|&byte| byte == b',');
    let rate = fields.next()?;
    let (stop, parity) = (fields.next()?, fields.next()?);
    if fields.next().is_some() {
        return None;
    }
    let mut digits = [0; DIGITS_MAX];
    let baud = BAUD_RATES
        .into_iter()
        .find(|&known| decimal(known, &mut digits) == rate)?;
    let stop_bits = match stop {
        b"0" => 1,
        b"1" => 2,
        _ => return None,
    };
    let parity = match parity {
        b"0" => Parity::None,
        b"1" => Parity::Odd,
        b"2" => Parity::Even,
        _ => return None,
    };
    Some(LineConfig {
        baud,
        data_bits: 8,
        parity,
        stop_bits,
    })
}

/// Writes `prefix`, the line coding and `suffix`.
fn put_uart(out: &mut [u8], prefix: &[u8], line: LineConfig, suffix: &[&[u8]]) -> Option<usize> {
    let stop: &[u8] = match line.stop_bits {
        1 => b",0",
        2 => b",1",
        _ => return None,
    };
    let parity: &[u8] = match line.parity {
        Parity::None => b",0",
        Parity::Odd => b",1",
        Parity::Even => b",2",
    };
    let mut digits = [0; DIGITS_MAX];
    let rate = decimal(line.baud, &mut digits);
    let len = put(out, &[prefix, rate, stop, parity])?;
    Some(len + put(&mut out[len..], suffix)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIN: [u8; 4] = *b"1234";

    #[track_caller]
    fn assert_reply(reply: LineReply<'_>, expected: &str) {
        let mut out = [0xA5; 64];
        let len = reply.encode(&mut out).expect("fits");
        assert_eq!(str::from_utf8(&out[..len]), Ok(expected));
    }

    /// Requests as reported for the 3.0-20170609 firmware.
    #[test]
    fn reported_requests_are_understood() {
        let at_230400 = LineConfig::new_8n1(230_400);
        let cases: [(&[u8], LineCommand<'_>); 6] = [
            (b"AT+UART=230400,0,0", LineCommand::Uart(at_230400)),
            (b"AT+PSWD=\"1234\"", LineCommand::Pin(PIN)),
            (b"AT+NAME=x", LineCommand::Name(b"x")),
            (b"AT+NAME:x", LineCommand::Name(b"x")),
            (b"AT+NAME", LineCommand::AskName),
            (b"AT+ORGL", LineCommand::Restore),
        ];
        for (line, command) in cases {
            assert_eq!(LineCommand::parse(line), Some(command));
        }
    }

    #[test]
    fn the_other_families_settings_are_not_understood() {
        assert_eq!(LineCommand::parse(b"AT+BAUD8"), None);
        assert_eq!(LineCommand::parse(b"AT+PIN1234"), None);
        assert_eq!(LineCommand::parse(b"AT+UART=230401,0,0"), None);
        assert_eq!(LineCommand::parse(b"AT+UART=9600,0,0,0"), None);
        assert_eq!(LineCommand::parse(b"AT+PSWD=\""), None);
    }

    /// Replies as reported for the 3.0-20170609 firmware.
    #[test]
    fn replies_are_the_reported_ones() {
        let version = LineReply::Version("3.0-20170609");
        assert_reply(version, "VERSION:3.0-20170609\r\nOK\r\n");
        assert_reply(LineReply::Pin(PIN), "+PIN:\"1234\"\r\nOK\r\n");
        let uart = LineReply::Uart(LineConfig::new_8n1(38_400));
        assert_reply(uart, "+UART:38400,0,0\r\nOK\r\n");
    }

    #[test]
    fn a_command_survives_encoding_and_parsing() {
        let line = LineConfig {
            baud: 57_600,
            data_bits: 8,
            parity: Parity::Even,
            stop_bits: 2,
        };
        let mut out = [0; 40];
        let len = LineCommand::Uart(line).encode(&mut out).expect("fits");
        assert_eq!(&out[..len], b"AT+UART=57600,1,2\r\n");
        assert_eq!(
            LineCommand::parse(&out[..len - 2]),
            Some(LineCommand::Uart(line))
        );
    }

    /// Finding T2: every question and order without an argument, with and without a question mark.
    #[test]
    fn each_question_has_its_word() {
        let cases: [(&[u8], LineCommand<'_>); 9] = [
            (b"AT", LineCommand::Attention),
            (b"AT+VERSION", LineCommand::Version),
            (b"AT+NAME", LineCommand::AskName),
            (b"AT+PSWD", LineCommand::AskPin),
            (b"AT+UART", LineCommand::AskUart),
            (b"AT+ROLE", LineCommand::AskRole),
            (b"AT+ADDR", LineCommand::AskAddress),
            (b"AT+ORGL", LineCommand::Restore),
            (b"AT+RESET", LineCommand::Reset),
        ];
        for (line, command) in cases {
            assert_eq!(LineCommand::parse(line), Some(command));
            let mut out = [0; 40];
            let len = command.encode(&mut out).expect("fits");
            assert_eq!((&out[..len - 2], &out[len - 2..len]), (line, &b"\r\n"[..]));
        }
        assert_eq!(LineCommand::parse(b"AT+ROLE?"), Some(LineCommand::AskRole));
        assert_eq!(LineCommand::parse(b"AT+ROLE??"), None);
        assert_eq!(LineCommand::parse(b"AT+ROLE:1"), None);
        assert_eq!(LineCommand::parse(b"AT+role"), None);
    }

    /// Finding T2: two stop bits are 1, parity odd is 1 and even 2; others do not exist.
    #[test]
    fn a_line_coding_has_three_figures() {
        let line = |parity, stop_bits| LineConfig {
            parity,
            stop_bits,
            ..LineConfig::new_8n1(9_600)
        };
        let parsed = |bytes| match LineCommand::parse(bytes) {
            Some(LineCommand::Uart(line)) => Some(line),
            _ => None,
        };
        assert_eq!(parsed(b"AT+UART=9600,1,0"), Some(line(Parity::None, 2)));
        assert_eq!(parsed(b"AT+UART=9600,0,1"), Some(line(Parity::Odd, 1)));
        assert_eq!(parsed(b"AT+UART=9600,0,2"), Some(line(Parity::Even, 1)));
        assert_eq!(parsed(b"AT+UART=9600,2,0"), None);
        assert_eq!(parsed(b"AT+UART=9600,0,3"), None);
        assert_eq!(parsed(b"AT+UART=9600,0"), None);
        assert_reply(
            LineReply::Uart(line(Parity::Odd, 2)),
            "+UART:9600,1,1\r\nOK\r\n",
        );
        assert_eq!(
            LineReply::Uart(line(Parity::None, 0)).encode(&mut [0; 40]),
            None
        );
    }

    /// Finding T2: an address has a digit for each half of each byte.
    #[test]
    fn an_address_is_twelve_digits() {
        let address = LineReply::Address([0x98, 0xD3, 0x31, 0xF0, 0xA1, 0xB2]);
        assert_reply(address, "+ADDR:98d3:31:f0a1b2\r\nOK\r\n");
        let address = LineReply::Address([0x01, 0x23, 0x45, 0x67, 0x8C, 0xEF]);
        assert_reply(address, "+ADDR:0123:45:678cef\r\nOK\r\n");
    }

    #[test]
    fn short_replies_have_their_words() {
        assert_reply(LineReply::Done, "OK\r\n");
        assert_reply(LineReply::Unknown, "ERROR:(0)\r\n");
        assert_reply(LineReply::Name(b"abc"), "+NAME:abc\r\nOK\r\n");
        assert_reply(LineReply::Role(Role::Slave), "+ROLE:0\r\nOK\r\n");
        assert_reply(LineReply::Role(Role::Master), "+ROLE:1\r\nOK\r\n");
    }

    /// A name has 1 to 20 characters and no line end; a PIN is four digits in quotes.
    #[test]
    fn settings_have_their_limits() {
        let parse = LineCommand::parse;
        assert!(parse(b"AT+NAME=01234567890123456789").is_some());
        assert_eq!(parse(b"AT+NAME=012345678901234567890"), None);
        assert_eq!((parse(b"AT+NAME="), parse(b"AT+NAME=a\rb")), (None, None));
        assert_eq!(parse(b"AT+PSWD=\"12a4\""), None);
        assert_eq!(parse(b"AT+PSWD=\"123\""), None);
        assert_eq!(parse(b"AT+PSWD:\"1234\""), None);
        let mut out = [0; 40];
        assert_eq!(LineCommand::Name(b"a\nb").encode(&mut out), None);
        assert_eq!(LineCommand::Pin(*b"12a4").encode(&mut out), None);
    }
}
