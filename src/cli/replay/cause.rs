//! The probable cause of a program's failure at a capture, as its ports and its end show it.

use protocols::Instant;

use crate::capture::divergence::Divergence;
use crate::capture::replay::Played;
use crate::realtime::process::Ended;
use crate::run::check::last_words;

/// The end of a program before the end of a case.
pub(super) struct End<'a> {
    pub(super) how: Ended,
    pub(super) at: Instant,
    /// The last part of its output.
    pub(super) said: &'a str,
    /// Whether the case allows it.
    pub(super) is_allowed: bool,
}

/// The cause: the end of a program that ended by itself, otherwise its first different request. A
/// program that has ended makes no more requests, so a missing one is no cause.
pub(super) fn of(links: &[Played], end: Option<&End<'_>>) -> Option<String> {
    let first = parted(links);
    let Some(end) = end.filter(|end| !end.is_allowed) else {
        return first.map(|first| asked(first, "the program asks"));
    };
    let before = first.filter(|first| first.got.is_some() && first.at <= end.at);
    let ended = in_words(end);
    Some(match before {
        Some(first) => format!(
            "{ended}. {}",
            asked(first, "Before that, the program asked")
        ),
        None => ended,
    })
}

fn parted(links: &[Played]) -> Option<&Divergence> {
    let talks = links.iter().filter_map(|one| one.talk.as_ref());
    let parted = talks.filter_map(|talk| talk.divergence.as_ref());
    parted.min_by_key(|one| one.at)
}

fn asked(first: &Divergence, asks: &str) -> String {
    let words = first.to_string();
    let line = words.lines().next().unwrap_or_default();
    format!("{asks} otherwise than in the capture: {line}")
}

fn in_words(end: &End<'_>) -> String {
    let (how, at) = (end.how, end.at);
    let words =
        last_words(end.said).map_or_else(String::new, |line| format!("; its last words: {line}"));
    match how {
        Ended::Signal(_) => format!("the program was killed by {how} at {at} s{words}"),
        Ended::Code(0) => format!(
            "the program ended with exit code 0 at {at} s, before the capture was over; if that is \
             right, allow it with --exec-may-end"
        ),
        Ended::Code(_) => format!("the program gave up with {how} at {at} s{words}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::divergence::Track;
    use crate::capture::replay::{Talked, Tally};
    use engine::rig::line::Direction;

    /// A difference at 2 s: another request with the byte `got`, or a missing one.
    fn links(got: Option<u8>) -> Vec<Played> {
        let divergence = Divergence {
            link: "meter".to_owned(),
            direction: Direction::ToDevice,
            at: Instant::from_secs(2),
            byte: 18,
            expected: Some(0x7E),
            got,
            frames: [String::new(), String::new()],
            note: String::new(),
        };
        let talk = Talked {
            tally: Tally::default(),
            said: 0,
            divergence: Some(divergence),
        };
        vec![Played {
            link: "meter".to_owned(),
            expected: Track::default(),
            got: Track::default(),
            talk: Some(talk),
        }]
    }

    fn cause(how: Option<(Ended, u64)>, got: Option<u8>, is_allowed: bool) -> String {
        let end = how.map(|(how, at)| End {
            how,
            at: Instant::from_secs(at),
            said: "Traceback\nKeyError: 5\n",
            is_allowed,
        });
        of(&links(got), end.as_ref()).expect("a cause")
    }

    #[test]
    fn a_program_that_has_ended_failed_by_its_end() {
        let crash =
            "the program gave up with exit code 1 at 1.000000 s; its last words: KeyError: 5";
        let asked = "asks otherwise than in the capture: 2.000000 s, meter to-device, byte 18: ";
        let one = Some(Ended::Code(1));
        for (end, got, is_allowed, expected) in [
            (one.map(|how| (how, 1)), None, false, crash.to_owned()),
            (one.map(|how| (how, 1)), Some(3), false, crash.to_owned()),
            (None, None, false, format!("the program {asked}")),
            (
                one.map(|how| (how, 1)),
                None,
                true,
                format!("the program {asked}"),
            ),
            (
                Some((Ended::Signal(11), 1)),
                None,
                false,
                "the program was killed by ".to_owned(),
            ),
            (
                Some((Ended::Code(0), 1)),
                None,
                false,
                "the program ended with exit code 0 at ".to_owned(),
            ),
        ] {
            let got = cause(end, got, is_allowed);
            assert!(got.starts_with(&expected), "{got}");
        }
        let both = cause(Some((Ended::Code(1), 3)), Some(3), false);
        assert!(
            both.starts_with("the program gave up")
                && both.contains("Before that, the program asked"),
            "{both}"
        );
    }
}
