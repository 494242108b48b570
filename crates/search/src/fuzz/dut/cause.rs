//! What was wrong with a program, so that two of a kind have the same key.

use core::fmt;

use super::case::{Hex, Pair};
use super::errors::LastWords;
use realtime::process::Ended;

/// Rules about when something is said: a program that is not given the processor in time breaks
/// them without being to blame.
const RULES_OF_TIME: [&str; 5] = [
    "request-before-reply",
    "gap-in-frame",
    "bytes-while-busy",
    "bytes-while-starting",
    "frame-cut-off",
];

/// Cause of a finding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cause {
    /// It ended by a signal, or with an exit code that is not 0.
    Crash {
        /// How.
        ended: Ended,
        /// What it said last.
        last_words: String,
        /// Where it failed, as far as it says or was seen.
        place: String,
        /// Whether it reported an error of its own, rather than failed.
        is_reported: bool,
    },
    /// It ended with exit code 0.
    Ended,
    /// It lives and gives no sign of it.
    Hang(String),
    /// It waits forever for a reply that does not come.
    NoTimeout(String),
    /// A thread computes without end; only in virtual time, where the thread is known.
    Spins(String),
    /// It answered a damaged frame as if it were sound.
    Accepts {
        /// The frames.
        pair: Pair,
        /// On which link.
        link: String,
    },
    /// It broke a rule of a device.
    Rule {
        /// Which device.
        device: String,
        /// Which rule.
        rule: String,
        /// The device's words.
        detail: String,
    },
    /// A checker of the whole run failed.
    Check {
        /// Which.
        name: String,
        /// Its words.
        detail: String,
    },
    /// A real port is not there any more.
    PortLost(String),
}

impl Cause {
    /// A crash, if a program that `ended` and `said` so much did not end by itself. `fault` is
    /// where
    /// it was then, if that was seen.
    pub fn of_end(ended: Ended, said: &str, fault: Option<String>) -> Self {
        match ended {
            Ended::Code(0) => Self::Ended,
            _ => {
                let words = LastWords::of(said);
                let is_exit = matches!(ended, Ended::Code(_));
                // What a program that a signal ended said before need not have to do with it.
                let is_telling = is_exit || words.is_failure;
                Self::Crash {
                    ended,
                    last_words: if is_telling {
                        words.line
                    } else {
                        String::new()
                    },
                    place: match is_telling {
                        true => words.key,
                        false => fault.unwrap_or_default(),
                    },
                    is_reported: !words.is_failure && is_exit,
                }
            }
        }
    }

    /// Whether the program ended because of an error that it reported itself, or with 0.
    pub(super) const fn is_reported(&self) -> bool {
        matches!(
            self,
            Self::Ended
                | Self::Crash {
                    is_reported: true,
                    ..
                }
        )
    }

    /// Whether the program is not to be spoken to any more.
    pub(super) const fn is_final(&self) -> bool {
        !matches!(
            self,
            Self::Accepts { .. } | Self::Rule { .. } | Self::Check { .. } | Self::NoTimeout(_)
        )
    }

    /// Whether a busy machine may have brought it about: a program that was not given the processor
    /// in time asks twice, or does not stop before a wall.
    pub(super) fn may_be_lateness(&self) -> bool {
        matches!(self, Self::Check { .. }) || self.is_about_time()
    }

    /// Whether it is a rule about when something is said.
    pub(super) fn is_about_time(&self) -> bool {
        matches!(self, Self::Rule { rule, .. } if RULES_OF_TIME.contains(&&**rule))
    }

    /// What kind of thing is wrong, for a folder's name.
    pub fn kind(&self) -> String {
        let kind = match self {
            Self::Crash { ended, .. } => format!("crash-{ended}"),
            Self::Ended => "ended".to_owned(),
            Self::Hang(_) => "hang".to_owned(),
            Self::Spins(_) => "spins".to_owned(),
            Self::NoTimeout(_) => "no-timeout".to_owned(),
            Self::Accepts { .. } => "accepts-corrupt-frame".to_owned(),
            Self::Rule { rule, .. } => format!("rule-{rule}"),
            Self::Check { name, .. } => format!("check-{name}"),
            Self::PortLost(_) => "port-lost".to_owned(),
        };
        let kind = kind.to_lowercase();
        kind.replace(|c: char| !c.is_ascii_alphanumeric(), "-")
    }

    /// What two findings share that have the same cause, as far as can be told from outside.
    pub fn key(&self) -> String {
        let more = match self {
            Self::Crash { place, .. } => place.clone(),
            Self::Accepts { link, .. } => link.clone(),
            Self::Rule { device, .. } => device.clone(),
            _ => return self.kind(),
        };
        format!("{} {more}", self.kind()).trim_end().to_owned()
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Crash {
                ended,
                last_words,
                place,
                is_reported,
            } => {
                let how = match is_reported {
                    true => "ended with an error",
                    false => "crashed",
                };
                write!(f, "the program {how}: {ended}")?;
                match (&**last_words, &**place) {
                    ("", "") => Ok(()),
                    ("", place) => write!(f, " at {place}"),
                    (words, _) => write!(f, "; it said: {words}"),
                }
            }
            Self::Ended => f.write_str("the program ended with exit code 0, expected it to go on"),
            Self::Hang(how) | Self::Spins(how) => write!(f, "the program hangs: {how}"),
            Self::NoTimeout(how) => {
                write!(f, "the program waits without a timeout: {how}")
            }
            Self::Accepts { pair, link } => write!(
                f,
                "the program answers a damaged frame as if it were sound: on {link}, {} for {}",
                shortened(&pair.damaged.0),
                shortened(&pair.good.0)
            ),
            Self::Rule {
                device,
                rule,
                detail,
            } => write!(f, "the program broke a rule of {device}: {rule}: {detail}"),
            Self::Check { name, detail } => write!(f, "{name}: {detail}"),
            Self::PortLost(how) => f.write_str(how),
        }
    }
}

/// The beginning and the end of a frame, where its head and its checksum are.
fn shortened(bytes: &[u8]) -> String {
    let hex = |bytes: &[u8]| Hex(bytes.to_vec()).to_string();
    match bytes.len() {
        0..=16 => hex(bytes),
        len => format!(
            "{} .. {} ({len} bytes)",
            hex(&bytes[..8]),
            hex(&bytes[len - 4..])
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(ended: Ended, said: &str) -> String {
        Cause::of_end(ended, said, None).key()
    }

    #[test]
    fn a_crash_is_known_by_its_signal_and_by_what_the_program_said() {
        let panic = "working\nthread 'main' panicked at src/a.rs:7:5:\nindex 9\nnote: run with";
        let at = |pid| format!("=={pid}==ERROR: AddressSanitizer: heap-buffer-overflow\nmore");
        assert_eq!(
            key(Ended::Code(101), panic),
            "crash-exit-code-101 panicked at src/a.rs:7:5"
        );
        assert_eq!(
            key(Ended::Signal(6), &at(17)),
            key(Ended::Signal(6), &at(4))
        );
        assert_eq!(
            key(Ended::Signal(11), "Segmentation fault\n"),
            "crash-sigsegv"
        );
        assert_eq!(key(Ended::Code(0), "bye"), "ended");
    }
}
