//! Hex text in the forms in which people paste it.
//!
//! ```text
//! AB 24 0A 00 D9                      pairs; also AB240A00D9, AB:24:0A, AB,24,0A
//! 0xAB, 0x24, 0x0A                    numbers of C or Python, in brackets or in an array
//! \xAB\x24\n                          escapes; plain characters too if in quotes
//! [12:11:23.000501] TX: AB 24 0A      a time and a direction before the bytes
//! AB 24 0A   // set the motors        a comment
//! ```
//!
//! A line with a time or a direction begins a message; lines without either continue it. In a file
//! without times and directions, each line is a message, unless the lines are only wrapped.

mod base;
mod clock;
mod column;
mod dates;
mod ellipsis;
mod ends;
mod leading;
mod literal;
pub(super) mod log;
mod prefix;
mod tokens;

use super::imported::{ImportError, Imported, Options, Untimed};
use super::text::{Line, lines, utf8};
use super::{LOCAL, Look};
use crate::Kind;
pub(super) use base::{Around, Base, of as base_of};
use clock::Years;
pub(super) use clock::{Clock, Turns, scaled};
use column::without_column;
pub(super) use dates::Dates;
use ellipsis::Cuts;
pub(super) use ends::Ends;
use prefix::Prefix;
pub(super) use prefix::{split as split_prefix, split_text};
use tokens::Found;
pub(super) use tokens::escape;

/// A message of the file.
pub(super) struct Message<'a> {
    line: Line<'a>,
    at: Option<(u64, Clock)>,
    is_sent: Option<bool>,
    is_arrow: bool,
    bytes: Vec<u8>,
}

impl<'a> Message<'a> {
    pub(super) const fn new(
        line: Line<'a>,
        at: Option<(u64, Clock)>,
        is_sent: Option<bool>,
        bytes: Vec<u8>,
    ) -> Self {
        Self {
            line,
            at,
            is_sent,
            is_arrow: false,
            bytes,
        }
    }
}

/// Reason why the numbers of a text are not read, if their base is ambiguous.
pub(super) fn doubt(bytes: &[u8]) -> Option<String> {
    let text = core::str::from_utf8(bytes).ok()?;
    let is_number = |c: char| c.is_ascii_digit() || c.is_whitespace() || ",;:-".contains(c);
    let is_numbers = !text.is_empty() && text.chars().all(is_number);
    base_of(text.lines(), Around::Nothing)
        .err()
        .filter(|_| is_numbers)
}

/// Decodes the bytes of a text in a base.
pub(super) fn bytes_of(text: &str, base: Base) -> Result<Vec<u8>, String> {
    tokens::read(text, base).map(|found| found.bytes)
}

/// Whether words describe bytes that the host sent; `None` if they do not describe a direction.
pub(super) fn is_sent(words: &str) -> Option<bool> {
    log::stamp(&format!("{words} ")).is_sent
}

/// Adds records of messages that a reader of another format found.
///
/// # Errors
/// If some have a time or a direction, and others have none.
pub(super) fn emit(
    messages: Vec<Message<'_>>,
    options: &Options,
    out: &mut Imported,
) -> Result<(), ImportError> {
    let mut whole = Whole {
        messages,
        has_marks: true,
        ..Whole::default()
    };
    whole.add_pauses();
    whole.messages.retain(|one| !one.bytes.is_empty());
    let has_directions = whole.messages.iter().any(|one| one.is_sent.is_some());
    let lost = whole.messages.iter().find(|one| one.is_sent.is_none());
    if let Some(lost) = lost.filter(|_| has_directions) {
        return Err(lost.line.wrong(
            "these bytes have no direction, others have one: expected TX, RX, send, read or an \
             arrow before them",
        ));
    }
    say_doubts(&whole, out);
    match whole.messages.iter().any(|one| one.at.is_some()) {
        true => timed(&whole, options, out),
        false => {
            untimed(&whole, options, out);
            Ok(())
        }
    }
}

/// Content of a file.
#[derive(Default)]
struct Whole<'a> {
    messages: Vec<Message<'a>>,
    /// Number of bytes whose digits can only be hex: with a letter among them, or a prefix.
    evident: usize,
    /// Groups of more than two digits.
    groups: usize,
    has_marks: bool,
    base: Base,
    /// Whether the base of the numbers is ambiguous.
    is_doubtful: bool,
    /// Whether all directions were arrows without meaning.
    had_arrows: bool,
    /// Notes about the names of the ends.
    notes: Vec<String>,
}

/// Number of bytes without a letter among their digits from which on chance is no explanation: a
/// tenth of a percent.
const PLAIN_MAX: usize = 8;

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    if core::str::from_utf8(bytes).is_err() {
        return None;
    }
    let (whole, bad) = parse(bytes);
    let count: usize = whole.messages.iter().map(|one| one.bytes.len()).sum();
    // One unreadable line among some is damage of that line, not another format. Numbers of an
    // unknown base are no damage.
    let (bad_share, of) = match whole.is_doubtful {
        true => (bad.len() * 10, whole.messages.len()),
        false => (bad.len() * 4, whole.messages.len() + bad.len()),
    };
    if count == 0 || bad_share > of {
        return None;
    }
    if matches!(whole.base, Base::Decimal | Base::Octal | Base::Binary) {
        let is_list = bytes.trim_ascii_start().starts_with(b"[");
        let is_told = whole.messages.iter().all(|one| one.is_sent.is_some());
        let is_binary = whole.base == Base::Binary && is_told;
        return Some(if is_list || is_binary {
            Look::Surely
        } else {
            Look::Perhaps
        });
    }
    // TX or RX before nothing but pairs of digits: not text that happens to be digits.
    let has = |is_sent| {
        whole
            .messages
            .iter()
            .any(|one| one.is_sent == Some(is_sent))
    };
    let has_both = has(true) && has(false);
    let is_told = |one: &Message<'_>| one.is_sent.is_some() && (!one.is_arrow || has_both);
    let is_hex = matches!(whole.base, Base::Hex) && bad.is_empty();
    let is_directed = is_hex && whole.messages.iter().all(is_told);
    let is_marked = whole.has_marks || whole.evident * 8 >= count || is_directed;
    // Times before pairs of digits: few devices send text like this.
    let is_timed = is_hex && whole.groups == 0 && whole.messages.iter().all(|one| one.at.is_some());
    let has_zeros = || {
        whole
            .messages
            .iter()
            .any(|one| one.bytes.iter().any(|byte| *byte < 0x10))
    };
    match count {
        0..2 => is_marked.then_some(Look::Perhaps),
        _ if is_marked => Some(Look::Surely),
        _ if is_timed && whole.evident > 0 => Some(Look::Surely),
        2..PLAIN_MAX => Some(Look::Perhaps),
        _ => (is_timed && has_zeros()).then_some(Look::Perhaps),
    }
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    if core::str::from_utf8(bytes).is_err() {
        return Err(ImportError::of_file(
            "expected text of hex digits, found bytes that are no text: --format raw reads them",
        ));
    }
    let (whole, bad) = parse(bytes);
    if let Some(error) = bad.into_iter().next() {
        return Err(error);
    }
    say_doubts(&whole, out);
    let is_timed = whole.messages.iter().any(|one| one.at.is_some());
    match is_timed {
        true => timed(&whole, options, out),
        false => {
            untimed(&whole, options, out);
            Ok(())
        }
    }
}

fn say_doubts(whole: &Whole<'_>, out: &mut Imported) {
    whole.notes.iter().for_each(|note| out.note(note));
    match whole.base {
        Base::Hex if whole.evident == 0 && !whole.has_marks => {
            out.note("no digit is a letter: the digits are taken as hex");
        }
        Base::Hex | Base::Text => {}
        Base::Loose => out.note("hex without leading zeros: each number is taken as a byte"),
        Base::Decimal => out.note("the numbers are taken as decimal: none has a letter or a 0x"),
        Base::Binary => out.note("the numbers are taken as binary: eight digits of 0 and 1 each"),
        Base::Octal => out.note("the numbers are taken as octal: three digits each, as od -b"),
    }
    if whole.had_arrows {
        out.note(
            "the arrow behind the times is taken as the Arduino IDE's and PlatformIO's: all was \
             received; --from program if it was sent",
        );
    }
    if whole.groups > 0 {
        out.note(
            "groups of four or more digits are taken as bytes in the order written; od and \
             hexdump without options swap them: --format hexdump with their offsets",
        );
    }
    if whole.messages.iter().any(|one| one.is_sent.is_some()) {
        out.note("bytes marked as sent go to the device; --from program reverses the directions");
    }
}

fn timed(whole: &Whole<'_>, options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let link = out.link(&options.link, options);
    let first = whole.messages.iter().find_map(|one| one.at);
    let clock = first.map_or(Clock::Seconds, |(_, clock)| clock);
    match clock {
        Clock::Date => out.note(LOCAL),
        Clock::Utc => {}
        Clock::Year => {
            out.note("the dates have no year: times count from 1 January of the first one");
            out.clock = "virtual";
        }
        Clock::Day | Clock::Hour | Clock::Seconds | Clock::Plus => out.clock = "virtual",
    }
    let times = || whole.messages.iter().filter_map(|one| Some(one.at?.0));
    let (mut years, mut turns) = (Years::of(times()), Turns::of(clock, times()));
    for one in &whole.messages {
        let Some((nanos, own)) = one.at else {
            return Err(one.line.wrong("expected a time, as the lines before have"));
        };
        if own != clock {
            return Err(one.line.wrong("expected a time of the same form as before"));
        }
        let nanos = match own {
            Clock::Year => years.nanos(nanos),
            _ => turns.nanos(nanos, one.line.number),
        };
        let direction = options.way(!one.is_sent.unwrap_or(false));
        out.line = one.line.number;
        out.push(link, nanos, direction, Kind::Data, &one.bytes);
    }
    turns.note().into_iter().for_each(|note| out.note(note));
    Ok(())
}

fn untimed(whole: &Whole<'_>, options: &Options, out: &mut Imported) {
    let mut times = Untimed::new(options, out);
    let is_wrapped = is_wrapped(whole);
    for one in &whole.messages {
        let direction = options.way(!one.is_sent.unwrap_or(false));
        if is_wrapped {
            times.stream(direction, &one.bytes, out);
        } else {
            times.push(direction, &one.bytes, out);
            times.pause();
        }
    }
}

/// Whether the lines are one stream that was wrapped at a fixed width. All lines have the same
/// length, except a shorter last one, and the width is one that tools use.
fn is_wrapped(whole: &Whole<'_>) -> bool {
    let Some((last, rest)) = whole.messages.split_last() else {
        return true;
    };
    let Some(first) = rest.first() else {
        return true;
    };
    const WIDTHS: [usize; 8] = [8, 10, 12, 16, 20, 24, 30, 32];
    let width = first.bytes.len();
    let plain = rest
        .iter()
        .all(|one| one.bytes.len() == width && one.is_sent.is_none());
    plain && last.bytes.len() <= width && last.is_sent.is_none() && WIDTHS.contains(&width)
}

/// All messages, and the errors of invalid lines.
fn parse(bytes: &[u8]) -> (Whole<'_>, Vec<ImportError>) {
    let (mut whole, mut bad) = (Whole::default(), Vec::new());
    let mut open: Option<(Line<'_>, Prefix)> = None;
    let mut is_comment = false;
    let has_array = is_array(bytes);
    let texts: Vec<(Line<'_>, String)> = lines(bytes)
        .map(|line| {
            let text = match is_comment {
                true => utf8(line.text),
                false => without_column(utf8(line.text)),
            };
            let text = tokens::without_comments(text, &mut is_comment);
            let text = match has_array {
                true => tokens::inside_braces(&text),
                false => text,
            };
            (line, text)
        })
        .filter(|(_, text)| !text.trim().is_empty())
        .collect();
    let ends = Ends::of(texts.iter().map(|(_, text)| text.as_str()));
    let dates = Dates::of(texts.iter().map(|(_, text)| text.as_str()));
    let mut cuts = Cuts::default();
    let mut texts: Vec<(Line<'_>, String)> = texts
        .into_iter()
        .map(|(line, text)| {
            let text = dates.told(&text);
            let text = ends.told(&text);
            let text = leading::without_count_behind(&text);
            let shown = ellipsis::without(text).inspect(|_| cuts.add(line.number));
            (line, shown.unwrap_or(text).to_owned())
        })
        .collect();
    whole.notes.clone_from(&ends.notes);
    whole.notes.extend(dates.note());
    whole.notes.extend(cuts.note());
    match leading::remove(&mut texts) {
        Ok(note) => whole.notes.extend(note),
        Err((index, message)) => bad.push(texts[index].0.wrong(message)),
    }
    let is_marked = texts
        .iter()
        .any(|(_, text)| prefix::split(text).0 != Prefix::default());
    let around = if is_marked {
        Around::Marks
    } else {
        Around::Nothing
    };
    match base::of(texts.iter().map(|(_, text)| prefix::split(text).1), around) {
        Ok(base) => whole.base = base,
        Err(message) => {
            whole.is_doubtful = true;
            bad.extend(texts.first().map(|(line, _)| line.wrong(message)));
        }
    }
    for (line, text) in &texts {
        let (line, base) = (*line, whole.base);
        let (prefix, body) = prefix::split(text);
        let found = match tokens::read(body, base) {
            Ok(found) => found,
            Err(message) => {
                bad.push(line.wrong(message));
                continue;
            }
        };
        let count = found.bytes.len();
        if let Some(told) = prefix.told.filter(|&told| told > count && count > 0) {
            bad.push(line.wrong(format!(
                "the line announces {told} bytes but contains {count}: the log cuts them; log all \
                 bytes"
            )));
        }
        whole.take(line, prefix, &mut open, found);
    }
    whole.add_pauses();
    whole.messages.retain(|one| !one.bytes.is_empty());
    whole.drop_arrows();
    (whole, bad)
}

/// Whether the text is an array of C: only the text between braces is data.
fn is_array(bytes: &[u8]) -> bool {
    let text = utf8(bytes);
    text.contains('{') && text.contains("[") && text.contains('=') && text.contains("0x")
}

impl<'a> Whole<'a> {
    /// Removes the directions if all of them are arrows to the right.
    fn drop_arrows(&mut self) {
        let told = || self.messages.iter().filter(|one| one.is_sent.is_some());
        if told().count() == 0 || !told().all(|one| one.is_arrow) {
            return;
        }
        self.had_arrows = true;
        self.messages.iter_mut().for_each(|one| one.is_sent = None);
    }

    /// Adds up the times with a plus sign if they are pauses since the line before: they decrease,
    /// or all are the same. Messages without bytes are pauses, too.
    fn add_pauses(&mut self) {
        let mut times: Vec<(usize, u64)> = Vec::new();
        for one in &self.messages {
            match one.at {
                Some((nanos, Clock::Plus)) => times.push((one.line.number, nanos)),
                Some(_) => return,
                None => {}
            }
        }
        times.dedup_by_key(|(line, _)| *line);
        let [(_, first), .., (_, last)] = times[..] else {
            return;
        };
        let is_sorted = times.is_sorted_by_key(|(_, nanos)| *nanos);
        if is_sorted && (first != last || first == 0) {
            self.notes.push(
                "the times with a plus sign never decrease: they are taken as times since the start"
                    .to_owned(),
            );
            return;
        }
        self.notes.push(
            "the times with a plus sign are taken as pauses since the line before, because they \
             do not increase"
                .to_owned(),
        );
        let (mut line, mut sum) = (0, 0_u64);
        for one in &mut self.messages {
            let Some((nanos, _)) = one.at else { continue };
            if one.line.number != line {
                (line, sum) = (one.line.number, sum.saturating_add(nanos));
            }
            one.at = Some((sum, Clock::Seconds));
        }
    }

    /// Adds a line without bytes whose time may be a pause.
    fn pause(&mut self, line: Line<'a>, at: Option<(u64, Clock)>) {
        if let Some((_, Clock::Plus)) = at {
            self.messages.push(Message::new(line, at, None, Vec::new()));
        }
    }

    fn take(
        &mut self,
        line: Line<'a>,
        prefix: Prefix,
        open: &mut Option<(Line<'a>, Prefix)>,
        found: Found,
    ) {
        self.evident += found.evident;
        self.groups += found.groups;
        self.has_marks |= found.has_marks;
        let is_new = prefix.at.is_some() || prefix.is_sent.is_some();
        // A line with only a time or a direction is the head of the lines below.
        if is_new && found.bytes.is_empty() {
            self.pause(line, prefix.at);
            *open = Some((line, prefix));
            return;
        }
        let head = if is_new {
            Some((line, prefix))
        } else {
            open.take()
        };
        match (head, self.messages.last_mut()) {
            (None, Some(last)) if last.at.is_some() || last.is_sent.is_some() => {
                last.bytes.extend(found.bytes);
            }
            (head, _) => {
                let (line, head) = head.unwrap_or((line, Prefix::default()));
                self.messages.push(Message {
                    line,
                    at: head.at,
                    is_sent: head.is_sent,
                    is_arrow: head.is_arrow,
                    bytes: found.bytes,
                });
            }
        }
    }
}

#[cfg(test)]
mod tests;
