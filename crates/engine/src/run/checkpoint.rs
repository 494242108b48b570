//! A copy of a run at one moment, from which any number of runs can continue, also in different
//! ways.
//!
//! ```text
//!   run ----+---------------------> its end
//!           |
//!           checkpoint --resume---> the same end
//!           +----------resume_as--> the end of a run with other faults from here on
//! ```
//!
//! All nodes are plain state, or programs that can save their state, so a copy continues like the
//! original. Another scenario may start from a checkpoint if it differs only in parts that have not
//! begun yet: faults and steps that are removed, added, begun later or ended earlier.

use std::collections::BTreeMap;
use std::sync::Arc;

use protocols::Instant;

use super::Run;
use super::mission::ends_alike;
use super::wire_log::Logging;
use crate::rig::fault::{FaultId, Window};
use crate::scenario::{FaultKind, FaultSpec, Scenario};

/// A run at one moment.
pub struct Checkpoint(Run);

impl core::fmt::Debug for Checkpoint {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_tuple("Checkpoint").field(&self.at()).finish()
    }
}

impl Run {
    /// The current state of the run. `None` if it cannot be copied: if a condition waits for bytes
    /// on its lines, or if one of its own checkers or node programs cannot be copied. The copy has
    /// no taps: only the checkers observe a run from a checkpoint.
    pub fn checkpoint(&self) -> Option<Checkpoint> {
        self.fork().map(Checkpoint)
    }

    pub(super) fn fork(&self) -> Option<Self> {
        // Watches refer to the lines of this rig.
        if self.line_watches.is_some() || !self.fault_watches.is_empty() {
            return None;
        }
        let mut rig = self.rig.fork()?;
        let team = self.fork_team()?;
        let watchers = self.watchers.fork(&mut rig)?;
        let wire_log = self.wire_log.as_ref();
        let wire_log = wire_log.map(|log| Logging::go_on(&mut rig, log));
        Some(Self {
            rig,
            instruments: Arc::clone(&self.instruments),
            asked: Arc::clone(&self.asked),
            scenario: self.scenario.clone(),
            seed: self.seed,
            watchers,
            progress: self.progress.clone(),
            pushes: self.pushes.clone(),
            agenda: self.agenda.clone(),
            deeds: self.deeds.clone(),
            waiting: self.waiting.clone(),
            triggers: self.triggers.clone(),
            fault_watches: BTreeMap::new(),
            truth: self.truth.clone(),
            pairs: self.pairs.clone(),
            history: self.history.clone(),
            wire_log,
            contacts: self.contacts.clone(),
            steps: self.steps.clone(),
            #[cfg(feature = "programs")]
            goes_on: self.goes_on.clone(),
            line_watches: None,
            looks: self.looks,
            next_look: self.next_look,
            is_over: self.is_over,
            team,
        })
    }
}

/// Changes to the faults of a checkpoint's run.
#[derive(Debug, Default)]
struct Changes<'a> {
    /// New number of each fault; `None` if it is removed.
    numbers: Vec<Option<usize>>,
    /// Faults with another window. The differences between the windows are in the future.
    moved: Vec<(FaultId, Window)>,
    /// Added faults, after those that are kept.
    added: &'a [FaultSpec],
}

impl Checkpoint {
    /// Time of the checkpoint.
    pub fn at(&self) -> Instant {
        self.0.rig.now()
    }

    /// A run that continues from here.
    ///
    /// # Panics
    /// Never: a run that was copied once can be copied again.
    pub fn resume(&self) -> Run {
        self.0.fork().expect("it was copied before")
    }

    /// A run of `scenario` from this checkpoint, if the scenario is known to have the same state
    /// here. It may differ only in its length, in its expectations, and in faults that have not
    /// acted yet: removed ones, ones added after all others, and ones that begin at another time or
    /// end earlier. Its [`history`](super::Outcome::history) is sampled like that of the original
    /// run.
    pub fn resume_as(&self, scenario: &Scenario) -> Option<Run> {
        let (now, asked) = (self.at(), &*self.0.asked);
        let ends = asked.duration.min(scenario.duration).instant();
        let is_as_asked = self.0.scenario.fault == asked.fault;
        if self.0.is_over || ends <= now || !is_as_asked || !is_alike(asked, scenario) {
            return None;
        }
        // This check counts back from the end of the run, so a change of the length changes it.
        let safety = asked.expect.safety.as_ref();
        let counts_back = safety.is_some_and(|safety| safety.alive_for.is_some());
        let has_team = !asked.team.is_empty();
        if (counts_back || has_team) && asked.duration != scenario.duration {
            return None;
        }
        // The checker of later violations is copied with its original settings.
        let later =
            [asked, scenario].map(|one| (one.expect.violations_from, one.expect.violations_max));
        if later[0] != later[1] && later.iter().any(|(from, _)| from.is_some()) {
            return None;
        }
        let changes = self.changes(&scenario.fault)?;
        let mut run = self.0.fork()?;
        run.apply(&changes, &asked.fault)?;
        run.scenario.fault.clone_from(&scenario.fault);
        run.find_triggers();
        run.tell_checkers();
        run.scenario.duration = scenario.duration;
        run.scenario.expect.clone_from(&scenario.expect);
        run.asked = Arc::new(scenario.clone());
        Some(run)
    }

    /// Changes from the faults of this run to `wanted`. `None` if this is impossible, or if a fault
    /// that is missing or different has already acted.
    fn changes<'a>(&self, wanted: &'a [FaultSpec]) -> Option<Changes<'a>> {
        let (all, mut wanted) = (wanted, wanted.iter().peekable());
        let (mut changes, mut number) = (Changes::default(), 0);
        for (index, fault) in self.0.asked.fault.iter().enumerate() {
            if fault.waits_for_condition() {
                return None;
            }
            let is_it = |other: &&FaultSpec| *other == fault || is_moved(other, fault);
            let kept = wanted.next_if(is_it);
            let Some(kept) = kept else {
                if !self.is_to_come(fault) {
                    return None;
                }
                changes.numbers.push(None);
                continue;
            };
            if kept != fault {
                let window = kept.window();
                if !self.can_move(fault, window) {
                    return None;
                }
                changes.moved.push((FaultId(index), window));
            }
            if index != number && has_numbered_dice(fault) {
                return None;
            }
            changes.numbers.push(Some(number));
            number += 1;
        }
        changes.added = &all[number..];
        let can_add = |fault: &FaultSpec| self.can_add(fault);
        changes.added.iter().all(can_add).then_some(changes)
    }

    /// Whether a new fault would not have acted before the checkpoint. A random fault would have
    /// drawn random numbers.
    fn can_add(&self, fault: &FaultSpec) -> bool {
        !fault.waits_for_condition() && fault.rate.is_none() && self.is_to_come(fault)
    }

    /// Whether the fault would have acted in the same manner until now with `window`.
    fn can_move(&self, fault: &FaultSpec, window: Window) -> bool {
        let (was, now) = (fault.window(), self.at());
        let had_begun = was.from <= now;
        match had_begun {
            true => window.from == was.from && now < window.until && now < was.until,
            false => now < window.from,
        }
    }

    /// Whether a fault has not acted at all.
    fn is_to_come(&self, fault: &FaultSpec) -> bool {
        if let Some(byte) = fault.byte {
            let line = self.0.line_of(fault);
            // Checks of safety excuse its effects from the start, because it has no time.
            let is_excused = self.0.asked.expect.safety.is_some();
            return !is_excused && line.is_some_and(|line| line.traffic().sent <= byte);
        }
        let waits = fault.at_byte.is_some() || fault.at_frame.is_some();
        !waits && fault.window().from > self.at()
    }
}

impl Run {
    fn apply(&mut self, changes: &Changes<'_>, faults: &[FaultSpec]) -> Option<()> {
        for &(id, window) in &changes.moved {
            self.rig.move_fault(id, window);
            self.agenda.move_to(id, window);
        }
        for (index, fault) in faults.iter().enumerate() {
            if changes.numbers[index].is_some() {
                continue;
            }
            if let Some(strike) = fault.strike().ok()? {
                let is_there = self.faults_on(fault)?.remove_strike(strike);
                is_there.then_some(())?;
            }
            self.rig.leave_out_fault(FaultId(index));
            self.agenda.leave_out(FaultId(index));
        }
        let to = |id: FaultId| {
            let number = changes.numbers.get(id.0).copied().flatten();
            number.map_or(id, FaultId)
        };
        self.rig.renumber_faults(to);
        self.agenda.renumber(to);
        let kept = changes.numbers.iter().flatten().count();
        for (number, fault) in (kept..).zip(changes.added) {
            self.plan(fault, FaultId(number)).ok()?;
        }
        Some(())
    }
}

/// Whether the scenarios differ only in their faults, length, expectations and descriptions.
fn is_alike(a: &Scenario, b: &Scenario) -> bool {
    let Scenario {
        schema,
        name,
        description: _,
        computing: _,
        robot,
        duration: _,
        seed,
        origin: _,
        mission,
        expect,
        program,
        chassis,
        device,
        exec,
        cable,
        link,
        budget,
        phases,
        world,
        fault: _,
        team,
    } = a;
    (schema, seed, name, robot) == (&b.schema, &b.seed, &b.name, &b.robot)
        && (mission, program, chassis) == (&b.mission, &b.program, &b.chassis)
        && (device, link, world) == (&b.device, &b.link, &b.world)
        && (exec, cable, team) == (&b.exec, &b.cable, &b.team)
        && (budget, phases) == (&b.budget, &b.phases)
        && ends_alike(expect, &b.expect)
        && expect.safety == b.expect.safety
        && expect.rules().eq(b.expect.rules())
}

/// Whether `other` is `fault` with another time.
fn is_moved(other: &FaultSpec, fault: &FaultSpec) -> bool {
    let is_plain = fault.byte.is_none() && fault.at_byte.is_none() && fault.at_frame.is_none();
    let when_it_was = FaultSpec {
        from: fault.from,
        until: fault.until,
        ..other.clone()
    };
    is_plain && fault.every.is_none() && when_it_was == *fault
}

/// Whether the number of the fault selects its random stream.
fn has_numbered_dice(fault: &FaultSpec) -> bool {
    let kind = matches!(fault.kind, FaultKind::Jitter | FaultKind::Clog);
    fault.stream.is_none() && (fault.rate.is_some() || kind)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Source;

    /// A sonar that sends a line each 50 ms for 3 s, with further tables.
    fn sonar(more: &str) -> (Scenario, Source) {
        let text = format!(
            "schema = 1\nname = \"sonar\"\nrobot = \"none\"\nduration = \"3s\"\n\
             device.sonar.text.baud = 9600\ndevice.sonar.text.command = []\n\
             device.sonar.text.periodic = {{ line = \"mm=700\", period = \"50ms\" }}\n{more}"
        );
        Scenario::from_text(&text).expect("sound")
    }

    fn run(more: &str) -> Run {
        let (scenario, source) = sonar(more);
        Run::new(scenario, &source, None).expect("can be wired")
    }

    /// The run of these tables after a second.
    fn after_a_second(more: &str) -> Checkpoint {
        let mut run = run(more);
        run.go_on_until(Instant::from_secs(1));
        run.checkpoint().expect("plain state")
    }

    /// Whether a run of the tables `from` continues as one of `to` after a second. Then it ends as
    /// a run of `to` from the start.
    fn continues(from: &str, to: &str) -> bool {
        let resumed = after_a_second(from).resume_as(&sonar(to).0);
        let Some(resumed) = resumed else {
            return false;
        };
        let (end, whole) = (resumed.finish(), run(to).finish());
        assert_eq!(end.trace_hash, whole.trace_hash, "{from} to {to}");
        let lines = |checks: &[super::super::check::Check]| -> Vec<String> {
            checks.iter().map(ToString::to_string).collect()
        };
        assert_eq!(lines(&end.checks), lines(&whole.checks), "{from} to {to}");
        assert_eq!(end.case.fault, whole.case.fault, "{from} to {to}");
        true
    }

    fn fault(keys: &str) -> String {
        format!("[[fault]]\nlink = \"sonar\"\ndirection = \"to-master\"\n{keys}\n")
    }

    /// The line is cut between these milliseconds.
    fn cut(from: u64, until: u64) -> String {
        fault(&format!(
            "kind = \"cut\"\nfrom = \"{from}ms\"\nuntil = \"{until}ms\""
        ))
    }

    #[test]
    fn a_copy_ends_as_its_run() {
        let checkpoint = after_a_second(&cut(500, 2_500));
        assert_eq!(checkpoint.at(), Instant::from_secs(1));
        assert!(format!("{checkpoint:?}").starts_with("Checkpoint("));
        let hash = |run: Run| run.finish().trace_hash;
        let whole = hash(run(&cut(500, 2_500)));
        assert_eq!(
            [hash(checkpoint.resume()), hash(checkpoint.resume())],
            [&*whole, &*whole]
        );
        assert_ne!(hash(run("")), whole);
    }

    /// At 1 s: a fault that has not begun may be removed, or have other times after 1 s.
    #[test]
    fn a_fault_to_come_may_change() {
        let later = cut(2_000, 2_500);
        assert!(continues(&later, &later) && continues(&later, ""));
        assert!(continues(&later, &cut(2_100, 2_500)) && continues(&later, &cut(1_001, 1_500)));
        assert!(continues(&later, &cut(2_000, 2_100)));
        assert!(!continues(&later, &cut(1_000, 2_500)) && !continues(&later, &cut(500, 2_500)));
        let stall = later.replace("cut", "stall");
        assert!(continues(&later, &stall));
    }

    /// A fault that has begun keeps its begin, and may end at another time after 1 s, if it has not
    /// ended yet.
    #[test]
    fn a_fault_that_has_begun_may_only_end_at_another_time() {
        let begun = cut(500, 1_500);
        assert!(continues(&begun, &begun) && continues(&begun, &cut(500, 1_200)));
        assert!(continues(&begun, &cut(500, 2_900)) && continues(&begun, &cut(500, 1_001)));
        for other in [
            cut(500, 1_000),
            cut(500, 900),
            cut(501, 1_500),
            cut(1_200, 1_500),
        ] {
            assert!(!continues(&begun, &other), "{other}");
        }
        assert!(!continues(&begun, ""));
        for ended in [cut(500, 1_000), cut(500, 900)] {
            assert!(continues(&ended, &ended));
            assert!(!continues(&ended, &cut(500, 1_500)) && !continues(&ended, ""));
        }
        let now = cut(1_000, 1_500);
        assert!(!continues(&now, "") && continues(&now, &cut(1_000, 1_200)));
    }

    /// An added fault has not acted before, and draws no random numbers.
    #[test]
    fn a_fault_may_be_added() {
        let first = cut(2_000, 2_100);
        for (added, expected) in [
            (cut(1_001, 1_500), true),
            (cut(1_000, 1_500), false),
            (cut(500, 1_500), false),
            (
                fault("kind = \"cut\"\nat_byte = 100\nlasting = \"50ms\""),
                false,
            ),
            (fault("kind = \"flip\"\nrate = 0.1\nfrom = \"2s\""), false),
            (
                fault(
                    "kind = \"cut\"\nbegins_when = { bytes = { link = \"sonar\", \
                     direction = \"to-master\", count = 900 } }",
                ),
                false,
            ),
        ] {
            let both = format!("{first}{added}");
            assert_eq!(continues(&first, &both), expected, "{added}");
            assert_eq!(continues("", &added), expected, "{added}");
        }
        // Two faults that stay, behind one that is removed, and one that is added.
        let [a, b, c, d] = [1_300, 1_600, 1_900, 2_200].map(|from| cut(from, from + 100));
        let (all, other) = (format!("{a}{b}{c}"), format!("{b}{c}{d}"));
        assert!(continues(&all, &other) && continues(&all, &format!("{a}{c}")));
        assert!(continues(&all, &c) && continues(&other, &b));
    }

    /// A damaged byte has not come yet, or it has passed.
    #[test]
    fn a_byte_to_come_may_be_damaged_otherwise() {
        let cut = &sonar(&cut(1, 2)).0.fault[0];
        let sent = after_a_second("")
            .0
            .line_of(cut)
            .expect("a line")
            .traffic()
            .sent;
        assert!(sent > 100, "{sent}");
        let flip = |byte: u64| fault(&format!("kind = \"flip\"\nbyte = {byte}\nbit = 1"));
        assert!(continues("", &flip(sent)) && !continues("", &flip(sent - 1)));
        assert!(continues(&flip(sent), "") && !continues(&flip(sent - 1), ""));
        assert!(continues(&flip(sent), &flip(sent + 3)));
        assert!(continues(&flip(5), &flip(5)) && !continues(&flip(5), &flip(sent)));
        let safe = "[expect.safety]\noverruns_max = 3\n";
        assert!(!continues(safe, &format!("{safe}{}", flip(sent))));
        assert!(continues(
            safe,
            &format!("{safe}{}", self::cut(2_000, 2_100))
        ));
    }

    /// The number of a fault selects its random numbers, unless it names them.
    #[test]
    fn a_fault_with_random_numbers_keeps_its_number() {
        let first = cut(2_000, 2_100);
        let jitter = "kind = \"jitter\"\nby = \"1ms\"";
        for keys in [jitter, "kind = \"flip\"\nrate = 0.1"] {
            let random = fault(keys);
            assert!(!continues(&format!("{first}{random}"), &random), "{keys}");
            assert!(continues(&format!("{random}{first}"), &random), "{keys}");
        }
        let named = fault(&format!("{jitter}\nstream = \"dice\""));
        assert!(continues(&format!("{first}{named}"), &named));
    }

    /// Only the length, the expectations and the descriptions of a scenario may differ otherwise.
    #[test]
    fn only_the_future_of_a_run_may_differ() {
        let checkpoint = after_a_second("");
        let resumes = |change: &dyn Fn(&mut Scenario)| {
            let mut scenario = sonar("").0;
            change(&mut scenario);
            checkpoint.resume_as(&scenario).is_some()
        };
        let span = crate::scenario::Span::from_millis;
        assert!(resumes(&|_| {}) && resumes(&|it| it.description = "other".to_owned()));
        assert!(resumes(&|it| it.duration = span(1_001)));
        assert!(!resumes(&|it| it.duration = span(1_000)));
        assert!(resumes(&|it| it.duration = span(9_000)));
        assert!(resumes(&|it| it.expect.violations_max = Some(3)));
        assert!(!resumes(&|it| it.expect.settle = Some(span(3_000))));
        let later = |it: &mut Scenario| it.expect.violations_from = Some(span(2_000));
        assert!(!resumes(&later));
        assert!(!resumes(&|it| it.seed += 1));
        assert!(!resumes(&|it| it.name = "other".to_owned()));
        assert!(!resumes(&|it| it.mission.to_the_end = true));
        assert!(!resumes(&|it| it.device.clear()));
        let rule = "[[expect.rule]]\nname = \"near\"\neventually = { bytes = { link = \"sonar\", \
                    direction = \"to-master\", count = 1 } }\n";
        assert!(checkpoint.resume_as(&sonar(rule).0).is_none());
        let link = "[link.sonar]\nlatency = \"1ms\"\n";
        assert!(checkpoint.resume_as(&sonar(link).0).is_none());
        // A run that is over does not continue.
        let mut over = run("");
        over.scenario.duration = span(500);
        while !over.is_over() {
            over.step();
        }
        let over = over.checkpoint().expect("plain state");
        assert!(over.resume_as(&sonar("").0).is_none());
    }

    /// The time for which a program is alive counts back from the end of the run.
    #[test]
    fn a_length_that_counts_stays() {
        let safe = "[expect.safety]\nalive_for = \"1s\"\n";
        let checkpoint = after_a_second(safe);
        let resumes = |millis: u64| {
            let mut scenario = sonar(safe).0;
            scenario.duration = crate::scenario::Span::from_millis(millis);
            checkpoint.resume_as(&scenario).is_some()
        };
        assert_eq!([3_000, 3_001].map(resumes), [true, false]);
    }
}
