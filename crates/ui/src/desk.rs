//! The connection between a run and the pages: executes the pages' commands and shows the run's
//! state.

use core::time::Duration;
use std::sync::{Arc, PoisonError};

use axum::extract::ws::Utf8Bytes;
use emulators::world::Pose;
use firmware_core::map_view::MapView;
use protocols::Instant;
use serde_json::{Value, json};

use super::command::{Answer, Command, Envelope};
use super::deed::{Deed, Deeds};
use super::figures::{self, short_pose};
use super::hub::Hub;
use super::map_layers::MapLayer;
use super::pace::{PagePace, Tempo};
use super::snapshot::{Numbered, Snapshot};
use super::timeline::{Sample, Timeline};
use super::told;
use super::wire::{Counted, Tally, Wire};
use engine::Shared;
use engine::rig::fault::FaultId;
use engine::robots::{Display, Gesture, Hand};
use engine::run::Run;
use engine::scenario::Span;
use show::view;

/// Wall time between two snapshots: short enough for smooth motion.
pub(super) const SHOW_EVERY: Duration = Duration::from_millis(50);
/// Wall time between two updates of large or slowly changing data.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// Virtual time between two samples of a repeated run.
const REDO_SLICE: Duration = Duration::from_millis(100);
/// Wall time between two updates of the verdicts: some compare the whole map.
const JUDGE_EVERY: Duration = Duration::from_millis(500);
/// Maximum number of commands between two steps.
const COMMANDS_AT_ONCE: usize = 64;

/// The part of a command that the desk does not execute.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Effect {
    /// Nothing is left to do.
    Done,
    /// A command to the clock.
    Pause,
    Play,
    Step(u32),
    Speed(f64),
    Restart(Option<u64>),
    Branch(Instant),
}

/// One displayed run.
pub struct Desk {
    hub: Arc<Hub>,
    number: u64,
    wire: Shared<Wire>,
    stage: Utf8Bytes,
    /// The time at which it branched from an earlier run.
    branched: Option<Instant>,
    hand: Hand,
    deeds: Deeds,
    /// The robot's map and display, and its other maps.
    layers: Vec<MapLayer>,
    slow: Numbered,
    scan: Numbered,
    scan_turn: u64,
    overlays: Numbered,
    checks: Numbered,
    shown: Option<(Instant, Shown)>,
    looked: Option<(Instant, Instant)>,
    judged: Option<(Instant, Instant)>,
    /// Counters at the last two updates between which virtual time advanced.
    tallies: [Vec<[Tally; 2]>; 2],
    counted_at: [Instant; 2],
    events: usize,
    changes: u64,
}

/// Values that are equal in equal snapshots.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shown {
    now: Instant,
    clients: usize,
    tempo: Tempo,
}

impl Desk {
    /// Displays `run`; `number` distinguishes it from earlier runs.
    pub fn new(run: &mut Run, hub: Arc<Hub>, number: u64) -> Self {
        let wire = Wire::listen(run, &hub.log);
        let mut timeline = hub.timeline.write().unwrap_or_else(PoisonError::into_inner);
        *timeline = Timeline::new(timeline.generation + 1);
        drop(timeline);
        Self::with(wire, hub, number)
    }

    /// Displays a run that branched from an earlier time of the current one, with the counters
    /// `counted`. Actions before `at` must still be [repeated](Self::redo).
    pub(super) fn branch(
        &self,
        run: &mut Run,
        counted: &Counted,
        number: u64,
        at: Instant,
    ) -> Self {
        let hub = Arc::clone(&self.hub);
        let wire = Wire::go_on(run, &hub.log, counted);
        let events = run.rig.events().len();
        let mut timeline = hub.timeline.write().unwrap_or_else(PoisonError::into_inner);
        timeline.cut(run.rig.now(), events);
        drop(timeline);
        Self {
            branched: Some(at),
            deeds: self.deeds.clone(),
            counted_at: [run.rig.now(); 2],
            events,
            ..Self::with(wire, hub, number)
        }
    }

    fn with(wire: Shared<Wire>, hub: Arc<Hub>, number: u64) -> Self {
        let tallies = wire.lock().tallies();
        Self {
            hub,
            number,
            tallies: [tallies.clone(), tallies],
            counted_at: [Instant::ZERO; 2],
            wire,
            stage: Utf8Bytes::default(),
            branched: None,
            hand: Hand::default(),
            deeds: Deeds::default(),
            layers: Vec::new(),
            slow: Numbered::new("{}"),
            scan: Numbered::new("{}"),
            scan_turn: 0,
            overlays: Numbered::new(&told::overlays(&[])),
            checks: Numbered::new("{}"),
            shown: None,
            looked: None,
            judged: None,
            events: 0,
            changes: 0,
        }
    }

    /// Repeats the run's actions until `until`; `wall` is the time of the wall clock.
    pub(super) fn redo(&mut self, run: &mut Run, until: Instant, wall: Instant) {
        // Only a session with its own clock can go back; it is paused afterwards.
        let tempo = Tempo {
            is_paused: true,
            speed: 1.0,
            is_ours: true,
        };
        let mut deeds = self
            .deeds
            .split(run.rig.now(), until)
            .into_iter()
            .peekable();
        loop {
            let now = run.rig.now();
            let slice = (now + REDO_SLICE).min(until);
            while let Some((_, deed)) = deeds.next_if(|(at, _)| *at <= now) {
                // The action succeeded before, in the same state.
                drop(deed.perform(run));
            }
            self.record(run, wall, tempo);
            if now >= until {
                return;
            }
            let next = deeds.peek().map_or(slice, |(at, _)| slice.min(*at));
            run.go_on_until(next);
        }
    }

    /// The counters so far.
    pub(super) fn counted(&self) -> Counted {
        self.wire.lock().counted()
    }

    /// Number of changes to the run by operators at the pages so far.
    pub const fn changes(&self) -> u64 {
        self.changes
    }

    /// One turn of a run with an external clock: executes commands of the pages, and shows the run.
    /// `wall` is the time of the wall clock.
    pub fn turn(&mut self, run: &mut Run, wall: Instant) {
        self.obey_all(run, wall, |_, _| {
            Err("this run follows the wall clock: its ports are open to others".to_owned())
        });
        self.show(run, wall, None);
    }

    /// Executes the queued commands; `other` executes the parts that the desk does not.
    pub(super) fn obey_all(
        &mut self,
        run: &mut Run,
        wall: Instant,
        mut other: impl FnMut(&mut Run, Effect) -> Result<(), String>,
    ) {
        for _ in 0..COMMANDS_AT_ONCE {
            let Some(envelope) = self.hub.next_command() else {
                break;
            };
            let done = match self.obey(run, wall, &envelope) {
                Ok(Effect::Done) => {
                    self.changes += u64::from(envelope.command != Command::Save);
                    Ok(())
                }
                Ok(effect) => other(run, effect),
                Err(refusal) => Err(refusal),
            };
            self.shown = None;
            if let Err(refusal) = done {
                envelope.answer(Answer::Refused(refusal));
            }
        }
        if let Some(gesture) = self.hand.tick(wall) {
            // The operator has disconnected while driving; if the robot has gone too, the action
            // has no effect.
            drop(self.deeds.perform(run, Deed::Gesture(gesture)));
        }
    }

    fn obey(
        &mut self,
        run: &mut Run,
        wall: Instant,
        envelope: &Envelope,
    ) -> Result<Effect, String> {
        match &envelope.command {
            Command::Pause => return Ok(Effect::Pause),
            Command::Play => return Ok(Effect::Play),
            Command::Step { ms } => return Ok(Effect::Step(*ms)),
            Command::Speed { x } => return Ok(Effect::Speed(*x)),
            Command::Restart { seed } => return Ok(Effect::Restart(*seed)),
            Command::Branch { at_ns } => return Ok(Effect::Branch(Instant::from_nanos(*at_ns))),
            Command::Save => envelope.answer(Answer::Case(run.case_so_far().to_toml())),
            Command::Fault { fault, for_ms } => {
                let mut fault = fault.clone();
                let now = run.rig.now() - Instant::ZERO;
                let until = for_ms.map(|ms| Span(now + Duration::from_millis(u64::from(ms))));
                fault.until = until.or(fault.until);
                self.deeds.perform(run, Deed::Fault(fault))?;
            }
            Command::EndFault { id } => {
                self.deeds.perform(run, Deed::EndFault(FaultId(*id)))?;
            }
            Command::Tap { place } => self.deeds.perform(run, Deed::Tap(*place))?,
            Command::Drive { axes } => {
                if let Some(gesture) = self.hand.hold(wall, axes) {
                    let done = self.deeds.perform(run, Deed::Gesture(gesture));
                    done.inspect_err(|_| self.hand.let_go())?;
                }
            }
            command => {
                let gesture = command.gesture().expect("the others are done above");
                if matches!(gesture, Gesture::Mode(_) | Gesture::Disconnect) {
                    self.hand.let_go();
                }
                self.deeds.perform(run, Deed::Gesture(gesture))?;
            }
        }
        Ok(Effect::Done)
    }

    /// Shows the run's state if it has changed and a page is connected. `pace` is the clock, if it
    /// can be set.
    pub(super) fn show(&mut self, run: &Run, wall: Instant, pace: Option<&PagePace>) {
        let tempo = Tempo::of(pace);
        self.record(run, wall, tempo);
        let shown = Shown {
            now: run.rig.now(),
            clients: self.hub.clients(),
            tempo,
        };
        let is_news = self.shown.is_none_or(|(at, last)| {
            let is_time = wall - at >= SHOW_EVERY;
            is_time && last != shown && (shown.clients > 0 || last.tempo != tempo)
        });
        if !is_news {
            return;
        }
        let forced = self
            .shown
            .is_none_or(|(_, last)| last.tempo != tempo || tempo.is_paused);
        self.shown = Some((wall, shown));
        if forced || self.looked.is_none_or(|(at, _)| wall - at >= LOOK_EVERY) {
            self.look(run, wall);
        }
        let is_old = |(at, of): (Instant, Instant)| wall - at >= JUDGE_EVERY && of < shown.now;
        if forced || self.judged.is_none_or(is_old) {
            self.judge(run, wall);
        }
        let snapshot = self.snapshot(run, tempo);
        self.hub.show(snapshot);
    }

    fn snapshot(&mut self, run: &Run, tempo: Tempo) -> Snapshot {
        if self.stage.is_empty() {
            let stage = told::stage(run, self.number, tempo, self.branched);
            self.stage = stage.to_string().into();
        }
        Snapshot {
            run: self.number,
            stage: self.stage.clone(),
            fast: self.fast(run, tempo).to_string().into(),
            slow: self.slow.clone(),
            scan: self.scan.clone(),
            overlays: self.overlays.clone(),
            checks: self.checks.clone(),
            layers: self.layers.iter().map(MapLayer::last).collect(),
        }
    }

    /// Updates the timeline.
    pub(super) fn record(&mut self, run: &Run, wall: Instant, tempo: Tempo) {
        let now = run.rig.now();
        let hub = Arc::clone(&self.hub);
        let mut timeline = hub.timeline.write().unwrap_or_else(PoisonError::into_inner);
        for logged in run.rig.events().get(self.events..).unwrap_or_default() {
            timeline.event(logged);
        }
        self.events = run.rig.events().len();
        if timeline.wants_sample(now) {
            timeline.sample(&Sample {
                at: now,
                truth: Some(short_pose(run.rig.world.pose())),
                believed: believed(run).map(short_pose),
                tallies: &self.wire.lock().tallies(),
                figures: &figures::all(run),
            });
        }
        if timeline.wants_moment(now) {
            self.look(run, wall);
            self.judge(run, wall);
            timeline.moment(now, self.snapshot(run, tempo));
        }
    }

    /// Updates the verdicts.
    fn judge(&mut self, run: &Run, wall: Instant) {
        let checks = told::checks(run).to_string();
        if *self.checks.text != checks {
            self.checks.renew(checks);
        }
        self.judged = Some((wall, run.rig.now()));
    }

    /// Updates large or slowly changing data.
    fn look(&mut self, run: &Run, wall: Instant) {
        self.look_at_maps(run);
        let now = run.rig.now();
        // A paused run keeps showing its last load.
        if now > self.counted_at[1] {
            self.tallies.swap(0, 1);
            self.tallies[1] = self.wire.lock().tallies();
            self.counted_at = [self.counted_at[1], now];
        }
        let ([before, after], [since, until]) = (&self.tallies, self.counted_at);
        let slow = told::slow(run, before, after, until - since);
        self.slow.renew(slow.to_string());
        self.looked = Some((wall, now));
        let overlays = told::overlays(&run.instruments().overlays(&run.rig));
        if *self.overlays.text != overlays {
            self.overlays.renew(overlays);
        }
        self.look_at_scan(run);
    }

    /// The scan as the program received it, or else the last turn on the wire.
    fn look_at_scan(&mut self, run: &Run) {
        let own = run.instruments().scan(&run.rig);
        let turn = self.wire.lock().scan().clone();
        let (at, points) = if own.is_empty() {
            if turn.turn == self.scan_turn {
                return;
            }
            self.scan_turn = turn.turn;
            let pose = believed(run).unwrap_or_else(|| run.rig.world.pose_at(turn.at));
            (turn.at, turn.points(pose))
        } else {
            let at = run.estimate().map_or(turn.at, |(at, _)| at);
            (at, own.into_iter().flatten().collect())
        };
        let at_ns = at.as_nanos();
        let scan = json!({"type": "scan", "at_ns": at_ns, "points": points}).to_string();
        if *self.scan.text != scan {
            self.scan.renew(scan);
        }
    }

    fn look_at_maps(&mut self, run: &Run) {
        let instruments = run.instruments();
        let map = instruments.map(&run.rig).map(|map| ("robot", map));
        for (name, map) in map.into_iter().chain(instruments.layers(&run.rig)) {
            look_at_map(self.layer(name), map);
        }
        if let Some(display) = instruments.display(&run.rig) {
            look_at_display(self.layer("display"), display);
        }
    }

    /// The layer called `name`, which is created if necessary.
    fn layer(&mut self, name: &'static str) -> &mut MapLayer {
        let known = self.layers.iter().position(|book| book.name() == name);
        let index = known.unwrap_or_else(|| {
            self.layers.push(MapLayer::new(name));
            self.layers.len() - 1
        });
        &mut self.layers[index]
    }

    fn fast(&self, run: &Run, tempo: Tempo) -> Value {
        let instruments = run.instruments();
        let station = instruments.station(&run.rig);
        let heads: Vec<_> = self.layers.iter().map(|book| book.last().head).collect();
        let moving = run.rig.world.has_moving();
        json!({
            "type": "now",
            "run": self.number,
            "at_ns": run.rig.now().as_nanos(),
            "looked_ns": self.looked.map(|(_, at)| at.as_nanos()),
            "paused": tempo.is_paused,
            "speed": tempo.speed,
            "truth": short_pose(run.rig.world.pose()),
            "believed": believed(run).map(short_pose),
            "gap": figures::gap(run),
            "over": run.is_over(),
            "mode": instruments.mode(&run.rig),
            "pc": station.map(|station| station.view(run.rig.now())),
            "maps": heads,
            "scene": moving.then(|| view::scene(&run.rig.world)),
        })
    }
}

/// Estimated pose of the robot.
fn believed(run: &Run) -> Option<Pose> {
    run.estimate().map(|(_, pose)| pose)
}

/// Updates the layer of a map.
pub(super) fn look_at_map(book: &mut MapLayer, map: MapView<'_>) {
    let resolution_m = f64::from(map.cell_mm()) / 1000.0;
    let origin_m = map.origin_mm().map(|mm| f64::from(mm) / 1000.0);
    let size = [map.width(), map.height()];
    book.look(size, resolution_m, origin_m, |y| map.row(y));
}

/// Updates the layer of the robot's display. A row has the upper bytes of its pixels, then the
/// lower ones: both have longer runs than the pixels.
fn look_at_display(book: &mut MapLayer, display: Display<'_>) {
    let rows = display.pixels.chunks(display.width);
    let bytes = rows.flat_map(|row| {
        let byte = |index: usize| row.iter().map(move |pixel| pixel.to_be_bytes()[index]);
        byte(0).chain(byte(1))
    });
    let bytes: Vec<u8> = bytes.collect();
    let width = 2 * display.width;
    let row = |y: usize| bytes.get(y * width..(y + 1) * width);
    book.look([width, display.height()], 0.0, [0.0; 2], row);
}
