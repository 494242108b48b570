//! Observation of a program without faults: where it reads and sends, and which frames it answers.
//! Behaviour that was not observed is not expected later.

use core::time::Duration;
use std::path::Path;

use emulators::rng::Rng;
use protocols::Instant;

use super::case::{Answered, Case, Hex, Known, Raw, Told, WARM_UP, quiet};
use super::cause::Cause;
use super::harness::{Harness, HarnessError, Whose};
use super::player::Halt;
use super::session::Session;
use super::speech::{Shape, Speech, is_echo};
use super::trial::{self, Talk, TrialOutcome, settle};
use engine::codec::wire::Stream;
use engine::scenario::{Scenario, Span};

/// The pause after each frame if the observation is repeated: at least the time until its answer.
const GAP: Duration = Duration::from_millis(100);
/// Number of these pauses in which the program is only observed.
const LISTEN_GAPS: usize = 4;
/// Maximum number of frames that are tried.
const TRIED: usize = 32;
/// Sufficient number of answered frames.
const ANSWERED: usize = 6;

/// The observed behaviour of a program.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Probed {
    /// The link on which the program was observed; empty: on all links, with the devices.
    pub link: String,
    /// The behaviour without faults.
    pub known: Known,
    /// Unsolicited frames of the program on the link.
    pub chatter: Shape,
    /// Frames that it answers.
    pub answered: Vec<Answered>,
    /// Whether no frame was tried, because any bytes of its length hold a frame: an answer to such
    /// a frame cannot be distinguished from unsolicited data.
    pub lacks_noise: bool,
}

impl Harness<'_> {
    /// Observes the program with its devices, without faults, for `lasting`. The second value
    /// contains causes of failure that occurred nevertheless.
    pub fn meet(
        &self,
        scenario: &Scenario,
        lasting: Duration,
        recording: &Path,
    ) -> Result<(Probed, Case, TrialOutcome), HarnessError> {
        let case = Case {
            scenario: quiet(scenario, lasting),
            told: Told {
                lasting: Span(lasting),
                ..Told::default()
            },
        };
        let (mut live, opened) = Session::begin(self, &case, recording)?;
        self.expect_ports(&live, &opened)?;
        // The first half is for the start of the program.
        let middle = Instant::ZERO + WARM_UP + lasting / 2;
        let acted = opened.and_then(|()| live.pass(lasting));
        let known = live.known(middle);
        let mut seen = trial::judge(self, live, acted, Vec::new(), self.is_mute)?;
        let mut met = Probed {
            known,
            ..Probed::default()
        };
        // A program that does its work and ends must not be reported for ending.
        met.known.ends = seen.causes.contains(&Cause::Ended);
        seen.causes.retain(|cause| *cause != Cause::Ended);
        Ok((met, case, seen))
    }

    /// Observes the program on one link, where valid frames replace the device's data.
    pub fn meet_on(
        &self,
        scenario: &Scenario,
        (link, speech): (&str, &Speech),
        rng: &mut Rng,
        recording: &Path,
    ) -> Result<(Probed, Case, TrialOutcome), HarnessError> {
        let raw = Raw {
            link: link.to_owned(),
            ..Raw::default()
        };
        let mut case = Case {
            scenario: quiet(scenario, Duration::ZERO),
            told: Told {
                raw: Some(raw),
                ..Told::default()
            },
        };
        let (mut live, opened) = Session::begin(self, &case, recording)?;
        self.expect_ports(&live, &opened)?;
        let mut met = Probed {
            link: link.to_owned(),
            ..Probed::default()
        };
        let (mut asked, mut causes) = (String::new(), Vec::new());
        let acted = opened.and_then(|()| {
            met.talk(&mut live, speech, rng, &mut asked)?;
            causes.extend(met.farewell(&mut live, speech, self.alive)?);
            Ok(())
        });
        live.note_reached(self);
        // The device that replies to the program is not there.
        let raw = case.told.raw.get_or_insert_default();
        (raw.stream, raw.gap) = (asked, Some(Span(GAP)));
        raw.answered.clone_from(&met.answered);
        raw.chatter = met.chatter.iter().cloned().map(Hex).collect();
        let is_altered = raw.chunks() > 0 || live.has_spoken();
        case.told.known = met.known.clone();
        let seen = trial::judge(self, live, acted, causes, is_altered)?;
        Ok((met, case, seen))
    }

    /// Rejects a program that never opens a port.
    fn expect_ports(
        &self,
        live: &Session<'_>,
        opened: &Result<(), Halt>,
    ) -> Result<(), HarnessError> {
        let (Whose::Command { command, dir }, true) = (&self.whose, live.opened().is_empty())
        else {
            return Ok(());
        };
        let expected = format!(
            "expected it to open one of {}",
            live.port_names().join(", ")
        );
        let dir = dir.display();
        match opened {
            Err(Halt::Interrupted) => Err(HarnessError::Interrupted),
            Err(Halt::Ended(ended)) => {
                let said = live.said_so_far();
                let said = said.lines().last().unwrap_or("nothing");
                Err(HarnessError::Useless(format!(
                    "--exec '{command}': ended with {ended} before it opened a port, saying: \
                     {said}; {expected} in {dir}"
                )))
            }
            _ => {
                let start = self.start.as_secs_f64();
                Err(HarnessError::Useless(format!(
                    "--exec '{command}': opened no port within {start} s; {expected} in {dir}"
                )))
            }
        }
    }
}

impl Probed {
    /// Listens, then tries frames until enough of them are answered.
    fn talk(
        &mut self,
        live: &mut Session<'_>,
        speech: &Speech,
        rng: &mut Rng,
        asked: &mut String,
    ) -> Result<(), Halt> {
        let from = live.now();
        for _ in 0..LISTEN_GAPS {
            *asked += "idle\n";
            live.pass(GAP)?;
        }
        let mut talk = Talk::new(speech);
        talk.chatter = speech.shape(&live.take_heard(), &[]);
        self.known = live.known(from);
        let (mut with_noise, mut without_noise) = (0, 0);
        for _ in 0..TRIED {
            let Some(frame) = speech.frame(rng).filter(|_| self.answered.len() < ANSWERED) else {
                break;
            };
            // Drawing frames and noise takes no turn of the rig, so check for an interrupt here.
            live.go_on()?;
            let Some(noise) = speech.noise(&frame, rng) else {
                without_noise += 1;
                continue;
            };
            with_noise += 1;
            let mut answer = |bytes: &[u8], talk: &Talk<'_>| {
                *asked += &Stream::raw(bytes).to_text();
                *asked += "idle\n";
                talk.ask(live, bytes)
            };
            let first = answer(&frame, &talk)?;
            if first.is_empty() || first != answer(&frame, &talk)? {
                continue;
            }
            // Frames that come after noise are unsolicited.
            talk.chatter.extend(answer(&noise, &talk)?);
            let kinds: Vec<Hex> = (&first - &talk.chatter).into_iter().map(Hex).collect();
            let frame = Hex(frame);
            if !kinds.is_empty() {
                self.answered.push(Answered { frame, kinds });
            }
        }
        self.lacks_noise = without_noise > 0 && with_noise == 0;
        self.chatter = talk.chatter;
        self.forget_doubtful();
        Ok(())
    }

    /// Removes answers that turned out to be unsolicited, and weak evidence if there is better
    /// evidence.
    fn forget_doubtful(&mut self) {
        let chatter = &self.chatter;
        let comes_by_itself = |kind: &Hex| chatter.contains(&kind.0);
        self.answered
            .retain(|one| !one.kinds.iter().any(comes_by_itself));
        let echoes = |one: &Answered| one.kinds.iter().any(|kind| is_echo(&kind.0));
        if self.answered.iter().any(echoes) {
            self.answered.retain(echoes);
        }
    }

    /// Checks that the program still behaves as before.
    fn farewell(
        &self,
        live: &mut Session<'_>,
        speech: &Speech,
        alive: Duration,
    ) -> Result<Option<Cause>, Halt> {
        let mut talk = Talk::new(speech);
        talk.chatter = self.chatter.clone();
        let raw = Raw {
            answered: self.answered.clone(),
            ..Raw::default()
        };
        settle(live, &self.known, Some((&talk, &raw)), alive)
    }
}
