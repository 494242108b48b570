//! The reason of a failure: a smaller case must fail for the same one.

use core::fmt;
use std::collections::BTreeSet;

use crate::realtime::process::Ended;
use crate::run::check::{Check, Status, last_words};

/// Checks whose text identifies the error, as a rule's text or an exit code. For every other check
/// the name suffices.
const TELLING: [&str; 7] = [
    "exits",
    "prints",
    "never-prints",
    "sends",
    "never-sends",
    "program-alive",
    "program-connected",
];

/// The reason of a case's failure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Reason {
    /// Names of the failed checks, each with its text if that tells more.
    checks: BTreeSet<(String, String)>,
    /// The way in which the program failed, and its last line.
    end: Option<(Ended, String)>,
}

impl Reason {
    /// The reason of a failure with these `checks`; `None` if none failed. `ended` is the program's
    /// own end, `said` its output.
    pub(super) fn of(checks: &[Check], ended: Option<Ended>, said: &str) -> Option<Self> {
        let failed = checks.iter().filter(|check| check.status == Status::Fail);
        let checks: BTreeSet<_> = failed
            .map(|check| {
                let is_telling = TELLING.contains(&&*check.name);
                let detail = is_telling.then(|| lasting(&check.detail));
                (check.name.clone(), detail.unwrap_or_default())
            })
            .collect();
        let end = ended.filter(|how| *how != Ended::Code(0)).map(|how| {
            let words = last_words(said).map(lasting);
            (how, words.unwrap_or_default())
        });
        (!checks.is_empty()).then_some(Self { checks, end })
    }
}

impl fmt::Display for Reason {
    /// The failed checks, then the end of the program.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: BTreeSet<&str> = self.checks.iter().map(|(name, _)| &**name).collect();
        write!(f, "{}", Vec::from_iter(names).join(", "))?;
        match &self.end {
            Some((how, words)) if words.is_empty() => write!(f, "; the program ended with {how}"),
            Some((how, words)) => write!(f, "; the program ended with {how}: {words}"),
            None => Ok(()),
        }
    }
}

/// Minimum number of digits of an address or a counter.
const LONG: usize = 5;

/// `text` without the parts that change from run to run: times, dates, addresses and long numbers
/// become `#`. Short whole numbers stay, because they identify the wrong value or line.
fn lasting(text: &str) -> String {
    let is_part = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | ':' | '_');
    let mut out = String::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let end = match is_part(first) {
            true => rest.find(|c| !is_part(c)).unwrap_or(rest.len()),
            false => first.len_utf8(),
        };
        let (word, behind) = rest.split_at(end);
        let bare = word.trim_end_matches(['.', ':']);
        out.push_str(if changes(bare) { "#" } else { bare });
        out.push_str(&word[bare.len()..]);
        rest = behind;
    }
    out
}

fn changes(word: &str) -> bool {
    if let Some(hex) = word.strip_prefix("0x") {
        return hex.len() >= LONG;
    }
    let begins = word.starts_with(|c: char| c.is_ascii_digit());
    let is_number = word
        .chars()
        .all(|c| c.is_ascii_digit() || matches!(c, '.' | ':'));
    begins && is_number && (word.contains(['.', ':']) || word.len() >= LONG)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::check::Check;

    fn reason(detail: &str, ended: Option<Ended>, said: &str) -> Option<Reason> {
        let checks = [
            Check::new("exits", false, detail.to_owned()),
            Check::new("talks-meter", false, format!("last at {} s", said.len())),
            Check::new("program-reads", true, "0.00 s".to_owned()),
        ];
        Reason::of(&checks, ended, said)
    }

    #[test]
    fn times_and_addresses_change_and_small_numbers_do_not() {
        for (text, expected) in [
            ("KeyError: 5", "KeyError: 5"),
            (
                "ended with exit code 1 at 0.340000 s",
                "ended with exit code 1 at # s",
            ),
            ("12:03:04.5 no answer to 0x12", "# no answer to 0x12"),
            ("at 0x7fffd010: é 4711", "at #: é 4711"),
            ("driver.py:14: bad, pid 53911.", "driver.py:14: bad, pid #."),
        ] {
            assert_eq!(lasting(text), expected);
        }
    }

    /// Another exit code, another exception, the same at another time.
    #[test]
    fn the_end_of_the_program_is_part_of_the_reason() {
        let one = Some(Ended::Code(1));
        let first = reason("ended with exit code 1", one, "x\nKeyError: 5\n");
        for (detail, ended, said, is_same) in [
            (
                "ended with exit code 1",
                one,
                "more\nx\nKeyError: 5\n",
                true,
            ),
            (
                "ended with exit code 1",
                one,
                "TimeoutError: no answer to 0x12\n",
                false,
            ),
            ("ended with exit code 1", one, "KeyError: 4\n", false),
            (
                "ended with exit code 2",
                Some(Ended::Code(2)),
                "KeyError: 5\n",
                false,
            ),
            ("ended with exit code 1", None, "KeyError: 5\n", false),
        ] {
            let other = reason(detail, ended, said);
            assert_eq!(other == first, is_same, "{detail} {said}");
        }
        let words = first.expect("a failure").to_string();
        assert_eq!(
            words,
            "exits, talks-meter; the program ended with exit code 1: KeyError: 5"
        );
    }
}
