//! Logs of programs that show bytes among words.
//!
//! ```text
//! [01][03][00][00][00][02][C4][0B]                      libmodbus; received bytes are in < >
//! Tx:000123-01 03 00 00 00 0A C5 CD                     Modbus Poll
//! [12:11:23][D][uart_debug:114]: >>> 55:AA:03:07        ESPHome
//! send: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb                pymodbus
//! 7  0.0001  a.exe  IRP_MJ_WRITE  Serial0  SUCCESS  Length 2: AB 24      Portmon
//! [27/11/2026 12:11:23] Written data (COM3)             serial port monitors of Windows:
//!     ab 24 0a 00 d9               .$...                rows of bytes below their head
//! I (357) uart: ab 24 0a 00 d9                          ESP-IDF
//! 12:11:23.001 port wrote b'AB\x0a'                      literals of Python
//! ```
//!
//! The bytes of a line are its longest run of hex numbers, preferably at its end. A line without
//! such a run is a comment; a note counts the omitted lines. Each message needs a direction or a
//! time.

mod literals;
mod repeats;
pub(super) mod runs;
mod stated;
mod times;
mod words;

use super::clock::{self, Clock};
use super::column::without_column;
use super::dates::Dates;
use super::ellipsis::{self, Cuts};
use super::ends::{Ends, label};
use super::leading;
use super::prefix::{self, Prefix};
use super::{Message, Whole, emit};
use crate::import::Look;
use crate::import::imported::{ImportError, Imported, Options};
use crate::import::text::{Line, lines};
use engine::hex;
use literals::Forms;
use runs::{Run, best, runs};
use stated::told;
use words::{direction, told_by};

/// Bytes of a line, and the text before them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Piece {
    prefix: Prefix,
    bytes: Vec<u8>,
    evident: usize,
    has_marks: bool,
    /// Number of bytes that the line states.
    told: Option<usize>,
    /// Whether no text precedes the bytes.
    is_bare: bool,
    /// Whether the tool cut the bytes.
    is_cut: bool,
}

/// Arrows; arrows of one character count only directly before the bytes.
const ARROWS: [(&str, bool); 10] = [
    (">>>", true),
    ("<<<", false),
    ("-->", true),
    ("<--", false),
    ("==>", true),
    ("<==", false),
    (">>", true),
    ("<<", false),
    ("->", true),
    ("<-", false),
];

/// The text without the colour codes of a terminal.
pub(in crate::import) fn plain(text: &[u8]) -> String {
    let text = String::from_utf8_lossy(text);
    let mut out = String::new();
    let mut rest = &*text;
    while let Some((before, behind)) = rest.split_once("\x1B[") {
        out.push_str(before);
        let end = behind.find(|c: char| c.is_ascii_alphabetic());
        rest = end.map_or("", |end| &behind[end + 1..]);
    }
    out.push_str(rest);
    out
}

/// The text with masks in place of its dates and times, also of one that only begins the line.
fn masked(text: &str) -> String {
    let mut masked = times::masked(text);
    let (prefix, rest) = prefix::split(text);
    let mut head = text.len() - rest.len();
    // Three pairs with colons are a time, too, if a word follows, and no byte.
    let mut words = text.split_whitespace();
    let is_time = words.next().is_some_and(clock::is_time_of_day)
        && words.next().is_some_and(|word| hex::bytes(word).is_none());
    if is_time && prefix.at.is_none() {
        head = text.find(|c: char| c.is_ascii_digit()).unwrap_or(0) + "12:11:23".len();
    }
    if (prefix.at.is_some() || is_time) && text.is_char_boundary(head) {
        let kept = |c: char| if c.is_ascii_digit() { times::MASK } else { c };
        masked = text[..head].chars().map(kept).collect::<String>() + &masked[head..];
    }
    masked
}

/// Bytes of a line that has several directions, each with bytes behind it; otherwise none.
fn directed(text: &str) -> Vec<Piece> {
    let masked = masked(text);
    let (mut found, mut end, mut at) = (Vec::new(), 0, None);
    for run in runs(&masked) {
        let head = &text[end..run.start];
        let prefix = prefix_of(head);
        at = at.or(prefix.at);
        // No bytes in angle brackets.
        let arrow = head.trim_matches(' ');
        let is_bracket = text[run.end..].starts_with('>');
        let is_arrow =
            matches!(arrow, "<" | ">") || ARROWS.iter().any(|(known, _)| *known == arrow);
        let is_told = is_arrow || head.contains(char::is_alphanumeric);
        let is_told = is_told && !is_bracket;
        if prefix.is_sent.is_none() || !is_told || !is_head(&masked[end..run.start]) {
            continue;
        }
        end = run.end;
        found.push(Piece {
            prefix: Prefix { at, ..prefix },
            told: told(head),
            bytes: run.bytes,
            evident: run.evident,
            has_marks: run.has_marks,
            is_bare: false,
            is_cut: ellipsis::begins(&text[run.end..]),
        });
    }
    let is_whole = is_tail(&text[end..], &Run::default());
    if found.len() < 2 || !is_whole {
        found.clear();
    }
    found
}

/// Bytes of a line; `None` if it has none.
fn piece(text: &str) -> Option<Piece> {
    if let Some(piece) = bracketed(text) {
        return Some(piece);
    }
    let masked = masked(text);
    let run = best(&masked)?;
    let (head, tail) = (&text[..run.start], &text[run.end..]);
    if !is_head(&masked[..run.start]) || !is_tail(tail, &run) {
        return None;
    }
    let prefix = prefix_of(head);
    let is_bare = head.trim().is_empty();
    // Words behind bytes without any head: a time of an unknown form, and a message.
    if is_bare && !is_aside(tail) && !is_shown(tail, &run) {
        return None;
    }
    // A decimal figure after words without a direction.
    let is_figure = run.evident == 0 && !run.is_pairs && prefix.is_sent.is_none() && !is_bare;
    if is_figure {
        return None;
    }
    Some(Piece {
        prefix,
        told: told(head).or_else(|| told(tail)),
        is_bare,
        is_cut: ellipsis::begins(tail),
        bytes: run.bytes,
        evident: run.evident,
        has_marks: run.has_marks,
    })
}

/// `[01][03]` or `<01><03>` of libmodbus, and `0 [30] . [14]` of avrdude.
fn bracketed(text: &str) -> Option<Piece> {
    for (open, close, is_sent) in [('[', ']', true), ('<', '>', false)] {
        let mut run = Run::default();
        let (mut rest, mut is_whole) = (text, true);
        while let Some(at) = rest.find(open) {
            let (before, inside) = (&rest[..at], &rest[at + 1..]);
            let digits = inside
                .split_once(close)
                .filter(|(digits, _)| digits.len() == 2 && hex::byte(digits.as_bytes()).is_some());
            let Some((digits, behind)) = digits else {
                is_whole = false;
                break;
            };
            // A single character is the byte as text.
            is_whole &= before.trim().chars().count() <= 1 || run.bytes.is_empty();
            if run.bytes.is_empty() {
                run.end = text.len() - rest.len() + at;
            }
            run.bytes.extend(hex::byte(digits.as_bytes()));
            run.evident += usize::from(digits.bytes().any(|byte| byte.is_ascii_alphabetic()));
            rest = behind;
        }
        if run.bytes.len() < 2 && !text.contains(": ") || !rest.trim().is_empty() || !is_whole {
            continue;
        }
        if run.bytes.is_empty() {
            continue;
        }
        let mut prefix = prefix_of(&text[..run.end]);
        if text.trim_start().starts_with(open) {
            prefix.is_sent = Some(is_sent);
        }
        return Some(Piece {
            prefix,
            bytes: run.bytes,
            evident: run.evident.max(1),
            has_marks: true,
            ..Piece::default()
        });
    }
    None
}

/// Whether bytes may follow this text.
fn is_head(head: &str) -> bool {
    let padded = format!(" {}", head.trim_end());
    if ARROWS
        .iter()
        .any(|(arrow, _)| padded.ends_with(&format!(" {arrow}")))
        || padded.ends_with(" <")
    {
        return true;
    }
    let head = head
        .trim_end()
        .trim_end_matches(['\'', '"', 'b', '[', '{', '(', '<']);
    let head = head.trim_end();
    if head.is_empty() || head.ends_with([':', '-', '>', '<', ']', ')', '=', '|', '}', times::MASK])
    {
        return true;
    }
    let word = head.rsplit(|c: char| !c.is_alphanumeric()).next();
    let word = word.unwrap_or_default().to_ascii_lowercase();
    direction(&word).or_else(|| label(&word)).is_some()
        || matches!(
            word.as_str(),
            "bytes" | "data" | "frame" | "packet" | "buffer" | "payload" | "hex"
        )
}

/// Whether `tail` may follow the bytes: nothing, the same bytes as text, or text in brackets. After
/// a run that is not by chance, any words may follow, but no damaged byte.
fn is_tail(tail: &str, run: &Run) -> bool {
    let is_sure = run.bytes.len() >= 3 || run.has_marks || is_shown(tail, run);
    is_aside(tail) || (!is_damaged(tail) && is_sure)
}

/// Whether a text is nothing, or a remark in brackets.
fn is_aside(tail: &str) -> bool {
    let shown = tail.trim_matches(|c: char| c.is_whitespace() || "]})>'\"|.,;".contains(c));
    shown.is_empty() || shown.starts_with(['(', '<', '#'])
}

/// Whether a text begins with a byte that cannot be read, as the bytes before it: `0`, `??`, `1G`
/// or `116`.
fn is_damaged(tail: &str) -> bool {
    let Some(rest) = tail.strip_prefix(' ').filter(|rest| !rest.starts_with(' ')) else {
        return false;
    };
    let word = rest.split(' ').next().unwrap_or_default();
    let digits = word.chars().filter(|c| c.is_ascii_hexdigit()).count();
    let is_short = matches!(word.len(), 1..=3);
    let is_number = word.starts_with(|c: char| c.is_ascii_digit() || c == '?');
    is_short && is_number && digits + 1 >= word.len() || word == "??"
}

/// Whether `tail` may show the bytes as text.
fn is_shown(tail: &str, run: &Run) -> bool {
    let shown = tail.trim_matches(|c: char| c.is_whitespace() || "]})>'\"|.,;".contains(c));
    shown.chars().count() <= run.bytes.len()
}

/// Time and direction in the text before the bytes: the first time, the last direction.
fn prefix_of(head: &str) -> Prefix {
    let (mut prefix, rest) = prefix::split(head);
    if prefix.at.is_none() {
        prefix.at = clock::within(head);
    }
    prefix.is_arrow = false;
    let before = head
        .trim_end()
        .trim_end_matches(['[', '{', '(', '"', '\''])
        .trim_end();
    let arrow = ARROWS.iter().find(|(arrow, _)| {
        let padded = format!(" {before} ");
        padded.contains(&format!(" {arrow} "))
    });
    let single = match before.chars().next_back() {
        Some('>') => Some(true),
        Some('<') => Some(false),
        _ => None,
    };
    let words = rest.split(|c: char| !c.is_alphanumeric());
    let words: Vec<String> = words
        .filter(|word| !word.is_empty())
        .map(str::to_ascii_lowercase)
        .collect();
    let told = told_by(&words);
    let own = || words.last().and_then(|word| label(word));
    let told = told.or(arrow.map(|(_, is_sent)| *is_sent)).or(single);
    prefix.is_sent = told.or(prefix.is_sent).or_else(own);
    prefix
}

/// Time and direction of a head.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::import) struct Stamp {
    pub(in crate::import) at: Option<(u64, Clock)>,
    pub(in crate::import) is_sent: Option<bool>,
}

/// Time and direction in the words of a head.
pub(in crate::import) fn stamp(text: &str) -> Stamp {
    let Prefix { at, is_sent, .. } = prefix_of(text);
    Stamp { at, is_sent }
}

/// A message that is not complete yet.
struct Open<'a> {
    message: Message<'a>,
    told: Option<usize>,
}

/// All bytes of a line, literals and lists first if the file has some.
fn pieces(text: &str, forms: Forms) -> Vec<Piece> {
    let found = literals::pieces(text, forms);
    if !found.is_empty() {
        return found;
    }
    match directed(text) {
        several if !several.is_empty() => several,
        _ => piece(text).into_iter().collect(),
    }
}

/// All messages, the lines without bytes, and the first error.
fn parse(bytes: &[u8]) -> (Whole<'_>, Vec<Line<'_>>, Option<ImportError>) {
    let (mut whole, mut rest, mut error) = (Whole::default(), Vec::new(), None);
    let mut open: Option<Open<'_>> = None;
    let mut texts: Vec<(Line<'_>, String)> = lines(bytes)
        .map(|line| (line, plain(line.text).trim_end().to_owned()))
        .collect();
    let forms = Forms::of(texts.iter().map(|(_, text)| text.as_str()));
    let ends = Ends::of(texts.iter().map(|(_, text)| text.as_str()));
    whole.notes.clone_from(&ends.notes);
    let dates = Dates::of(texts.iter().map(|(_, text)| text.as_str()));
    whole.notes.extend(dates.note());
    whole.notes.extend(forms.note());
    for (_, text) in &mut texts {
        *text = dates.told(&ends.told(without_column(text))).into_owned();
    }
    // In a log, a marked number may be anything.
    whole
        .notes
        .extend(leading::remove(&mut texts).ok().flatten());
    let mut cuts = Cuts::default();
    for (line, text) in texts {
        if text.is_empty() {
            continue;
        }
        let found = pieces(&text, forms);
        if found.is_empty() {
            let prefix = prefix_of(&text);
            error = error.or(close(open.take(), &mut whole, &mut rest));
            whole.pause(line, prefix.at);
            // A line with only a direction is the head of the lines below.
            if prefix.is_sent.is_some() {
                open = Some(of(line, prefix, told(&text)));
            } else {
                rest.push(line);
            }
        }
        if found.iter().any(|found| found.is_cut) {
            cuts.add(line.number);
        }
        for found in found {
            whole.evident += found.evident;
            whole.has_marks |= found.has_marks;
            let prefix = found.prefix;
            let goes_on = found.is_bare && prefix.is_sent.is_none() && prefix.at.is_none();
            if !goes_on || open.is_none() {
                error = error.or(close(open.take(), &mut whole, &mut rest));
                open = Some(of(line, prefix, found.told));
            }
            if let Some(open) = &mut open {
                open.message.bytes.extend(found.bytes);
            }
        }
    }
    error = error.or(close(open.take(), &mut whole, &mut rest));
    whole.notes.extend(cuts.note());
    whole.add_pauses();
    whole.messages.retain(|one| !one.bytes.is_empty());
    whole.notes.extend(repeats::drop(&mut whole.messages));
    (whole, rest, error)
}

const fn of(line: Line<'_>, prefix: Prefix, told: Option<usize>) -> Open<'_> {
    let message = Message {
        line,
        at: prefix.at,
        is_sent: prefix.is_sent,
        is_arrow: false,
        bytes: Vec::new(),
    };
    Open { message, told }
}

fn close<'a>(
    open: Option<Open<'a>>,
    whole: &mut Whole<'a>,
    rest: &mut Vec<Line<'a>>,
) -> Option<ImportError> {
    let Open { message, told } = open?;
    let found = message.bytes.len();
    if found == 0 {
        rest.push(message.line);
        return None;
    }
    let error = told.filter(|&told| told > found).map(|told| {
        message.line.wrong(format!(
            "the line announces {told} bytes but contains {found}: the log cuts them; log all bytes"
        ))
    });
    whole.messages.push(message);
    error
}

pub(in crate::import) fn look(bytes: &[u8]) -> Option<Look> {
    let head = &bytes[..bytes.len().min(1 << 16)];
    if head.contains(&0) || head.iter().filter(|byte| **byte >= 0x80).count() * 4 > head.len() {
        return None;
    }
    const LINES: usize = 200;
    let mut first: Vec<(Line<'_>, String)> = lines(head)
        .take(LINES)
        .map(|line| (line, without_column(plain(line.text).trim_end()).to_owned()))
        .collect();
    // Only the lines matter here, not the note.
    drop(leading::remove(&mut first));
    let has_bytes = |(_, text): &(Line<'_>, String)| !pieces(text, Forms::ALL).is_empty();
    first.iter().any(has_bytes).then_some(())?;
    let (whole, rest, _) = parse(bytes);
    let count: usize = whole.messages.iter().map(|one| one.bytes.len()).sum();
    let is_told = |one: &Message<'_>| one.is_sent.is_some() || one.at.is_some();
    // Both directions, and hardly a line without bytes: not text that happens to be digits.
    let has = |is_sent| {
        whole
            .messages
            .iter()
            .any(|one| one.is_sent == Some(is_sent))
    };
    let is_directed = has(true) && has(false) && rest.len() * 8 <= whole.messages.len();
    let is_sure = count >= 2
        && (whole.has_marks || whole.evident * 8 >= count || is_directed)
        && whole.messages.iter().all(is_told);
    is_sure.then_some(Look::Surely)
}

pub(in crate::import) fn read(
    bytes: &[u8],
    options: &Options,
    out: &mut Imported,
) -> Result<(), ImportError> {
    let (mut whole, rest, error) = parse(bytes);
    if let Some(error) = error {
        return Err(error);
    }
    if let Some(first) = rest.first() {
        let shown: String = plain(first.text).chars().take(40).collect();
        out.note(format!(
            "lines without readable bytes are left out: {}, the first is line {}: {shown}",
            rest.len(),
            first.number
        ));
    }
    // A clock that only some lines have does not apply to the others.
    let clock = |one: &Message<'_>| one.at.map(|at| at.1);
    let first = whole.messages.first().and_then(clock);
    let is_timed = first.is_some() && whole.messages.iter().all(|one| clock(one) == first);
    whole.notes.iter().for_each(|note| out.note(note));
    if !is_timed {
        let other = whole.messages.iter().find(|one| clock(one) != first);
        if let Some(other) = other {
            out.note(format!(
                "line {} has no time, or one of another form than the first bytes: all times are \
                 left out",
                other.line.number
            ));
        }
        whole.messages.iter_mut().for_each(|one| one.at = None);
    }
    emit(whole.messages, options, out)
}

#[cfg(test)]
mod tests;
