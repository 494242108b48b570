//! The comparison of two runs of one program: bytes on the lines, calls, and output.

use std::collections::BTreeMap;
use std::path::Path;

use protocols::{Instant, LineConfig};

use super::judged::CAPTURE;
use crate::capture::{Capture, Record};
use crate::realtime::guest::Played;
use crate::run::check::Check;

/// Name of the program's log in the result folder.
pub(super) const LOG: &str = "program.log";
/// Rate of a link without one; only the order of times counts.
const USUAL: u32 = 115_200;

/// Judges whether two runs, with their results in these folders, are the same.
pub(super) fn same(first: &Played, second: &Played, folders: [&Path; 2]) -> Check {
    let is_same = first.outcome.trace_hash == second.outcome.trace_hash;
    let calls = first.calls.part_from(&second.calls);
    let [one, other] = folders.map(|folder| safefs::read(&folder.join(LOG)).unwrap_or_default());
    let words = other_words(&one, &other);
    let detail = match (words, calls) {
        (Some(words), _) if is_same => {
            let detail = format!("the same bytes, but other output of the program: {words}");
            return Check::new("deterministic", false, detail);
        }
        (_, None) if is_same => format!(
            "both runs gave the same bytes, {} calls",
            first.calls.count()
        ),
        (_, Some(calls)) if is_same => format!("the same bytes, but other calls: {calls}"),
        (words, calls) => {
            let captures = folders.map(|folder| Capture::read(&folder.join(CAPTURE)));
            let [one, other] = captures.map(|it| lines_of(&it.unwrap_or_default()));
            let all = [
                other_bytes(&one, &other),
                calls.or_else(|| Some("the same calls and answers".to_owned())),
                words.map(|words| format!("output of the program: {words}")),
            ];
            let all: Vec<String> = all.into_iter().flatten().collect();
            format!("the two runs differ: {}", all.join("; "))
        }
    };
    Check::new("deterministic", is_same, detail)
}

/// Bytes with their times.
type Timed = Vec<(Instant, u8)>;

/// The bytes of each direction of a link as received, and as sent where they differ.
fn lines_of(capture: &Capture) -> BTreeMap<(String, &'static str), [Timed; 2]> {
    let mut lines: BTreeMap<_, [Timed; 2]> = BTreeMap::new();
    for record in &capture.records {
        let Some(link) = capture.links.get(record.link) else {
            continue;
        };
        let key = (link.name.clone(), record.direction.name());
        let [received, sent] = lines.entry(key).or_default();
        let rate = LineConfig::new_8n1(if link.baud > 0 { link.baud } else { USUAL });
        received.extend(record.chunks(rate).into_iter().flat_map(timed));
        sent.extend(sent_of(record).into_iter().flat_map(timed));
    }
    lines
}

fn timed((at, bytes): (Instant, &[u8])) -> impl Iterator<Item = (Instant, u8)> {
    bytes.iter().map(move |&byte| (at, byte))
}

fn sent_of(record: &Record) -> Option<(Instant, &[u8])> {
    let sent = record.sent.as_ref()?;
    Some((sent.at, &sent.bytes))
}

/// The first difference between the bytes of two runs: link, direction, number of the byte, times.
fn other_bytes(
    one: &BTreeMap<(String, &'static str), [Timed; 2]>,
    other: &BTreeMap<(String, &'static str), [Timed; 2]>,
) -> Option<String> {
    let mut first: Option<(Instant, String)> = None;
    let nothing = [Timed::new(), Timed::new()];
    let keys = one.keys().chain(other.keys());
    for key in keys {
        let [one, other] = [one, other].map(|lines| lines.get(key).unwrap_or(&nothing));
        for (one, other) in one.iter().zip(other) {
            let same = one
                .iter()
                .zip(other)
                .take_while(|(one, other)| one == other);
            let number = same.count();
            let pair = [one.get(number), other.get(number)];
            let Some(at) = pair.into_iter().flatten().map(|(at, _)| *at).min() else {
                continue;
            };
            if first.as_ref().is_none_or(|(earliest, _)| at < *earliest) {
                let (link, direction) = key;
                let [one, other] = pair.map(byte_words);
                let words = format!("{link} {direction}, byte {number}: {one}, then {other}");
                first = Some((at, words));
            }
        }
    }
    first.map(|(_, words)| words)
}

/// A byte with its time to the nanosecond: runs may differ by the cost of a call, or less.
fn byte_words(byte: Option<&(Instant, u8)>) -> String {
    let Some((at, byte)) = byte else {
        return "nothing".to_owned();
    };
    let nanos = at.as_nanos();
    let (seconds, nanos) = (nanos / 1_000_000_000, nanos % 1_000_000_000);
    format!("0x{byte:02X} at {seconds}.{nanos:09} s")
}

/// The first difference between the outputs of two runs.
fn other_words(one: &[u8], other: &[u8]) -> Option<String> {
    let lines = |text: &[u8]| -> Vec<String> {
        let text = String::from_utf8_lossy(text);
        text.lines().map(str::to_owned).collect()
    };
    if one == other {
        return None;
    }
    let [one, other] = [lines(one), lines(other)];
    let at = one.iter().zip(&other).position(|(one, other)| one != other);
    let at = at.unwrap_or(one.len().min(other.len()));
    let said = |lines: &[String]| {
        let line = lines.get(at);
        line.map_or_else(|| "nothing".to_owned(), |line| format!("{line:?}"))
    };
    Some(format!(
        "line {} is {}, then {}",
        at + 1,
        said(&one),
        said(&other)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_line_that_differs_is_named() {
        assert_eq!(other_words(b"a\nb\n", b"a\nb\n"), None);
        let words = other_words(b"a\nb\n", b"a\nc\n");
        assert_eq!(words.as_deref(), Some("line 2 is \"b\", then \"c\""));
        let words = other_words(b"a\n", b"a\nc\n");
        assert_eq!(words.as_deref(), Some("line 2 is nothing, then \"c\""));
    }

    /// The earliest of all lines counts, whether a byte, its time or its presence differs, as
    /// received or as sent.
    #[test]
    fn the_first_byte_that_differs_is_named() {
        let line = |bytes: &[(u64, u8)]| -> Timed {
            let bytes = bytes.iter();
            let timed = bytes.map(|&(at, byte)| (Instant::from_micros(at), byte));
            timed.collect()
        };
        let lines = |base: &[(u64, u8)], lidar: &[(u64, u8)], sent: &[(u64, u8)]| {
            let base = (("base".to_owned(), "to-device"), [line(base), line(sent)]);
            let lidar = (("lidar".to_owned(), "to-master"), [line(lidar), line(&[])]);
            BTreeMap::from([base, lidar])
        };
        let usual = lines(&[(1, 1), (9, 2)], &[(5, 7)], &[(1, 3)]);
        let parts = |other| other_bytes(&usual, &other);
        assert_eq!(parts(usual.clone()), None);
        let cases = [
            (
                lines(&[(1, 1), (9, 3)], &[(5, 7)], &[(1, 3)]),
                "base to-device, byte 1: 0x02 at 0.000009000 s, then 0x03 at 0.000009000 s",
            ),
            (
                lines(&[(1, 1), (9, 3)], &[(6, 7)], &[(1, 3)]),
                "lidar to-master, byte 0: 0x07 at 0.000005000 s, then 0x07 at 0.000006000 s",
            ),
            (
                lines(&[(1, 1)], &[(5, 7), (8, 7)], &[(1, 3)]),
                "lidar to-master, byte 1: nothing, then 0x07 at 0.000008000 s",
            ),
            (
                lines(&[(1, 1), (9, 2)], &[(5, 7)], &[(1, 4)]),
                "base to-device, byte 0: 0x03 at 0.000001000 s, then 0x04 at 0.000001000 s",
            ),
        ];
        for (other, words) in cases {
            assert_eq!(parts(other).as_deref(), Some(words));
        }
    }
}
