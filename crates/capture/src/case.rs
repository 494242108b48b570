//! Cases: regression tests as files. A case holds the bytes that reached the program, as values,
//! and the expected behaviour.
//!
//! ```text
//! case = 1
//! [expect]                    what must hold when the bytes are played to the program
//! [[link]]                    bytes of each link, one line a moment:
//! to_program = "1070000 AB 24 0A"   nanoseconds since the start, then hex
//! [scenario]                  which robot it is; none: only decoders are tested
//! ```
//!
//! Within a line, groups of digits are chunks that arrived back to back at the link's rate. The
//! last chunk is complete at the given time. `!` is a character without a stop bit. A case contains
//! no seed, whose meaning could change between versions, so later versions can still read it.

mod bytes;
mod damage;
mod decoder;
mod expectation;
mod foreign;
mod names;
mod rules;
mod sound;

use core::fmt;
use core::time::Duration;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use protocols::{Instant, LineConfig};
use serde::{Deserialize, Serialize};

use crate::divergence::Track;
use crate::replay::{Arrival, Passage, Recorded, Replay, ReplayError, Voice};
use engine::TOOL;
use engine::rig::Program;
use engine::robots::{self, Dut, PcEnd};
use engine::run::check::{Check, Status};
use engine::scenario::{Document, Scenario, ScenarioError, Source, read_whole, text_of};

pub use decoder::Decoded;
pub use expectation::Expectation;
pub use rules::{Evidence, Rule};
pub use sound::{Sound, SoundLink};

/// The only version so far.
pub const VERSION: u32 = 1;

/// A regression test as data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Case {
    /// Version of the format, 1.
    #[serde(deserialize_with = "known_version")]
    pub case: u32,
    /// Short name of the case.
    pub name: String,
    /// Human-readable origin.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Tool and version that wrote the case.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub tool: String,
    /// Duration, ns.
    pub end_ns: u64,
    /// Whether the captured program was a foreign one. The robot's own program is tested in its
    /// place, unless the case is run with a foreign program.
    #[serde(default, rename = "foreign", skip_serializing_if = "is_false")]
    pub is_foreign: bool,
    /// Source of the replies to a foreign program; the robot's own program gets them by time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub play: Option<Play>,
    /// Expected behaviour.
    pub expect: Expectation,
    /// The bytes.
    #[serde(default)]
    pub link: Vec<LinkBytes>,
    /// The robot whose program is tested; `None`: only decoders are tested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scenario: Option<Scenario>,
}

/// Source of the answers for a foreign program.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Play {
    /// The devices of the scenario, which judge the program as in a run
    Devices,
    /// The capture, which answers as the devices did
    Conversation,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde calls it so")]
const fn is_false(flag: &bool) -> bool {
    !*flag
}

/// The bytes of one link.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkBytes {
    /// Name of the link.
    pub name: String,
    /// Bits per second.
    pub baud: u32,
    /// Time at which the program opened the port, ns, if the capture records it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub opened_ns: Vec<u64>,
    /// Bytes received by the program.
    #[serde(default)]
    pub to_program: String,
    /// Bytes sent by the program.
    #[serde(default)]
    pub from_program: String,
}

fn known_version<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    match u32::deserialize(deserializer)? {
        VERSION => Ok(VERSION),
        other => {
            let message = format!("case is {other}, expected {VERSION}");
            Err(serde::de::Error::custom(message))
        }
    }
}

/// Error of reading, making or running a case.
#[derive(Debug, thiserror::Error)]
pub enum CaseError {
    /// The file cannot be read, or is no case.
    #[error(transparent)]
    File(ScenarioError),
    /// A line of bytes is invalid.
    #[error("{}: link {link}: {message}", .path.display())]
    Bytes {
        /// The file.
        path: PathBuf,
        /// The link.
        link: String,
        /// The error, with its line.
        message: String,
    },
    /// The case cannot be played.
    #[error(transparent)]
    Replay(ReplayError),
    /// The case is of a program that is not built in.
    #[error("{}: is of a program of your own, expected --exec CMD", .path.display())]
    NeedsProgram {
        /// The file.
        path: PathBuf,
    },
    /// The case has expectations of a program but names no program.
    #[error("{}: expected a [scenario] with the robot whose program is tested", .path.display())]
    NoRobot {
        /// The file.
        path: PathBuf,
    },
}

/// Minimum silence at the end of a case after which a program that sent before counts as stopped.
const SILENCE: Duration = Duration::from_secs(1);
/// Minimum number of chunks on a link on which the program sends continuously.
const TALK_MIN: usize = 10;

impl Case {
    /// Whether `text` is intended as a case, not as a scenario.
    pub fn is_meant(text: &str) -> bool {
        let mut lines = text.lines().map(str::trim_start);
        let first = lines.find(|line| !line.is_empty() && !line.starts_with('#'));
        let key = first
            .and_then(|line| line.split_once('='))
            .map(|(key, _)| key.trim_end());
        key == Some("case")
    }

    /// Reads a case from `text`; `path` is for messages and relative files.
    ///
    /// # Errors
    /// If `text` is no case, or if an expectation names an unknown link or device.
    pub fn parse(path: &Path, text: String) -> Result<(Self, Source), CaseError> {
        let path = path.to_owned();
        let source = Source { path, text };
        let read =
            |document: Document<'_>| Self::deserialize(toml::de::Deserializer::from(document));
        let case = read_whole(&source, read).map_err(CaseError::File)?;
        case.check_play(&source)?;
        case.check_names(&source)?;
        Ok((case, source))
    }

    /// Reads a case file.
    ///
    /// # Errors
    /// If the file cannot be read or is no case.
    pub fn read(path: &Path) -> Result<(Self, Source), CaseError> {
        let text = text_of(path).map_err(CaseError::File)?;
        Self::parse(path, text)
    }

    /// Text of the case file.
    pub fn to_toml(&self) -> String {
        toml::to_string_pretty(self).expect("every field has a TOML form")
    }

    /// Makes a case from a recording of `scenario`'s robot. If the program violated rules, it must
    /// not violate them again. If it stopped sending, it must send to the end. If a check of every
    /// run fails, the check must pass. Otherwise the program must send the same bytes again.
    ///
    /// # Errors
    /// If the robot cannot be wired.
    pub fn of(
        name: &str,
        recorded: &Recorded,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Self, CaseError> {
        let wired = robots::wire(scenario, source, Dut::Internal, PcEnd::Scripted);
        let wired = wired.map_err(|error| CaseError::Replay(error.into()))?;
        if wired.rig.program().is_none() {
            return Ok(Self::of_outsider(name, recorded, Some(scenario)));
        }
        let replay = Replay::new(recorded, scenario, source, Voice::Capture);
        let judged = replay.map_err(CaseError::Replay)?.finish();
        let own: BTreeSet<String> = judged.links.iter().map(|one| one.link.clone()).collect();
        let links: Vec<&Passage> = recorded
            .links
            .iter()
            .filter(|one| own.contains(&one.link))
            .collect();
        let talking = links.iter().filter(|one| talks(&one.sent));
        let talks: Vec<String> = talking.clone().map(|one| one.link.clone()).collect();
        let fell_silent = talking
            .clone()
            .any(|one| is_silent(&one.sent, recorded.end));
        let never: BTreeSet<String> = judged.violations.iter().map(rule).collect();
        let failed = |check: &&Check| check.status == Status::Fail;
        let is_sound = !judged.checks.iter().any(|check| failed(&check));
        // A corrected program drives another path than the captured robot. The case therefore
        // requires no freedom from collisions, unless a collision was the failure.
        let asked = |check: &&Check| check.name != "no-collision-at-speed" || failed(check);
        let checks = judged.checks.iter().filter(asked);
        Ok(Self {
            case: VERSION,
            name: name.to_owned(),
            description: String::new(),
            tool: format!("{TOOL} {}", env!("CARGO_PKG_VERSION")),
            end_ns: recorded.end.as_nanos(),
            is_foreign: false,
            play: None,
            expect: Expectation {
                same_outputs: never.is_empty() && !fell_silent && is_sound,
                talks,
                never: never.into_iter().collect(),
                checks: checks.map(|check| check.name.clone()).collect(),
                ..Expectation::default()
            },
            link: links.into_iter().map(LinkBytes::of).collect(),
            scenario: Some(scenario.clone()),
        })
    }

    /// The bytes as a recording that can be played.
    ///
    /// # Errors
    /// If a line of bytes is invalid.
    pub fn recorded(&self, path: &Path) -> Result<Recorded, CaseError> {
        let links = self.link.iter().map(|link| {
            link.passage().map_err(|message| CaseError::Bytes {
                path: path.to_owned(),
                link: link.name.clone(),
                message,
            })
        });
        Ok(Recorded {
            links: links.collect::<Result<_, _>>()?,
            end: Instant::from_nanos(self.end_ns.min(END_MAX)),
            zero: Instant::ZERO,
        })
    }

    /// Plays the case to the robot's program and judges it.
    ///
    /// # Errors
    /// If the case cannot be played.
    pub fn run(&self, source: &Source) -> Result<Judgement, CaseError> {
        self.run_with(source, |program| program)
    }

    /// As [`run`](Self::run), with another program: `program` makes it from the robot's program.
    ///
    /// # Errors
    /// If the case cannot be played.
    pub fn run_with(
        &self,
        source: &Source,
        program: impl FnOnce(Box<dyn Program>) -> Box<dyn Program>,
    ) -> Result<Judgement, CaseError> {
        let has_program = |scenario: &Scenario| {
            let wired = robots::wire(scenario, source, Dut::Internal, PcEnd::Scripted);
            wired.is_ok_and(|wired| wired.rig.program().is_some())
        };
        if self.play == Some(Play::Devices)
            || (self.is_foreign && !self.scenario.as_ref().is_some_and(has_program))
        {
            let path = source.path.clone();
            return Err(CaseError::NeedsProgram { path });
        }
        let recorded = self.recorded(&source.path)?;
        let decoded = self.expect.decoder.iter();
        let mut checks: Vec<Check> = decoded.flat_map(|one| one.judge(&recorded)).collect();
        let Some(scenario) = &self.scenario else {
            let ran = recorded.end - Instant::ZERO;
            return match self.expect.needs_program() {
                true => Err(CaseError::NoRobot {
                    path: source.path.clone(),
                }),
                false => Ok(self.judgement(checks, ran)),
            };
        };
        let replay = Replay::new(&recorded, scenario, source, Voice::Program);
        let mut replay = replay.map_err(CaseError::Replay)?;
        replay.replace_program(program);
        let replayed = replay.finish();
        checks.extend(self.expect.judge(&replayed, recorded.end));
        let note = self.is_foreign.then(|| {
            let robot = &scenario.robot;
            format!(
                "the built-in program of the robot {robot} was tested, not the captured program; \
                 --exec CMD tests yours"
            )
        });
        Ok(Judgement {
            note,
            ..self.judgement(checks, replayed.ran)
        })
    }

    fn judgement(&self, checks: Vec<Check>, ran: Duration) -> Judgement {
        Judgement {
            name: self.name.clone(),
            note: None,
            checks,
            ran,
        }
    }
}

/// Maximum length of a case, equal to that of a scenario: a week.
const END_MAX: u64 = 7 * 86_400 * 1_000_000_000;

fn rule(logged: &engine::rig::Logged) -> String {
    format!("{} {}", logged.source, logged.event.rule)
}

/// Whether a program sends continuously on a line until it stops for good.
fn talks(sent: &Track) -> bool {
    let times: Vec<Instant> = sent.pieces().map(|(at, _)| at).collect();
    times.len() >= TALK_MIN && times.windows(2).all(|pair| pair[1] - pair[0] <= SILENCE)
}

fn is_silent(sent: &Track, end: Instant) -> bool {
    is_silent_for(sent, end, SILENCE)
}

fn is_silent_for(sent: &Track, end: Instant, longest: Duration) -> bool {
    sent.end().is_none_or(|last| end - last > longest)
}

/// Result of a case.
#[derive(Clone, Debug)]
pub struct Judgement {
    /// Name of the case.
    pub name: String,
    /// Notes for the reader of the verdicts.
    pub note: Option<String>,
    /// All verdicts.
    pub checks: Vec<Check>,
    /// Length in virtual time.
    pub ran: Duration,
}

impl Judgement {
    /// Whether every check passed. A case without expectations fails, because it proves nothing.
    pub fn passed(&self) -> bool {
        let is = |status| self.checks.iter().any(|check| check.status == status);
        is(Status::Pass) && !is(Status::Fail)
    }
}

impl fmt::Display for Judgement {
    /// One line for the case, and one for each check.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = if self.passed() { "PASS" } else { "FAIL" };
        write!(f, "{verdict} {}", self.name)?;
        if let Some(note) = &self.note {
            write!(f, "\n  {note}")?;
        }
        for check in &self.checks {
            write!(f, "\n  {check}")?;
        }
        Ok(())
    }
}

impl LinkBytes {
    fn of(passage: &Passage) -> Self {
        let line = passage.line();
        let sent = passage.sent.pieces().map(|(at, bytes)| Arrival {
            at,
            bytes: bytes.to_vec(),
        });
        Self {
            name: passage.link.clone(),
            baud: line.baud,
            opened_ns: passage.opened.iter().map(|at| at.as_nanos()).collect(),
            to_program: bytes::write(&passage.arrivals, line),
            from_program: bytes::write(&sent.collect::<Vec<_>>(), line),
        }
    }

    fn passage(&self) -> Result<Passage, String> {
        let line = LineConfig::new_8n1(self.baud);
        if !(50..=100_000_000).contains(&self.baud) {
            return Err(format!("baud is {}, expected 50 to 100000000", self.baud));
        }
        let read = |key, text| bytes::read(text, line).map_err(|error| format!("{key} {error}"));
        let mut sent = Track::default();
        for arrival in read("from_program", &self.from_program)? {
            sent.push(arrival.at, &arrival.bytes);
        }
        Ok(Passage {
            link: self.name.clone(),
            baud: self.baud,
            arrivals: read("to_program", &self.to_program)?,
            heard: Vec::new(),
            sent,
            opened: self
                .opened_ns
                .iter()
                .copied()
                .map(Instant::from_nanos)
                .collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Chunks at these milliseconds.
    fn track(millis: impl IntoIterator<Item = u64>) -> Track {
        let mut track = Track::default();
        for at in millis {
            track.push(Instant::from_millis(at), &[1]);
        }
        track
    }

    /// A program talks all the time if it sends ten chunks or more, with no pause longer than a
    /// second.
    #[test]
    fn who_talks_all_the_time_talks_ten_times_and_never_pauses_for_longer_than_a_second() {
        assert!(talks(&track((0..10).map(|piece| piece * 1000))));
        assert!(!talks(&track((0..9).map(|piece| piece * 1000))));
        assert!(!talks(&track((0..10).map(|piece| piece * 1001))));
        assert!(!talks(&track((0..10).chain([2000]))));
    }

    #[test]
    fn who_said_nothing_in_the_last_second_is_silent() {
        let end = Instant::from_millis(5000);
        assert!(!is_silent(&track([1, 4000]), end));
        assert!(is_silent(&track([1, 3999]), end));
        assert!(is_silent(&Track::default(), end));
    }

    /// The first key decides, after any comments.
    #[test]
    fn a_case_begins_with_its_version() {
        for text in [
            "case = 1",
            "\n# a case\n  case=1\nname = \"x\"",
            "case\t= 2",
        ] {
            assert!(Case::is_meant(text), "{text}");
        }
        for text in [
            "",
            "# case = 1",
            "name = \"x\"\ncase = 1",
            "cases = 1",
            "case",
        ] {
            assert!(!Case::is_meant(text), "{text}");
        }
    }

    fn parsed(text: &str) -> Result<Case, String> {
        let case = Case::parse(Path::new("x.toml"), text.to_owned());
        case.map(|(case, _)| case)
            .map_err(|error| error.to_string())
    }

    const LEAST: &str = "case = 1\nname = \"x\"\nend_ns = 7\n[expect]\n";

    #[test]
    fn other_versions_are_refused_by_name() {
        let case = parsed(LEAST).expect("all that it needs");
        assert_eq!((case.end_ns, case.is_foreign), (7, false));
        assert!(case.link.is_empty() && case.scenario.is_none());
        let said = parsed(&LEAST.replace("case = 1", "case = 2")).expect_err("another");
        assert!(said.contains("case: is 2, expected 1"), "{said}");
        assert!(!case.to_toml().contains("foreign"));
        let foreign = Case {
            is_foreign: true,
            ..case
        };
        assert!(foreign.to_toml().contains("foreign = true"));
        assert_eq!(parsed(&foreign.to_toml()), Ok(foreign));
    }

    /// A case of decoders alone needs no program; a case longer than a week is cut to one week.
    #[test]
    fn what_needs_a_program_says_so() {
        let plain = Expectation::default();
        assert!(!plain.needs_program());
        let one = || vec!["x".to_owned()];
        let needs: [fn(&mut Expectation, Vec<String>); 4] = [
            |expect, _| expect.same_outputs = true,
            |expect, one| expect.talks = one,
            |expect, one| expect.never = one,
            |expect, one| expect.checks = one,
        ];
        for need in needs {
            let mut expect = plain.clone();
            need(&mut expect, one());
            assert!(expect.needs_program(), "{expect:?}");
        }
        let mut case = parsed(LEAST).expect("sound");
        case.end_ns = u64::MAX;
        let recorded = case.recorded(Path::new("x.toml")).expect("no bytes");
        assert_eq!(recorded.end, Instant::from_secs(7 * 86_400));
    }

    /// A link needs a baud rate that a line can have.
    #[test]
    fn a_link_with_an_absurd_rate_is_refused() {
        let passage = |baud| {
            let link = LinkBytes {
                name: "base".to_owned(),
                baud,
                opened_ns: Vec::new(),
                to_program: "2000 AB".to_owned(),
                from_program: "3000 CD".to_owned(),
            };
            link.passage()
        };
        for baud in [50, 100_000_000] {
            let passage = passage(baud).expect("a rate");
            assert_eq!((passage.baud, passage.arrivals.len()), (baud, 1));
            assert_eq!(passage.sent.bytes(), [0xCD]);
        }
        for baud in [0, 49, 100_000_001] {
            let said = format!("baud is {baud}, expected 50 to 100000000");
            assert_eq!(passage(baud).err(), Some(said));
        }
    }

    /// A passed case has at least one passed check and no failed one.
    #[test]
    fn a_case_that_proves_nothing_fails() {
        let judgement = |statuses: &[Status]| Judgement {
            name: "x".to_owned(),
            note: Some("note".to_owned()),
            checks: statuses
                .iter()
                .map(|&status| Check {
                    status,
                    ..Check::new("one", true, "said")
                })
                .collect(),
            ran: Duration::ZERO,
        };
        let passed = |statuses: &[Status]| judgement(statuses).passed();
        assert!(!passed(&[]) && !passed(&[Status::NotObserved]));
        assert!(passed(&[Status::Pass]) && passed(&[Status::Pass, Status::NotObserved]));
        assert!(!passed(&[Status::Pass, Status::Fail]));
        let said = judgement(&[Status::Pass]).to_string();
        assert!(said.starts_with("PASS x\n  note\n  ok   one "), "{said}");
        assert!(judgement(&[]).to_string().starts_with("FAIL x\n"));
    }

    /// A case of devices, or of a foreign program without a built-in one, needs a program; a case
    /// of decoders alone does not.
    #[test]
    fn a_case_without_a_built_in_program_needs_one() {
        let run = |text: &str| {
            let path = Path::new("x.toml");
            let (case, source) = Case::parse(path, text.to_owned()).expect("sound");
            case.run(&source).map_err(|error| error.to_string())
        };
        let needs = "x.toml: is of a program of your own, expected --exec CMD";
        let top = |line: &str| LEAST.replace("end_ns = 7\n", &format!("end_ns = 7\n{line}\n"));
        assert_eq!(run(&top("foreign = true")).err().as_deref(), Some(needs));
        let robot = "[scenario]\nschema = 1\nname = \"s\"\nrobot = \"none\"\nduration = \"1s\"\n\
                     device.meter = { description = \"gps\" }\n";
        let foreign = format!("{}{robot}", top("foreign = true"));
        assert_eq!(run(&foreign).err().as_deref(), Some(needs));
        let devices = format!("{}{robot}", top("foreign = true\nplay = \"devices\""));
        assert_eq!(run(&devices).err().as_deref(), Some(needs));
        let plain = run(LEAST).expect("no program is needed");
        assert_eq!(
            (plain.checks.len(), plain.ran),
            (0, Duration::from_nanos(7))
        );
        let named = format!("{LEAST}exits = 0\n");
        let error = run(&named).expect_err("no robot");
        assert!(error.contains("expected a [scenario]"), "{error}");
    }

    /// A case of the rescue robot: its program hears one byte of the lidar and sends to the base
    /// each 100 ms for a second; the base receives `to_base`. The capture ends at `end_ms`.
    fn captured(end_ms: u64, to_base: &[u8]) -> Expectation {
        let text = "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"9s\"\n\
                    [mission]\nwaypoints_m = [[0.8, 1.9]]\n\
                    [world]\nstart = { x_m = 0.8, y_m = 1.4, heading_deg = 90 }\n\
                    [[world.wall]]\npath_m = [[0.0, 0.0], [3.0, 0.0]]\n";
        let (scenario, source) = Scenario::from_text(text).expect("sound");
        let arrival = |at, bytes: &[u8]| Arrival {
            at: Instant::from_millis(at),
            bytes: bytes.to_vec(),
        };
        let base = Passage {
            link: "base".to_owned(),
            baud: 1_000_000,
            sent: track((1..=10).map(|turn| turn * 100)),
            heard: match to_base {
                [] => Vec::new(),
                bytes => vec![arrival(100, bytes)],
            },
            ..Passage::default()
        };
        let lidar = Passage {
            link: "lidar".to_owned(),
            baud: 115_200,
            arrivals: vec![arrival(100, &[0xFA])],
            ..Passage::default()
        };
        let recorded = Recorded {
            links: vec![base, lidar],
            end: Instant::from_millis(end_ms),
            zero: Instant::ZERO,
        };
        let case = Case::of("x", &recorded, &scenario, &source).expect("a case");
        assert_eq!((case.link.len(), case.end_ns), (2, end_ms * 1_000_000));
        case.expect
    }

    /// Without a violation, a silence or a failed check, the program must send the same bytes. It
    /// must talk on the link on which it talked.
    #[test]
    fn a_case_expects_what_was_captured() {
        let sound = captured(1_500, &[]);
        assert_eq!(
            (sound.same_outputs, &sound.talks[..]),
            (true, &["base".to_owned()][..])
        );
        assert!(sound.never.is_empty(), "{:?}", sound.never);
        assert!(!sound.checks.contains(&"no-collision-at-speed".to_owned()));
        // The program has sent nothing for 1.1 s.
        let silent = captured(2_100, &[]);
        assert_eq!(
            (silent.same_outputs, silent.talks),
            (false, vec!["base".to_owned()])
        );
        // Two bytes that begin a frame of the bus, and a pause behind them.
        let violated = captured(1_500, &[0xAB, 0x24]);
        assert!(!violated.same_outputs);
        let is_of_base = |rule: &String| rule.starts_with("base ");
        assert!(
            violated.never.iter().any(is_of_base),
            "{:?}",
            violated.never
        );
    }
}
