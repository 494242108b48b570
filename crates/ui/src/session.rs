//! A run with its own clock for the page: speed, pause, steps, restart.

use core::time::Duration;
use std::sync::Arc;

use protocols::Instant;

use super::checkpoints::Checkpoints;
use super::desk::{Desk, Effect};
use super::hub::Hub;
use super::pace::{PagePace, Tempo};
use engine::rig::Paced;
use engine::run::Run;
use engine::scenario::{Scenario, ScenarioError, Source};
use realtime::clock::Clock;

/// Virtual time between two checks of the wall clock.
const SLICE: Duration = Duration::from_millis(10);
/// Wall time after which the pages get their turn, even if the run is late.
const BUSY_MAX: Duration = Duration::from_millis(20);
/// Wall time between two turns.
const TURN: Duration = Duration::from_millis(5);

/// A displayed run, and its clock.
pub struct Session<C> {
    scenario: Scenario,
    source: Source,
    hub: Arc<Hub>,
    clock: C,
    run: Run,
    desk: Desk,
    pace: PagePace,
    number: u64,
    checkpoints: Checkpoints,
    /// Whether the run has reached its end and paused there once.
    has_ended: bool,
}

impl<C: Clock> Session<C> {
    /// Wires `scenario` and shows it at `hub`; `speed` is the speed of virtual time.
    ///
    /// # Errors
    /// If the scenario cannot be wired.
    pub fn new(
        scenario: Scenario,
        source: Source,
        hub: Arc<Hub>,
        clock: C,
        speed: f64,
    ) -> Result<Self, ScenarioError> {
        let run = Run::new(scenario.clone(), &source, None);
        let mut run = run?;
        let desk = Desk::new(&mut run, Arc::clone(&hub), 1);
        let pace = PagePace::new(speed, clock.now(), Instant::ZERO);
        Ok(Self {
            scenario,
            source,
            hub,
            clock,
            run,
            desk,
            pace,
            number: 1,
            checkpoints: Checkpoints::default(),
            has_ended: false,
        })
    }

    /// Pauses until the operator resumes.
    pub const fn pause(&mut self) {
        self.pace.pause();
    }

    /// The run.
    pub const fn run(&self) -> &Run {
        &self.run
    }

    /// The clock.
    pub const fn clock(&self) -> &C {
        &self.clock
    }

    /// One turn: executes commands of pages, advances the run to its target, shows it, waits.
    pub fn turn(&mut self) {
        let wall = self.clock.now();
        let (mut restart, mut branch, mut step) = (None, None, None);
        self.checkpoints.offer(&self.run, || self.desk.counted());
        let first = self.checkpoints.first();
        let (pace, desk) = (&mut self.pace, &mut self.desk);
        desk.obey_all(&mut self.run, wall, |run, effect| {
            let now = run.rig.now();
            match effect {
                Effect::Done => {}
                Effect::Pause => pace.pause(),
                Effect::Play => pace.play(wall, now),
                Effect::Step(millis) => step = Some(pace.step(millis, step.unwrap_or(now))),
                Effect::Speed(speed) => pace.set_speed(speed, wall, now),
                Effect::Restart(seed) => restart = Some(seed),
                Effect::Branch(at) if at > now => {
                    return Err("that time is still to come".to_owned());
                }
                Effect::Branch(at) if first.is_none_or(|first| at < first) => {
                    return Err(
                        "this run cannot be copied: it has a custom checker, or a client that \
                                waits for bytes"
                            .to_owned(),
                    );
                }
                Effect::Branch(at) => branch = Some(at),
            }
            Ok(())
        });
        if let Some(seed) = restart {
            self.restart(seed);
        } else if let Some(at) = branch {
            self.branch(at);
        }
        while step.is_some_and(|step| self.run.rig.now() < step) {
            if self.slice(step.unwrap_or_default(), wall) {
                break;
            }
        }
        let target = self.pace.target(wall, self.run.rig.now());
        let enough = wall + BUSY_MAX;
        while self.run.rig.now() < target && self.clock.now() < enough {
            if self.slice(target, wall) {
                break;
            }
        }
        self.checkpoints.offer(&self.run, || self.desk.counted());
        self.desk.show(&self.run, wall, Some(&self.pace));
        if self.run.rig.now() >= target {
            self.clock.sleep_until(wall + TURN);
        }
    }

    /// Advances the run a little, at most to `target`; returns whether it has just ended.
    fn slice(&mut self, target: Instant, wall: Instant) -> bool {
        // On a busy machine there are fewer turns, but the record is not coarser.
        let tempo = Tempo::of(Some(&self.pace));
        self.desk.record(&self.run, wall, tempo);
        let next = (self.run.rig.now() + SLICE).min(target);
        forward(&mut self.run, next);
        let ends = self.run.is_over() && !self.has_ended;
        if ends {
            self.has_ended = true;
            self.pace.pause();
        }
        ends
    }

    /// Restarts the run. The scenario could be wired before, independent of the seed.
    fn restart(&mut self, seed: Option<u64>) {
        let seed = seed.map_or(self.run.scenario().seed, |seed| seed & (u64::MAX >> 1));
        let run = Run::new(self.scenario.clone(), &self.source, Some(seed));
        self.run = run.expect("was wired before");
        self.number += 1;
        self.desk = Desk::new(&mut self.run, Arc::clone(&self.hub), self.number);
        self.checkpoints = Checkpoints::default();
        self.has_ended = false;
        self.pace.play(self.clock.now(), self.run.rig.now());
    }

    /// Goes back to `at` and pauses there, to branch.
    fn branch(&mut self, at: Instant) {
        let Some(kept) = self.checkpoints.back_to(at) else {
            return;
        };
        let wall = self.clock.now();
        let mut run = kept.run.resume();
        self.number += 1;
        let mut desk = self.desk.branch(&mut run, &kept.counted, self.number, at);
        desk.redo(&mut run, at, wall);
        (self.run, self.desk) = (run, desk);
        self.has_ended = self.run.is_over();
        self.pace.pause();
    }
}

/// Advances to the end of the scenario; afterwards the run continues without being judged.
fn forward(run: &mut Run, until: Instant) {
    if run.is_over() {
        run.go_on_until(until);
    } else {
        run.run_until(until);
    }
}
