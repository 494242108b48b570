//! A run of its own for the page: paced, paused, stepped, begun anew.

use core::time::Duration;
use std::sync::Arc;

use protocols::Instant;

use super::desk::{Desk, Effect};
use super::hub::Hub;
use super::pace::PagePace;
use crate::realtime::clock::Clock;
use crate::run::Run;
use crate::scenario::{Scenario, ScenarioError, Source};

/// Virtual time that passes at once: after each the wall clock is looked at.
const SLICE: Duration = Duration::from_millis(10);
/// Wall time after which the pages have their turn, even if the run is late.
const BUSY_MAX: Duration = Duration::from_millis(20);
/// Wall time between two turns.
const TURN: Duration = Duration::from_millis(5);

/// A run on show, and the clock that moves it.
pub(crate) struct Session<C> {
    scenario: Scenario,
    source: Source,
    hub: Arc<Hub>,
    clock: C,
    run: Run,
    desk: Desk,
    pace: PagePace,
    number: u64,
}

impl<C: Clock> Session<C> {
    /// Wires `scenario` and shows it at `hub`; `speed` is that of virtual time.
    ///
    /// # Errors
    /// If the scenario cannot be wired.
    pub(crate) fn new(
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
        })
    }

    /// The run.
    pub(crate) const fn run(&self) -> &Run {
        &self.run
    }

    /// The clock.
    pub(crate) const fn clock(&self) -> &C {
        &self.clock
    }

    /// One turn: does what pages ask, brings the run up to where it should be, shows it, waits.
    pub(crate) fn turn(&mut self) {
        let wall = self.clock.now();
        let mut restart = None;
        let (pace, desk) = (&mut self.pace, &mut self.desk);
        desk.obey_all(&mut self.run, wall, |run, effect| {
            let now = run.rig.now();
            match effect {
                Effect::Done => {}
                Effect::Pause => pace.pause(),
                Effect::Play => pace.play(wall, now),
                Effect::Step(millis) => run.go_on_until(pace.step(millis, now)),
                Effect::Speed(speed) => pace.set_speed(speed, wall, now),
                Effect::Restart(seed) => restart = Some(seed),
            }
            Ok(())
        });
        if let Some(seed) = restart {
            self.restart(seed);
        }
        let target = self.pace.target(wall, self.run.rig.now());
        let enough = wall + BUSY_MAX;
        while self.run.rig.now() < target && self.clock.now() < enough {
            let next = (self.run.rig.now() + SLICE).min(target);
            self.run.go_on_until(next);
        }
        self.desk.show(&self.run, wall, Some(&self.pace));
        if self.run.rig.now() >= target {
            self.clock.sleep_until(wall + TURN);
        }
    }

    /// Begins anew. The scenario could be wired before, and a seed changes nothing about that.
    fn restart(&mut self, seed: Option<u64>) {
        let seed = seed.map_or(self.run.scenario().seed, |seed| seed & (u64::MAX >> 1));
        let run = Run::new(self.scenario.clone(), &self.source, Some(seed));
        self.run = run.expect("was wired before");
        self.number += 1;
        self.desk = Desk::new(&mut self.run, Arc::clone(&self.hub), self.number);
        self.pace.play(self.clock.now(), self.run.rig.now());
    }
}
