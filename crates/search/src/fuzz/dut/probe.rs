//! Getting to know a program: where it reads and speaks, and what it answers. What cannot be seen
//! of it when nothing is wrong is not missed later.

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

/// Time in which it is only listened to.
const LISTEN: Duration = Duration::from_millis(400);
/// Frames that are tried.
const TRIED: usize = 32;
/// Frames with an answer that are enough.
const ANSWERED: usize = 6;

/// What is known of a program.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Probed {
    /// On this link it was talked to; empty: on all, by the devices.
    pub link: String,
    /// What it does when nothing is wrong.
    pub known: Known,
    /// What it says on the link unasked.
    pub chatter: Shape,
    /// Frames that it answers.
    pub answered: Vec<Answered>,
}

impl Harness<'_> {
    /// Meets the program with its devices, nothing being wrong, for `lasting`. What was wrong
    /// nevertheless is in the second part.
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
        // The first half is for waking up.
        let middle = Instant::ZERO + WARM_UP + lasting / 2;
        let acted = opened.and_then(|()| live.pass(lasting));
        let known = live.known(middle);
        let mut seen = trial::judge(self, live, acted, Vec::new(), false)?;
        let mut met = Probed {
            known,
            ..Probed::default()
        };
        // One that does its work and ends is no use to be blamed for that.
        met.known.ends = seen.causes.contains(&Cause::Ended);
        seen.causes.retain(|cause| *cause != Cause::Ended);
        Ok((met, case, seen))
    }

    /// Meets the program on one link, where valid frames come in place of what a device says.
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
        let seen = trial::judge(self, live, acted, causes, !asked.is_empty())?;
        case.told.known = met.known.clone();
        let raw = case.told.raw.get_or_insert_default();
        (raw.stream, raw.answered) = (asked, met.answered.clone());
        raw.chatter = met.chatter.iter().cloned().map(Hex).collect();
        Ok((met, case, seen))
    }

    /// A program that never opens a port is none to be tried.
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
        live.pass(LISTEN)?;
        let mut talk = Talk::new(speech);
        talk.chatter = speech.shape(&live.take_heard(), &[]);
        self.known = live.known(from);
        for _ in 0..TRIED {
            let Some(frame) = speech.frame(rng).filter(|_| self.answered.len() < ANSWERED) else {
                break;
            };
            let noise = speech.noise(&frame, rng);
            let mut answer = |bytes: &[u8], talk: &Talk<'_>| {
                *asked += &Stream::raw(bytes).to_text();
                *asked += "idle\n";
                talk.ask(live, bytes)
            };
            let first = answer(&frame, &talk)?;
            if first.is_empty() || first != answer(&frame, &talk)? {
                continue;
            }
            // What comes after noise comes by itself.
            talk.chatter.extend(answer(&noise, &talk)?);
            let kinds: Vec<Hex> = (&first - &talk.chatter).into_iter().map(Hex).collect();
            let frame = Hex(frame);
            if !kinds.is_empty() {
                self.answered.push(Answered { frame, kinds });
            }
        }
        self.chatter = talk.chatter;
        self.forget_doubtful();
        Ok(())
    }

    /// Forgets answers that were found to come by themselves, and those that are weak evidence if
    /// there is better.
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

    /// Whether it is still what it was.
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
