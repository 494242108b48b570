use core::fmt::Write as _;

use engine::hex;

/// One step of a session.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Sends bytes back to back on the port with this number.
    Send(usize, Vec<u8>),
    /// Lets this many milliseconds pass.
    Wait(u32),
    /// Damages the next reply of the addressed device.
    Reply(Spoil),
}

/// The damage of a reply. It is defined on the reply, not on bytes, so that it applies to any
/// request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Spoil {
    /// No reply.
    Nothing,
    /// An acknowledgement for any request.
    Acknowledged,
    /// The error frame.
    Error,
    /// Replaces the third byte, the count; data and checksum are adapted.
    Count(u8),
    /// Replaces the register; the checksum is adapted.
    Register(u8),
    /// Flips a bit of a byte; both indices wrap around.
    Flip(u8, u8),
    /// Truncates the reply to this many bytes.
    Cut(u8),
    /// Sends the reply twice.
    Twice,
    /// Sends the reply this many milliseconds later.
    Late(u8),
}

impl Spoil {
    fn to_text(self) -> String {
        match self {
            Self::Nothing => "nothing".to_owned(),
            Self::Acknowledged => "acknowledged".to_owned(),
            Self::Error => "error".to_owned(),
            Self::Count(count) => format!("count {count:02X}"),
            Self::Register(register) => format!("register {register:02X}"),
            Self::Flip(byte, bit) => format!("flip {byte:02X} {bit:02X}"),
            Self::Cut(len) => format!("cut {len:02X}"),
            Self::Twice => "twice".to_owned(),
            Self::Late(ms) => format!("late {ms:02X}"),
        }
    }

    fn parse(words: &[&str]) -> Option<Self> {
        let figures: Option<Vec<u8>> = words.iter().skip(1).map(byte).collect();
        Some(match (*words.first()?, &figures?[..]) {
            ("nothing", []) => Self::Nothing,
            ("acknowledged", []) => Self::Acknowledged,
            ("error", []) => Self::Error,
            ("count", &[count]) => Self::Count(count),
            ("register", &[register]) => Self::Register(register),
            ("flip", &[byte, bit]) => Self::Flip(byte, bit),
            ("cut", &[len]) => Self::Cut(len),
            ("twice", []) => Self::Twice,
            ("late", &[ms]) => Self::Late(ms),
            _ => return None,
        })
    }
}

fn byte(word: &&str) -> Option<u8> {
    hex::byte(word.as_bytes())
}

/// Steps as text, one per line; `ports` are the names of the ports.
pub(super) fn to_text(steps: &[Step], ports: &[&str]) -> String {
    let mut text = String::new();
    for step in steps {
        match step {
            Step::Send(port, bytes) => {
                text += ports[*port];
                if !bytes.is_empty() {
                    text.push(' ');
                }
                text += &hex::pairs(bytes);
            }
            Step::Wait(ms) => {
                write!(text, "wait {ms} ms").expect("a string takes everything");
            }
            Step::Reply(spoil) => {
                text += "reply ";
                text += &spoil.to_text();
            }
        }
        text.push('\n');
    }
    text
}

/// Parses the output of [`to_text`]; `#` begins a comment.
///
/// # Errors
/// A message that names the line and the expected input.
pub(super) fn parse(text: &str, ports: &[&str]) -> Result<Vec<Step>, String> {
    let mut steps = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let said = line.split('#').next().unwrap_or_default();
        let words: Vec<&str> = said.split_whitespace().collect();
        let Some((&first, rest)) = words.split_first() else {
            continue;
        };
        let port = ports.iter().position(|port| *port == first);
        let step = match (port, first, rest) {
            (Some(port), ..) => {
                let bytes: Option<Vec<u8>> = rest.iter().map(byte).collect();
                bytes.map(|bytes| Step::Send(port, bytes))
            }
            (None, "wait", &[ms, "ms"]) => ms.parse().ok().map(Step::Wait),
            (None, "reply", spoil) => Spoil::parse(spoil).map(Step::Reply),
            _ => None,
        };
        steps.push(step.ok_or_else(|| {
            let ports = ports.join(" or ");
            format!(
                "line {number}: \"{}\", expected {ports} with hexadecimal pairs, \"wait N ms\" or \
                 \"reply\" with how it is spoilt",
                said.trim()
            )
        })?);
    }
    Ok(steps)
}
