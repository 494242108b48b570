//! The search loop: runs case after case and handles findings.

mod counts;
mod lessons;

use core::cell::RefCell;
use core::time::Duration;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use emulators::rng::Rng;

use super::case::{self, Case, Damage, Known, Raw, Told};
use super::cause::Cause;
use super::coverage::Counters;
use super::finding::{Finding, Kept, State};
use super::found::OpenFinding;
use super::guide::{Guide, Guided};
use super::harness::{Harness, HarnessError, Whose};
use super::learn::Lesson;
use super::plan::{GivenUp, Progress, RECORDINGS, TrialPlan};
use super::probe::Probed;
use super::restart::{self, Restarts};
use super::speech::Speech;
use super::traffic;
use super::trial::{self, TrialOutcome};
use engine::robots::OpenEnd;
use engine::scenario::Span;
use safefs::Dir;

/// Maximum number of stored causes.
const FINDINGS_MAX: usize = 100;

/// Pause after each turn in some cases, and their share. It is longer than the timeouts by which
/// usual servers end a partial frame: a turn of a wrong length then does not spoil the next ones.
const SLOW_GAP: Duration = Duration::from_millis(700);
const SLOW_ONE_IN: u64 = 3;
/// One conversation in this many begins with damaged replies.
const DAMAGE_ONE_IN: u64 = 2;
/// Number of first cases in which two of three conversations begin with texts at their limits; in
/// later cases, one conversation in `TEXTS_ONE_IN` does.
const TEXTS_FIRST: u64 = 24;
const TEXTS_ONE_IN: u64 = 8;
/// Maximum number of pairs of an intact and a damaged request of a learned format in a case.
const PAIRS_MAX: usize = 4;

/// A running search.
pub struct Search<'a> {
    harness: &'a Harness<'a>,
    progress: &'a Progress,
    plan: TrialPlan,
    ends: Vec<(OpenEnd, Speech)>,
    met: BTreeMap<Option<usize>, Probed>,
    state: State,
    late: u64,
    doubtful: u64,
    /// The knowledge about each link.
    lessons: BTreeMap<usize, (Arc<Lesson>, Known)>,
    /// The program at its first wait.
    restarts: Option<Restarts<'a>>,
    /// Errors that the program reported on purpose, with their numbers.
    reported: BTreeMap<String, u64>,
    given_up: GivenUp,
    unfinished: GivenUp,
}

impl<'a> Search<'a> {
    /// Starts a search, or continues the search in the folder.
    pub fn new(
        harness: &'a Harness<'a>,
        plan: TrialPlan,
        progress: &'a Progress,
    ) -> Result<Self, HarnessError> {
        let ends = harness.ends(&plan.scenario, plan.link.as_deref())?;
        if let Some(link) = &plan.link
            && !ends.iter().any(|(end, _)| &end.link == link)
        {
            let names: Vec<&str> = ends.iter().map(|(end, _)| end.link.as_str()).collect();
            let names = names.join(", ");
            let error = format!("--link {link}: no port of the program, expected one of {names}");
            return Err(HarnessError::Useless(error));
        }
        let program = match &harness.whose {
            Whose::Command { command, .. } => command.clone(),
            Whose::Ports(dir) => dir.display().to_string(),
        };
        let text = plan.scenario.to_toml();
        let scenario = engine::rig::trace::fingerprint(text.as_bytes());
        let link = plan.link.as_deref().unwrap_or("all links");
        let mut of = format!("{program} | {scenario} | {link} | seed {}", plan.seed);
        if plan.corpus.is_some() {
            of += " | with a corpus";
        }
        for (_, description) in &plan.descriptions {
            of += &format!(" | described as {}", description.name());
        }
        Dir::create(&plan.out).map_err(|error| HarnessError::File(plan.out.clone(), error))?;
        let state = State::read(&plan.out, of)?;
        progress.findings.set(state.findings.len());
        Ok(Self {
            harness,
            progress,
            state,
            plan,
            ends,
            met: BTreeMap::new(),
            late: 0,
            doubtful: 0,
            lessons: BTreeMap::new(),
            restarts: None,
            reported: BTreeMap::new(),
            given_up: GivenUp::default(),
            unfinished: GivenUp::default(),
        })
    }

    /// Runs one case; returns whether the program can be tested further.
    pub fn step(&mut self) -> Result<bool, HarnessError> {
        let kind = self.kind()?;
        let (case, speech, guided) = self.draw(kind);
        let seen = self.seen(&case, &speech)?;
        self.state.next += 1;
        self.progress.cases.set(self.progress.cases.get() + 1);
        self.late += u64::from(seen.was_late);
        self.progress
            .has_spoken
            .set(self.progress.has_spoken.get() | seen.has_spoken);
        let inputs = match &case.told.raw {
            Some(raw) if raw.turn.is_empty() => raw.chunks(),
            _ => seen.played.len(),
        };
        self.state.inputs += inputs as u64;
        self.progress
            .inputs
            .set(self.progress.inputs.get() + inputs as u64);
        if let Some(cause) = &seen.reported {
            *self.reported.entry(cause.key()).or_default() += 1;
            if case
                .told
                .raw
                .as_ref()
                .is_some_and(|raw| !raw.turn.is_empty())
            {
                self.given_up.cases += 1;
                self.given_up.inputs += inputs as u64;
            }
        }
        let is_over = seen.causes.is_empty() && seen.reported.is_none() && !case.told.known.ends;
        let mut raw = case.told.raw.iter();
        if raw.any(|raw| raw.turn.len() > 2 * inputs) && is_over {
            self.unfinished.cases += 1;
            self.unfinished.inputs += inputs as u64;
        }
        if let Some(raw) = case.told.raw.as_ref().filter(|_| self.is_guided()) {
            let guide = self.state.guides.entry(raw.link.clone()).or_default();
            let is_end = seen.causes.iter().any(Cause::is_final);
            guide.learn(&speech, guided, &seen.reached, is_end);
        }
        let is_gone = seen.causes.iter().any(Cause::is_final);
        self.keep(case, &speech, seen)?;
        self.state.write(&self.plan.out)?;
        Ok(!is_gone || matches!(self.harness.whose, Whose::Command { .. }))
    }

    /// Runs `case`, without a start of the program if that is possible.
    fn seen(&mut self, case: &Case, speech: &Speech) -> Result<TrialOutcome, HarnessError> {
        let recording = self.recording();
        let raw = case.told.raw.as_ref();
        let link = raw.filter(|raw| restart::is_alone(case, raw));
        if let Some(raw) = link {
            let link = raw.link.clone();
            let restarts = self.restarts.get_or_insert_with(|| Restarts::new(link));
            if restarts.may_do(&raw.link)
                && let Some(seen) = restarts.run(self.harness, case, speech, &recording)?
            {
                return Ok(seen);
            }
        }
        // Both would have the same ports.
        self.end_kept();
        trial::run(self.harness, case, speech, &recording)
    }

    fn end_kept(&mut self) {
        if let Some(restarts) = &mut self.restarts {
            restarts.end(self.harness);
        }
    }

    /// Number of cases without a start of the program.
    pub fn saved_starts(&self) -> u64 {
        self.restarts.as_ref().map_or(0, |restarts| restarts.saved)
    }

    fn recording(&self) -> PathBuf {
        self.plan.out.join(RECORDINGS[0])
    }

    /// The kind of the next case: faults, or raw traffic on the end with this number.
    fn kind(&mut self) -> Result<Option<usize>, HarnessError> {
        let link = self.plan.link.clone();
        if let Some(link) = link {
            let at = self.ends.iter().position(|(end, _)| end.link == link);
            return self.meet_on(at.expect("seen to when the search began"));
        }
        if !self.met.contains_key(&None) {
            let plan = &self.plan;
            let met = self
                .harness
                .meet(&plan.scenario, plan.lasting, &self.recording())?;
            let (met, case, seen) = met;
            self.met.insert(None, met);
            self.keep(case, &Speech::Bytes, seen)?;
        }
        let opens = &self.met[&None].known.opens;
        let ends = self.ends.iter().enumerate();
        let can = |(end, speech): &(OpenEnd, Speech)| {
            opens.contains(&end.name) && !matches!(speech, Speech::Bytes)
        };
        let links: Vec<usize> = ends.filter(|(_, end)| can(end)).map(|(at, _)| at).collect();
        let turn = self.state.next % (links.len() as u64 + 1);
        match turn.checked_sub(1) {
            None => Ok(None),
            Some(turn) => self.meet_on(links[usize::try_from(turn).expect("few links")]),
        }
    }

    /// Observes the program on the end with this number, if this has not been done.
    fn meet_on(&mut self, at: usize) -> Result<Option<usize>, HarnessError> {
        if !self.met.contains_key(&Some(at)) {
            let (end, speech) = self.ends[at].clone();
            let name = format!("fuzz.dut.meet.{}", end.link);
            let mut rng = Rng::stream(self.plan.seed, &name);
            let on = (end.link.as_str(), &speech);
            let recording = self.recording();
            let scenario = &self.plan.scenario;
            let (met, case, seen) = self.harness.meet_on(scenario, on, &mut rng, &recording)?;
            self.met.insert(Some(at), met);
            self.keep(case, &speech, seen)?;
            self.learn(at)?;
        }
        Ok(Some(at))
    }

    /// Whether the next case is a conversation: learned traffic and traffic of a known format
    /// alternate.
    fn is_dialogue(&self, at: usize, speech: &Speech) -> bool {
        let lesson = self.lessons.get(&at).map(|(lesson, _)| lesson);
        let Some(lesson) = lesson.filter(|lesson| !lesson.is_empty()) else {
            return false;
        };
        let fits = match speech {
            Speech::Frames(_) => !lesson.is_text(),
            Speech::Text(_) => lesson.is_text(),
            Speech::Bytes => false,
        };
        // A search with coverage guidance learns from its own inputs.
        let [share, all] = if self.is_guided() { [1, 4] } else { [3, 4] };
        !(fits || self.is_guided()) || self.state.next % all < share
    }

    /// Whether the program counts its coverage.
    pub fn is_guided(&self) -> bool {
        let counters = self.harness.counters.as_ref();
        counters.is_some_and(Counters::was_used)
    }

    fn draw(&self, kind: Option<usize>) -> (Case, Speech, Guided) {
        let number = self.state.next;
        let dice = |of| Rng::stream(self.plan.seed, &format!("fuzz.dut.{number}.{of}"));
        let (lasting, met) = (self.plan.lasting, &self.met[&kind]);
        let mut scenario = case::quiet(&self.plan.scenario, lasting);
        let mut guided = Guided::default();
        let (speech, raw) = match kind {
            Some(ref at) => {
                let (end, speech) = &self.ends[*at];
                let dice = &mut ["pairs", "stream"].map(dice);
                let new = Guide::default();
                let guide = self.state.guides.get(&end.link).unwrap_or(&new);
                let guide = self.is_guided().then_some(guide);
                if self.is_dialogue(*at, speech) {
                    let told = Told {
                        lasting: Span(lasting),
                        known: self.lessons[at].1.clone(),
                        raw: Some(self.dialogue(*at, met, dice)),
                    };
                    return (Case { scenario, told }, speech.clone(), guided);
                }
                let raw;
                (raw, guided) = traffic::raw(met, speech, end.line.baud, lasting, dice, guide);
                (speech.clone(), Some(raw))
            }
            None => {
                let opens = met.known.opens.iter();
                let links: Vec<String> = opens.filter_map(|name| self.link_of(name)).collect();
                let faults = case::faults(&links, lasting, &mut dice("faults"));
                scenario.fault.extend(faults);
                (Speech::Bytes, None)
            }
        };
        let told = Told {
            lasting: Span(lasting),
            known: met.known.clone(),
            raw,
        };
        (Case { scenario, told }, speech, guided)
    }

    /// A conversation created from learned data.
    fn dialogue(&self, at: usize, met: &Probed, [dice, rng]: &mut [Rng; 2]) -> Raw {
        let (lesson, _) = &self.lessons[&at];
        let avoided = self.state.avoided.iter().cloned().collect();
        let may_pause = !lesson.asks() && self.harness.supervision.is_some();
        let is_slow = may_pause && rng.below(SLOW_ONE_IN) == 0;
        let next = self.state.next;
        let has_texts = match next {
            0..TEXTS_FIRST => next % 3 < 2,
            next => next.is_multiple_of(TEXTS_ONE_IN),
        };
        let mut turn = match has_texts {
            true => lesson.text_turns(next, &avoided),
            false => Vec::new(),
        };
        // The experiment's intact reply would be the only one to a request that is sent once.
        let damage = match turn.is_empty() {
            true => self.damage(at, dice),
            false => None,
        };
        turn.extend(lesson.turns(GivenUp::INPUTS_MAX, &avoided, rng));
        turn.truncate(GivenUp::INPUTS_MAX);
        let learned = match lesson.answered() {
            (0, _) => Vec::new(),
            _ => lesson.pairs(PAIRS_MAX, dice),
        };
        Raw {
            link: met.link.clone(),
            gap: is_slow.then_some(Span(SLOW_GAP)),
            exchange: lesson.exchanges(),
            asks: lesson.asks(),
            turn,
            damage,
            learned,
            ..Raw::default()
        }
    }

    /// The experiment with damaged replies, in some cases. It compares times, so it needs virtual
    /// time.
    fn damage(&self, at: usize, rng: &mut Rng) -> Option<Damage> {
        let (lesson, _) = &self.lessons[&at];
        let is_due = lesson.asks() && self.harness.supervision.is_some();
        if !is_due || rng.below(DAMAGE_ONE_IN) > 0 {
            return None;
        }
        let all = lesson.damageable();
        let to = all.get(case::index(rng, all.len().max(1) as u64))?;
        Some(Damage {
            to: (*to).clone(),
            count: 1 + rng.below(Damage::COUNT_MAX),
            seed: u32::try_from(rng.below(1 << 32)).unwrap_or_default(),
            ..Damage::default()
        })
    }

    fn link_of(&self, name: &str) -> Option<String> {
        let mut ends = self.ends.iter().map(|(end, _)| end);
        ends.find(|end| end.name == name)
            .map(|end| end.link.clone())
    }

    /// Stores the findings of `case`, each cause once.
    fn keep(
        &mut self,
        case: Case,
        speech: &Speech,
        seen: TrialOutcome,
    ) -> Result<(), HarnessError> {
        for cause in &seen.causes {
            let key = cause.key();
            if let Some(kept) = self.state.findings.iter_mut().find(|kept| kept.key == key) {
                kept.count += 1;
                continue;
            }
            if self.state.findings.len() < FINDINGS_MAX {
                self.keep_new(&case, speech, &seen, cause)?;
            }
        }
        Ok(())
    }

    fn keep_new(
        &mut self,
        case: &Case,
        speech: &Speech,
        seen: &TrialOutcome,
        cause: &Cause,
    ) -> Result<(), HarnessError> {
        let number = self.state.findings.len() + 1;
        let folder = format!("{number:02}-{}", cause.kind());
        let mut first = case.clone();
        match &mut first.told.raw {
            None => first.scenario = seen.ran.clone(),
            // Turns that were not sent are not needed.
            Some(raw) if !raw.turn.is_empty() => *raw = seen.held.of(raw),
            Some(_) => {}
        }
        let found = OpenFinding {
            harness: self.harness,
            plan: &self.plan,
            progress: self.progress,
            speech,
            cause,
            finding: Finding::create(&self.plan.out, &folder)?,
            kinds: RefCell::default(),
        };
        let kept = found.keep(first, seen);
        self.progress.tries.set(0);
        if !kept? {
            self.doubtful += 1;
            return found.finding.remove();
        }
        self.state.avoided.extend(found.kinds.take());
        self.state.findings.push(Kept {
            folder,
            key: cause.key(),
            words: cause.to_string(),
            count: 1,
            case: self.state.next,
        });
        self.progress.findings.set(self.state.findings.len());
        self.state.write(&self.plan.out)
    }
}

impl Drop for Search<'_> {
    fn drop(&mut self) {
        self.end_kept();
        for name in RECORDINGS {
            let _ = Dir::open(&self.plan.out).and_then(|out| out.remove_file(name));
        }
    }
}
