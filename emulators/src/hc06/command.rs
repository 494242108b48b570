//! Command mode: end of a command, its effect, and its errors.

use core::time::Duration;

use protocols::Instant;
use protocols::hc06::{Command, Family, LINE_END, LineCommand, LineReply, Reply, Role};

use super::{Profile, Settings};

/// Longest text examined; the longest command, `AT+NAME` and 20 characters, has 27 bytes.
const TEXT_MAX: usize = 64;
/// Longest reply, a name with its frame in the line-terminated family.
const REPLY_MAX: usize = 64;

/// Collects the bytes of the UART until a command ends.
#[derive(Clone, Debug)]
pub(super) struct Collector {
    family: Family,
    silence: Duration,
    text: Vec<u8>,
    /// Bytes that came since the last end, those beyond [`TEXT_MAX`] included.
    count: u64,
    first: Instant,
    last: Instant,
    /// The line-terminated family waits on after a silence, which is judged once.
    silence_seen: bool,
}

/// Error: the bytes must be checked one by one, because a line end may be among them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LineEndMatters;

/// Bytes between two ends of a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Attempt {
    /// The bytes, cut after [`TEXT_MAX`].
    pub(super) text: Vec<u8>,
    /// Number of the bytes.
    pub(super) count: u64,
    /// Time between the first and the last.
    pub(super) took: Duration,
    /// Whether a line end closed it.
    pub(super) end: End,
}

/// End of an attempt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    Silence,
    Line,
}

impl Collector {
    pub(super) fn new(profile: &Profile) -> Self {
        Self {
            family: profile.family,
            silence: profile.silence,
            text: Vec::new(),
            count: 0,
            first: Instant::ZERO,
            last: Instant::ZERO,
            silence_seen: false,
        }
    }

    /// Time at which silence ends the text.
    pub(super) fn deadline(&self) -> Option<Instant> {
        (self.count > 0 && !self.silence_seen).then(|| self.last + self.silence)
    }

    /// Handles a silence over its limit: returns the bytes that it ended. In the line-terminated
    /// family the bytes stay, because the silence only interrupted them.
    pub(super) fn silence(&mut self) -> Attempt {
        if self.family != Family::V30 {
            return self.finish(End::Silence);
        }
        self.silence_seen = true;
        self.clone().finish(End::Silence)
    }

    /// Takes one byte; returns the attempt if a line end completed it.
    pub(super) fn push(&mut self, byte: u8, at: Instant) -> Option<Attempt> {
        if self.count == 0 {
            self.first = at;
        }
        self.count += 1;
        self.last = at;
        self.silence_seen = false;
        if self.text.len() < TEXT_MAX {
            self.text.push(byte);
        } else if self.family == Family::V30 {
            // The end of an overlong line must still be seen.
            self.text.rotate_left(1);
            self.text[TEXT_MAX - 1] = byte;
        }
        if self.family != Family::V30 || !self.text.ends_with(&LINE_END) {
            return None;
        }
        let mut attempt = self.finish(End::Line);
        attempt.text.truncate(attempt.text.len() - LINE_END.len());
        Some(attempt)
    }

    /// Takes bytes that came back to back, the last of them at `last`, if none can end a command.
    /// `Err` if a line end may be among them; then it takes none.
    pub(super) fn push_all(
        &mut self,
        bytes: &[u8],
        first: Instant,
        last: Instant,
    ) -> Result<(), LineEndMatters> {
        if self.family == Family::V30 {
            return Err(LineEndMatters);
        }
        if self.count == 0 {
            self.first = first;
        }
        self.count += bytes.len() as u64;
        self.last = last;
        let room = TEXT_MAX - self.text.len();
        self.text.extend_from_slice(&bytes[..bytes.len().min(room)]);
        Ok(())
    }

    /// Bytes collected since the last end.
    pub(super) const fn count(&self) -> u64 {
        self.count
    }

    /// Whether the last byte made the text too long for any command.
    pub(super) const fn just_overflowed(&self) -> bool {
        self.count == TEXT_MAX as u64 + 1
    }

    /// Ends the collected attempt.
    fn finish(&mut self, end: End) -> Attempt {
        let attempt = Attempt {
            text: core::mem::take(&mut self.text),
            count: self.count,
            took: self.last - self.first,
            end,
        };
        self.count = 0;
        attempt
    }

    /// Discards the collected bytes.
    pub(super) fn clear(&mut self) {
        self.text.clear();
        self.count = 0;
    }
}

/// Effect of a command on the module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Answer {
    /// Text for the UART.
    pub(super) reply: Vec<u8>,
    /// The settings afterwards.
    pub(super) settings: Settings,
    /// Whether the module starts again.
    pub(super) restart: Restart,
}

/// Whether a command restarts the module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Restart {
    No,
    Yes,
}

/// Executes `attempt`; `None` if it is no command of the module's family.
pub(super) fn execute(attempt: &Attempt, settings: &Settings, profile: &Profile) -> Option<Answer> {
    let mut answer = Answer {
        reply: Vec::new(),
        settings: settings.clone(),
        restart: Restart::No,
    };
    let mut out = [0; REPLY_MAX];
    let len = if profile.family == Family::V30 {
        if attempt.end == End::Silence {
            return None;
        }
        let command = LineCommand::parse(whole(attempt)?)?;
        execute_line(command, &mut answer, profile).encode(&mut out)
    } else {
        if attempt.took > profile.command_time {
            return None;
        }
        let command = known(profile.family, whole(attempt)?)?;
        execute_silent(command, &mut answer.settings).encode(&profile.texts, &mut out)
    };
    let len = len.expect("REPLY_MAX covers every reply to what was parsed");
    answer.reply = out[..len].to_vec();
    Some(answer)
}

/// The text unless it was cut.
fn whole(attempt: &Attempt) -> Option<&[u8]> {
    (attempt.count <= TEXT_MAX as u64).then_some(attempt.text.as_slice())
}

/// The silence-terminated command of `family` with this `text`. No HC-06 can become a master: two
/// of them cannot connect to each other.
fn known(family: Family, text: &[u8]) -> Option<Command<'_>> {
    Command::parse(text).filter(|command| {
        command.is_known_to(family) && !matches!(command, Command::Role(Role::Master))
    })
}

fn execute_silent(command: Command<'_>, settings: &mut Settings) -> Reply {
    match command {
        Command::Attention => Reply::Attention,
        Command::Version => Reply::Version,
        Command::Name(name) => {
            settings.name = name.to_vec();
            Reply::NameSet
        }
        Command::Pin(pin) => {
            settings.pin = pin;
            Reply::PinSet
        }
        Command::Baud(rate) => {
            settings.line.baud = rate;
            Reply::Baud(rate)
        }
        Command::Parity(parity) => {
            settings.line.parity = parity;
            Reply::Parity(parity)
        }
        Command::Role(role) => Reply::Role(role),
        Command::Led(led) => {
            settings.led = led;
            Reply::Led(led)
        }
    }
}

fn execute_line<'a>(
    command: LineCommand<'a>,
    answer: &'a mut Answer,
    profile: &Profile,
) -> LineReply<'a> {
    let settings = &mut answer.settings;
    match command {
        LineCommand::Attention => LineReply::Done,
        LineCommand::Version => LineReply::Version(profile.texts.version),
        LineCommand::Name(name) => {
            settings.name = name.to_vec();
            LineReply::Done
        }
        LineCommand::AskName => LineReply::Name(&settings.name),
        LineCommand::Pin(pin) => {
            settings.pin = pin;
            LineReply::Done
        }
        LineCommand::AskPin => LineReply::Pin(settings.pin),
        LineCommand::Uart(line) => {
            settings.line = line;
            LineReply::Done
        }
        LineCommand::AskUart => LineReply::Uart(settings.line),
        LineCommand::AskRole => LineReply::Role(Role::Slave),
        LineCommand::AskAddress => LineReply::Address(profile.address),
        LineCommand::Restore => {
            *settings = Profile::of(Family::V30).settings;
            LineReply::Done
        }
        LineCommand::Reset => {
            answer.restart = Restart::Yes;
            LineReply::Done
        }
    }
}

/// The rule that a refused attempt broke, and the correction; `None` if the bytes were data and no
/// attempt at a command.
pub(super) fn complaint(
    attempt: &Attempt,
    profile: &Profile,
) -> Option<(&'static str, &'static str)> {
    let text = whole(attempt).unwrap_or_default();
    if !text.get(..2)?.eq_ignore_ascii_case(b"AT") {
        return None;
    }
    let is_known = |text: &[u8]| match profile.family {
        Family::V30 => LineCommand::parse(text).is_some(),
        family => known(family, text).is_some(),
    };
    let bare = text.trim_ascii_end();
    let next = (2..bare.len()).find(|&at| bare[at..].starts_with(b"AT") && is_known(&bare[..at]));
    Some(
        if attempt.end == End::Silence && profile.family == Family::V30 {
            ("line-end-missing", "this family waits for CR LF")
        } else if is_known(text) {
            ("command-too-slow", "a command must come without a pause")
        } else if is_known(bare) {
            ("line-end-after-command", "this family wants no line end")
        } else if is_known(&bare.to_ascii_uppercase()) {
            ("lower-case-command", "commands are upper case")
        } else if next.is_some() {
            ("no-pause-between-commands", "one command a second at most")
        } else {
            ("unknown-command", "this family does not know it")
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attempt(text: &[u8]) -> Attempt {
        Attempt {
            text: text.to_vec(),
            count: text.len() as u64,
            took: Duration::ZERO,
            end: End::Silence,
        }
    }

    fn rule(family: Family, text: &[u8]) -> Option<&'static str> {
        complaint(&attempt(text), &Profile::of(family)).map(|(rule, _)| rule)
    }

    /// Scripts match the names of the rules; each rule has its own guilty text.
    #[test]
    fn each_way_to_get_a_command_wrong_has_its_rule() {
        let linvor = Family::Linvor18;
        assert_eq!(rule(linvor, b"AT\r\n"), Some("line-end-after-command"));
        assert_eq!(rule(linvor, b"at+version"), Some("lower-case-command"));
        assert_eq!(
            rule(linvor, b"ATAT+VERSION"),
            Some("no-pause-between-commands")
        );
        assert_eq!(rule(linvor, b"AT+LED0"), Some("unknown-command"));
        assert_eq!(rule(linvor, b"AT+ROLE=M"), Some("unknown-command"));
        assert_eq!(rule(linvor, b"PCUI_MSG"), None);
        assert_eq!(rule(linvor, b"A"), None);
        assert_eq!(rule(Family::V30, b"AT"), Some("line-end-missing"));
    }

    /// A line longer than any command is refused, and the next line is read as usual.
    #[test]
    fn an_overlong_line_does_not_hide_the_next_one() {
        let mut collector = Collector::new(&Profile::of(Family::V30));
        let at = Instant::ZERO;
        let mut lines = Vec::new();
        for &byte in [b'A'; 100].iter().chain(b"\r\nAT\r\n") {
            lines.extend(collector.push(byte, at));
        }
        let [overlong, command] = &lines[..] else {
            panic!("two lines, not {}", lines.len());
        };
        assert_eq!((overlong.count, whole(overlong)), (102, None));
        assert_eq!(whole(command), Some(&b"AT"[..]));
    }

    /// Every reply to a command that can be parsed must fit; the longest name is the worst case.
    #[test]
    fn the_longest_name_fits_the_reply() {
        let profile = Profile::of(Family::V30);
        let mut settings = profile.settings.clone();
        settings.name = vec![b'n'; protocols::hc06::NAME_MAX];
        let line = Attempt {
            end: End::Line,
            ..attempt(b"AT+NAME")
        };
        let answer = execute(&line, &settings, &profile).expect("known");
        assert_eq!(answer.reply, b"+NAME:nnnnnnnnnnnnnnnnnnnn\r\nOK\r\n");
    }

    /// 64 bytes may be a command, the 65th makes them too long. The report comes once. Bytes in one
    /// piece count like single bytes.
    #[test]
    fn a_text_is_too_long_with_its_65th_byte() {
        let mut collector = Collector::new(&Profile::of(Family::Linvor18));
        let at = Instant::from_millis(7);
        let too_long = [(); 66].map(|()| {
            assert_eq!(collector.push(b'A', at), None);
            collector.just_overflowed()
        });
        let first = too_long.iter().position(|it| *it);
        assert_eq!(
            (first, too_long[65], collector.count()),
            (Some(64), false, 66)
        );
        let mut whole = Collector::new(&Profile::of(Family::Linvor18));
        assert_eq!(
            whole.push_all(&[b'A'; 60], at, Instant::from_millis(9)),
            Ok(())
        );
        assert_eq!(
            whole.push_all(
                &[b'A'; 5],
                Instant::from_millis(11),
                Instant::from_millis(12)
            ),
            Ok(())
        );
        assert!(whole.just_overflowed());
        let silence = Profile::of(Family::Linvor18).silence;
        assert_eq!(whole.deadline(), Some(Instant::from_millis(12) + silence));
        let attempt = whole.silence();
        assert_eq!((attempt.text.len(), attempt.count), (64, 65));
        assert_eq!(
            (attempt.took, attempt.end),
            (Duration::from_millis(5), End::Silence)
        );
        assert_eq!((whole.count(), whole.deadline()), (0, None));
        let mut lines = Collector::new(&Profile::of(Family::V30));
        assert_eq!(lines.push_all(b"AT", at, at), Err(LineEndMatters));
    }
}
