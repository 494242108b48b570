//! Causes of findings; findings with the same cause have the same key.

use core::fmt;

use super::case::{Hex, Pair};
use super::errors::LastWords;
use realtime::process::Ended;

/// Rules about time: a program that gets no processor time in time breaks them without being
/// responsible.
const RULES_OF_TIME: [&str; 5] = [
    "request-before-reply",
    "gap-in-frame",
    "bytes-while-busy",
    "bytes-while-starting",
    "frame-cut-off",
];

/// The cause of a finding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The program ended by a signal, or with an exit code other than 0.
    Crash {
        /// Exit code or signal.
        ended: Ended,
        /// The last output of the program.
        last_words: String,
        /// The location of the failure, from the output or from observation.
        place: String,
        /// Whether the program reported an error on purpose instead of crashing.
        is_reported: bool,
    },
    /// The program ended with exit code 0.
    Ended,
    /// The program is running and shows no sign of life.
    Hang(String),
    /// The program waits forever for a reply that does not come.
    NoTimeout(String),
    /// A thread computes without end. Detected only in virtual time, where the thread is known.
    Spins(String),
    /// The program answered a damaged frame like the intact one.
    Accepts {
        /// The frames.
        pair: Pair,
        /// Name of the link.
        link: String,
    },
    /// The program broke a rule of a device.
    Rule {
        /// Name of the device.
        device: String,
        /// Name of the rule.
        rule: String,
        /// The message of the device.
        detail: String,
    },
    /// A check of the whole run failed.
    Check {
        /// Name of the check.
        name: String,
        /// Message of the check.
        detail: String,
    },
    /// A real port has disappeared.
    PortLost(String),
}

impl Cause {
    /// The cause for a program that ended by itself: a crash, unless the exit code is 0. `said` is
    /// its output, `fault` is its location at the end, if known.
    pub fn of_end(ended: Ended, said: &str, fault: Option<String>) -> Self {
        match ended {
            Ended::Code(0) => Self::Ended,
            _ => {
                let words = LastWords::of(said);
                let is_exit = matches!(ended, Ended::Code(_));
                // The output of a program that was killed by a signal need not concern the signal.
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

    /// Whether the program ended with exit code 0, or because of an error that it reported on
    /// purpose.
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

    /// Whether the program cannot be tested further.
    pub(super) const fn is_final(&self) -> bool {
        !matches!(
            self,
            Self::Accepts { .. } | Self::Rule { .. } | Self::Check { .. } | Self::NoTimeout(_)
        )
    }

    /// Whether a busy machine may be the reason: a program that gets no processor time in time
    /// repeats requests, or does not stop before a wall.
    pub(super) fn may_be_lateness(&self) -> bool {
        matches!(self, Self::Check { .. }) || self.is_about_time()
    }

    /// Whether the cause is a rule about time.
    pub(super) fn is_about_time(&self) -> bool {
        matches!(self, Self::Rule { rule, .. } if RULES_OF_TIME.contains(&&**rule))
    }

    /// The kind of cause, for the name of a folder.
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

    /// The key of the cause: findings with the same cause, as seen from outside, share it.
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
            Self::Ended => {
                f.write_str("the program ended with exit code 0, expected it to continue")
            }
            Self::Hang(how) | Self::Spins(how) => write!(f, "the program hangs: {how}"),
            Self::NoTimeout(how) => {
                write!(f, "the program waits without a timeout: {how}")
            }
            Self::Accepts { pair, link } if pair.noise.0.is_empty() => write!(
                f,
                "the program accepts a damaged reply as if it were valid: on {link}, {} for {}",
                shortened(&pair.damaged.0),
                shortened(&pair.good.0)
            ),
            Self::Accepts { pair, link } => write!(
                f,
                "the program answers a damaged frame as if it were valid: on {link}, {} for {}",
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

/// The beginning and end of a frame, with its header and its checksum.
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
