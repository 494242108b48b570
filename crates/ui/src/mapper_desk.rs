//! A mapper on the page: no rig and no robot's program, only scans of a log, at the speed that the
//! page sets.

use core::time::Duration;
use std::sync::{Arc, PoisonError};

use emulators::world::Pose;
use emulators::{Event, EventKind};
use protocols::Instant;
use serde_json::json;

use super::command::{Answer, Command};
use super::desk::SHOW_EVERY;
use super::figures::{self, short_pose};
use super::hub::Hub;
use super::map_layers::MapLayer;
use super::pace::{PagePace, SPEED_MAX};
use super::snapshot::{Numbered, Snapshot};
use super::timeline::Sample;
use super::told;
use engine::rig::Logged;
use engine::robots::{Overlay, Panel};
use realtime::clock::Clock;
use show::view::Outline;

/// Radius of the drawn robot: the log does not contain its size.
const RADIUS_M: f64 = 0.2;
/// Maximum wait for the next scan: while the robot stands still, nothing changes.
const WAIT_MAX: Duration = Duration::from_secs(1);
/// Interval at which commands of a page are read.
const TURN: Duration = Duration::from_millis(5);
/// Drawing the map takes at most this fraction of the time, as a divisor.
const DRAWING: u32 = 3;

/// The current state of a mapper.
#[derive(Debug)]
pub struct Known {
    /// The activity, in words.
    pub state: String,
    /// Pose of the newest scan, metres and radians.
    pub pose: Pose,
    /// End points of its beams: x and y alternately, metres.
    pub scan: Vec<f64>,
    /// The path, and loop closures.
    pub overlays: Vec<Overlay>,
    /// Figures.
    pub panels: Vec<Panel>,
    /// Columns and rows of the map.
    pub size: [usize; 2],
    /// Edge of a cell, metres.
    pub cell_m: f64,
    /// Corner with minimum x and y, metres.
    pub corner_m: [f64; 2],
    /// Cells from free (0) over unknown to wall (255), row by row from the corner on.
    pub cells: Vec<u8>,
}

/// Displays a running mapper.
#[derive(Debug)]
pub struct MapperDesk {
    hub: Arc<Hub>,
    name: String,
    pace: PagePace,
    /// Time of the newest scan in the log.
    at: Instant,
    /// Time up to which a page has allowed steps.
    step: Instant,
    /// A step extends at least to the next scan.
    is_stepped: bool,
    layer: MapLayer,
    slow: Numbered,
    scan: Numbered,
    overlays: Numbered,
    believed: Option<[f64; 3]>,
    state: String,
    is_over: bool,
    /// Wall clock time after which the map may be drawn again.
    draws_at: Instant,
}

impl MapperDesk {
    /// A desk for the log `name`; starts at the wall clock time `wall` with the maximum speed of
    /// pages.
    pub fn new(hub: Arc<Hub>, name: &str, wall: Instant) -> Self {
        Self {
            hub,
            name: name.to_owned(),
            pace: PagePace::new(SPEED_MAX, wall, Instant::ZERO),
            at: Instant::ZERO,
            step: Instant::ZERO,
            is_stepped: false,
            layer: MapLayer::new("mapper"),
            slow: Numbered::new("{}"),
            scan: Numbered::new("{}"),
            overlays: Numbered::new("{}"),
            believed: None,
            state: String::new(),
            is_over: false,
            draws_at: wall,
        }
    }

    /// Waits until the scan at `at` is due and executes commands of pages meanwhile; returns early
    /// when `is_done` returns true.
    pub fn wait(&mut self, at: Instant, clock: &dyn Clock, is_done: &dyn Fn() -> bool) {
        let began = clock.now();
        loop {
            let wall = clock.now();
            self.obey(wall);
            let is_paused = self.pace.is_paused();
            let due = self.pace.target(wall, self.at).max(self.step);
            let is_due = at <= due || core::mem::take(&mut self.is_stepped);
            if is_due || is_done() || !is_paused && wall - began >= WAIT_MAX {
                break;
            }
            clock.sleep_until(wall + TURN);
        }
        if self.at < at {
            self.at = at;
            let wall = clock.now();
            let (speed, is_paused) = (self.pace.speed(), self.pace.is_paused());
            // Time that was skipped need not be caught up.
            if !is_paused && wall - began >= WAIT_MAX {
                self.pace.set_speed(speed, wall, at);
            }
        }
    }

    /// Whether the state should be shown at the wall clock time `wall`; a mapper in single steps
    /// shows each scan.
    pub fn is_due(&self, wall: Instant) -> bool {
        self.pace.is_paused() || wall >= self.draws_at
    }

    /// Records an event at the newest scan.
    pub fn tell(&self, rule: &'static str, detail: String) {
        let event = Event {
            at: self.at,
            kind: EventKind::Note,
            rule,
            detail,
            bytes: Vec::new(),
        };
        let source = "mapper".to_owned();
        let mut timeline = self
            .hub
            .timeline
            .write()
            .unwrap_or_else(PoisonError::into_inner);
        timeline.event(&Logged {
            source,
            event,
            is_kept: false,
        });
    }

    /// Shows the state. `began` is the wall clock time at which drawing began.
    pub fn show(&mut self, known: &Known, began: Instant, clock: &dyn Clock) {
        let row = |y: usize| known.cells.get(y * known.size[0]..(y + 1) * known.size[0]);
        self.layer
            .look(known.size, known.cell_m, known.corner_m, row);
        let slow = json!({"type": "slow", "lanes": [], "panels": known.panels, "counters": [],
                          "faults": []});
        self.slow.renew(slow.to_string());
        let at_ns = self.at.as_nanos();
        let scan = json!({"type": "scan", "at_ns": at_ns, "points": known.scan});
        self.scan.renew(scan.to_string());
        self.overlays.renew(told::overlays(&known.overlays));
        self.believed = Some(short_pose(known.pose));
        self.state.clone_from(&known.state);
        self.publish(&figures::of_panels(&known.panels));
        let now = clock.now();
        self.draws_at = (now + (now - began) * (DRAWING - 1)).max(began + SHOW_EVERY);
    }

    /// Ends the log; the display stays.
    pub fn end(&mut self) {
        self.is_over = true;
        self.pace.pause();
        self.hub.show(self.snapshot());
    }

    /// One turn of a page after the end of the log.
    pub fn stay(&mut self, clock: &dyn Clock) {
        let wall = clock.now();
        self.obey(wall);
        clock.sleep_until(wall + TURN);
    }

    /// Executes the commands of pages.
    fn obey(&mut self, wall: Instant) {
        let mut was_asked = false;
        while let Some(envelope) = self.hub.next_command() {
            was_asked = true;
            match envelope.command {
                Command::Pause => self.pace.pause(),
                Command::Play if !self.is_over => self.pace.play(wall, self.at),
                Command::Step { ms } if !self.is_over => {
                    self.step = self.pace.step(ms, self.step.max(self.at));
                    self.is_stepped = true;
                }
                Command::Speed { x } => self.pace.set_speed(x, wall, self.at),
                Command::Play | Command::Step { .. } => {
                    envelope.answer(Answer::Refused("the log is over".to_owned()));
                }
                _ => {
                    let why = "there is no rig behind this page, only a log";
                    envelope.answer(Answer::Refused(why.to_owned()));
                }
            }
        }
        if was_asked {
            self.hub.show(self.snapshot());
        }
    }

    /// Publishes the state to the pages and to the record.
    fn publish(&self, figures: &[figures::Figure]) {
        let mut timeline = self
            .hub
            .timeline
            .write()
            .unwrap_or_else(PoisonError::into_inner);
        if timeline.wants_sample(self.at) {
            timeline.sample(&Sample {
                at: self.at,
                truth: None,
                believed: None,
                tallies: &[],
                figures,
            });
        }
        if timeline.wants_moment(self.at) {
            timeline.moment(self.at, self.snapshot());
        }
        drop(timeline);
        self.hub.show(self.snapshot());
    }

    fn snapshot(&self) -> Snapshot {
        let fast = json!({
            "type": "now",
            "run": 1,
            "at_ns": self.at.as_nanos(),
            "looked_ns": self.at.as_nanos(),
            "paused": self.pace.is_paused(),
            "speed": self.pace.speed(),
            "truth": null,
            "believed": self.believed,
            "over": self.is_over,
            "mode": self.state,
            "pc": null,
            "maps": [self.layer.last().head],
            "scene": null,
        });
        let stage = json!({
            "type": "stage",
            "run": 1,
            "kind": "log",
            "name": self.name,
            "description": "a log while it is mapped",
            "seed": null,
            "scene": null,
            "footprint": Outline::Circle([0.0, 0.0, RADIUS_M]),
            "links": [],
            "pace": true,
            "speed_max": SPEED_MAX,
            "pc": false,
        });
        Snapshot {
            run: 1,
            stage: stage.to_string().into(),
            fast: fast.to_string().into(),
            slow: self.slow.clone(),
            scan: self.scan.clone(),
            overlays: self.overlays.clone(),
            checks: Numbered::new("{}"),
            layers: vec![self.layer.last()],
        }
    }
}

#[cfg(test)]
mod tests {
    use tokio::sync::mpsc;

    use super::*;
    use realtime::clock::SimClock;

    /// A scan every 3 s and steps of 10 ms: each step shows the next scan; without a step a paused
    /// page does not change.
    #[test]
    fn a_step_goes_to_the_next_scan() {
        let (hub, clock) = (Hub::new(), SimClock::default());
        let mut desk = MapperDesk::new(Arc::clone(&hub), "log", clock.now());
        let (reply, _answers) = mpsc::channel(4);
        hub.ask(Command::Pause, &reply);
        let until = |seconds: u64| {
            let end = clock.now() + Duration::from_secs(seconds);
            let clock = &clock;
            move || clock.now() >= end
        };
        for scan in 1..4 {
            hub.ask(Command::Step { ms: 10 }, &reply);
            let began = clock.now();
            desk.wait(Instant::from_secs(3 * scan), &clock, &until(60));
            assert_eq!(
                (clock.now(), desk.at),
                (began, Instant::from_secs(3 * scan))
            );
            assert!(desk.is_due(clock.now()));
        }
        let began = clock.now();
        desk.wait(Instant::from_secs(12), &clock, &until(60));
        assert_eq!(clock.now() - began, Duration::from_secs(60));
    }

    /// At a hundred times the speed of the log 3 s take 30 ms; a gap of an hour takes a second.
    #[test]
    fn a_gap_is_not_waited_for() {
        let clock = SimClock::default();
        let mut desk = MapperDesk::new(Hub::new(), "log", clock.now());
        desk.wait(Instant::from_secs(3), &clock, &|| false);
        assert_eq!(clock.now(), Instant::from_millis(30));
        desk.wait(Instant::from_secs(3_603), &clock, &|| false);
        assert_eq!(clock.now(), Instant::from_millis(1_030));
        desk.wait(Instant::from_secs(3_606), &clock, &|| false);
        assert_eq!(clock.now(), Instant::from_millis(1_060));
    }
}
