//! Behaviour of a reference program, and its comparison with another program.

use serde::{Deserialize, Serialize};

use super::bytes;
use crate::divergence::{Track, compare};
use crate::replay::{Arrival, Played};
use engine::rig::line::Direction;
use engine::run::check::Check;

/// Behaviour of a reference program in the same case.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sound {
    /// Its command.
    pub command: String,
    /// Its output.
    #[serde(default)]
    pub prints: String,
    /// Its bytes.
    #[serde(default)]
    pub link: Vec<SoundLink>,
}

/// Bytes of a reference program on a link.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SoundLink {
    /// Name of the link.
    pub name: String,
    /// Bits per second, which the times refer to.
    pub baud: u32,
    /// Its bytes, in the form of a case.
    pub sent: String,
}

/// A program that is stopped at the end of a case may lack this share of the reference, one in so
/// many.
const SLACK: usize = 10;

impl Sound {
    /// Behaviour of the program `command`; `links` may be empty if the devices reply.
    pub fn of(command: &str, said: &str, links: &[Played], baud: impl Fn(&str) -> u32) -> Self {
        let link = links.iter().map(|one| {
            let baud = baud(&one.link);
            let line = protocols::LineConfig::new_8n1(baud);
            let pieces = one.got.pieces().map(|(at, bytes)| Arrival {
                at,
                bytes: bytes.to_vec(),
            });
            SoundLink {
                name: one.link.clone(),
                baud,
                sent: bytes::write(&pieces.collect::<Vec<_>>(), line),
            }
        });
        Self {
            command: command.to_owned(),
            prints: said.to_owned(),
            link: link.collect(),
        }
    }

    /// Whether the program that printed `said` and sent `links` behaves as the reference.
    pub(super) fn judge(&self, said: &str, links: &[Played]) -> Vec<Check> {
        let mut checks = vec![self.judge_lines(said)];
        for sound in &self.link {
            let name = format!("sends-as-reference-{}", sound.name);
            let line = protocols::LineConfig::new_8n1(sound.baud.max(50));
            let expected = match bytes::read(&sound.sent, line) {
                Ok(arrivals) => {
                    let mut track = Track::default();
                    for one in arrivals {
                        track.push(one.at, &one.bytes);
                    }
                    track
                }
                Err(error) => {
                    checks.push(Check::new(&name, false, format!("sent {error}")));
                    continue;
                }
            };
            let none = Track::default();
            let found = links.iter().find(|one| one.link == sound.name);
            let got = found.map_or(&none, |one| &one.got);
            let (most, least) = (expected.bytes().len(), got.bytes().len());
            let parted = compare(&sound.name, Direction::ToDevice, &expected, got);
            let is_end = |byte: usize| byte >= most.min(least) && is_enough(most, least);
            let parted = parted.filter(|parted| !is_end(parted.byte));
            let detail = match &parted {
                None => format!("the same {} bytes", most.min(least)),
                Some(parted) => parted.to_string(),
            };
            checks.push(Check::new(&name, parted.is_none(), detail));
        }
        checks
    }

    fn judge_lines(&self, said: &str) -> Check {
        let (expected, got): (Vec<&str>, Vec<&str>) =
            (self.prints.lines().collect(), said.lines().collect());
        let both = expected.iter().zip(&got);
        let parted = both
            .enumerate()
            .find(|(_, (expected, got))| expected != got);
        let detail = match parted {
            Some((index, (expected, got))) => {
                let line = index + 1;
                format!("line {line}: the reference printed {expected:?}, this one {got:?}")
            }
            None if !is_enough(expected.len(), got.len()) => {
                let [most, least] = [expected.len(), got.len()];
                format!("the reference printed {most} lines, this one {least}")
            }
            None => format!("the same {} lines", expected.len().min(got.len())),
        };
        let passes = parted.is_none() && is_enough(expected.len(), got.len());
        Check::new("prints-as-reference", passes, detail)
    }
}

/// Whether two programs produced about the same amount.
const fn is_enough(one: usize, other: usize) -> bool {
    one.abs_diff(other) * SLACK <= one + SLACK
}

#[cfg(test)]
mod tests {
    use protocols::Instant;

    use super::*;
    use engine::run::check::Status;

    fn played(bytes: &[u8]) -> [Played; 1] {
        let mut got = Track::default();
        got.push(Instant::from_secs(1), bytes);
        [Played {
            link: "base".to_owned(),
            expected: Track::default(),
            got,
            talk: None,
        }]
    }

    /// The reference sends twenty lines and forty bytes: two lines may be missing at the end, five
    /// may not.
    #[test]
    fn a_program_that_parts_from_the_reference_fails() {
        let lines = |count: usize| (0..count).map(|n| format!("{n}\n")).collect::<String>();
        let bytes: Vec<u8> = (0..40).collect();
        let sound = Sound::of("good", &lines(20), &played(&bytes), |_| 9600);
        let judge = |said: &str, bytes: &[u8]| {
            let checks = sound.judge(said, &played(bytes)).into_iter();
            checks.map(|one| one.status).collect::<Vec<_>>()
        };
        let (pass, fail) = (Status::Pass, Status::Fail);
        assert_eq!(judge(&lines(20), &bytes), [pass, pass]);
        assert_eq!(judge(&lines(18), &bytes[..37]), [pass, pass]);
        assert_eq!(judge(&lines(15), &bytes[..30]), [fail, fail]);
        let mut other = bytes;
        other[7] = 99;
        assert_eq!(judge(&lines(20).replace("7", "8"), &other), [fail, fail]);
        let said = &sound.judge(&lines(20), &played(&other))[1].detail;
        assert!(said.contains("byte 7: expected 0x07, got 0x63"), "{said}");
    }

    /// Of 20 expected ones, three may be missing or too much: a tenth of 20, and one more.
    #[test]
    fn a_tenth_may_be_missing() {
        let of = |one, others: [usize; 4]| others.map(|other| is_enough(one, other));
        assert_eq!(of(20, [17, 16, 23, 24]), [true, false, true, false]);
        assert_eq!(of(0, [0, 1, 2, 3]), [true, true, false, false]);
        assert_eq!(of(10, [8, 12, 7, 13]), [true, true, false, false]);
    }

    /// The line is counted from one; both numbers of lines are printed.
    #[test]
    fn a_different_line_is_told() {
        let sound = Sound::of("good", "a\nb\nc\n", &[], |_| 9600);
        let detail = |said: &str| sound.judge(said, &[])[0].detail.clone();
        assert_eq!(
            detail("a\nX\nc\n"),
            "line 2: the reference printed \"b\", this one \"X\""
        );
        assert_eq!(detail("a\nb\nc\n"), "the same 3 lines");
        assert_eq!(detail("a\nb\n"), "the same 2 lines");
        assert_eq!(detail("a\n"), "the reference printed 3 lines, this one 1");
        let many = Sound::of("good", &"x\n".repeat(20), &[], |_| 9600);
        assert_eq!(
            many.judge("x\n", &[])[0].detail,
            "the reference printed 20 lines, this one 1"
        );
    }

    /// A link that the program did not use has no bytes; a line of the case may be wrong.
    #[test]
    fn each_link_of_the_reference_is_judged() {
        let bytes: Vec<u8> = (0..40).collect();
        let mut sound = Sound::of("good", "", &played(&bytes), |_| 9600);
        let judge = |sound: &Sound, links: &[Played]| {
            let check = sound.judge("", links).remove(1);
            (check.name, check.status, check.detail)
        };
        let name = "sends-as-reference-base".to_owned();
        let (_, status, detail) = judge(&sound, &played(&bytes[..36]));
        assert_eq!((status, &*detail), (Status::Pass, "the same 36 bytes"));
        assert_eq!(judge(&sound, &played(&bytes[..34])).1, Status::Fail);
        assert_eq!(judge(&sound, &[]).1, Status::Fail);
        sound.link[0].sent = "what".to_owned();
        let (found, status, detail) = judge(&sound, &played(&bytes));
        assert_eq!((found, status), (name, Status::Fail));
        assert!(detail.starts_with("sent "), "{detail}");
    }
}
