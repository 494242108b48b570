//! Between a run and the pages: does what they ask, shows them what there is.

use core::cell::RefCell;
use core::time::Duration;
use std::rc::Rc;
use std::sync::{Arc, PoisonError};

use axum::extract::ws::Utf8Bytes;
use emulators::world::Pose;
use firmware_core::map_view::MapView;
use protocols::Instant;
use serde_json::{Value, json};

use super::command::{Answer, Command, Envelope};
use super::hub::Hub;
use super::map_layers::MapLayer;
use super::pace::{PagePace, SPEED_MAX};
use super::snapshot::{Numbered, Snapshot};
use super::timeline::{Sample, Timeline, short_pose};
use super::wire::{Tally, Wire};
use crate::rig::fault::FaultId;
use crate::rig::line::Direction;
use crate::robots::{Display, Gesture, Hand, Overlay, Station};
use crate::run::Run;
use crate::scenario::Span;
use crate::show::view;

/// Wall time between two snapshots: what an eye takes for motion.
pub(super) const SHOW_EVERY: Duration = Duration::from_millis(50);
/// Wall time between two looks at what is large or changes slowly.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// Most commands that are done between two steps.
const COMMANDS_AT_ONCE: usize = 64;

/// What a command asks for that is not the desk's to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Effect {
    /// It is done.
    Done,
    /// Something about the clock.
    Pause,
    Play,
    Step(u32),
    Speed(f64),
    Restart(Option<u64>),
}

/// What the pages have to know of the clock.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tempo {
    is_paused: bool,
    speed: f64,
    is_ours: bool,
}

/// One run on show.
pub(crate) struct Desk {
    hub: Arc<Hub>,
    number: u64,
    wire: Rc<RefCell<Wire>>,
    stage: Utf8Bytes,
    hand: Hand,
    /// The robot's map and display, and what else it has of maps.
    layers: Vec<MapLayer>,
    slow: Numbered,
    scan: Numbered,
    scan_turn: u64,
    overlays: Numbered,
    shown: Option<(Instant, Shown)>,
    looked: Option<(Instant, Instant)>,
    tallies: Vec<[Tally; 2]>,
    events: usize,
    changes: u64,
}

/// What makes two snapshots the same.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shown {
    now: Instant,
    clients: usize,
    tempo: Tempo,
}

impl Desk {
    /// Puts `run` on show; `number` tells it from those before it.
    pub(crate) fn new(run: &mut Run, hub: Arc<Hub>, number: u64) -> Self {
        let wire = Wire::listen(run);
        let mut timeline = hub.timeline.write().unwrap_or_else(PoisonError::into_inner);
        *timeline = Timeline::new(timeline.generation + 1);
        drop(timeline);
        let tallies = wire.borrow().tallies();
        Self {
            hub,
            number,
            tallies,
            wire,
            stage: Utf8Bytes::default(),
            hand: Hand::default(),
            layers: Vec::new(),
            slow: Numbered::new("{}"),
            scan: Numbered::new("{}"),
            scan_turn: 0,
            overlays: Numbered::new(&overlays(&[])),
            shown: None,
            looked: None,
            events: 0,
            changes: 0,
        }
    }

    /// How often somebody at a page has changed the run so far.
    pub(crate) const fn changes(&self) -> u64 {
        self.changes
    }

    /// One turn of a run whose clock is somebody else's: does what pages ask, and shows the run.
    /// `wall` is the time of the wall clock.
    pub(crate) fn turn(&mut self, run: &mut Run, wall: Instant) {
        self.obey_all(run, wall, |_, _| {
            Err("this run follows the wall clock: its ports are open to others".to_owned())
        });
        self.show(run, wall, None);
    }

    /// Does what waits in the queue; `other` does what is not the desk's.
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
            // Whoever drove is gone; if the robot is gone as well, nothing is left to do.
            drop(does(run, gesture));
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
            Command::Save => envelope.answer(Answer::Case(run.case_so_far().to_toml())),
            Command::Fault { fault, for_ms } => {
                let mut fault = fault.clone();
                let now = run.rig.now() - Instant::ZERO;
                let until = for_ms.map(|ms| Span(now + Duration::from_millis(u64::from(ms))));
                fault.until = until.or(fault.until);
                run.inject(*fault).map_err(|flaw| flaw.to_string())?;
            }
            Command::EndFault { id } => {
                run.withdraw(FaultId(*id))
                    .map_err(|flaw| flaw.to_string())?;
            }
            Command::Tap { place } => run.tap(*place).map_err(|error| error.to_string())?,
            Command::Drive { axes } => {
                if let Some(gesture) = self.hand.hold(wall, axes) {
                    does(run, gesture).inspect_err(|_| self.hand.let_go())?;
                }
            }
            command => {
                let gesture = command.gesture().expect("the others are done above");
                if matches!(gesture, Gesture::Mode(_) | Gesture::Disconnect) {
                    self.hand.let_go();
                }
                does(run, gesture)?;
            }
        }
        Ok(Effect::Done)
    }

    /// Shows the run as it is, if there is something new and somebody to see it. `pace` is the
    /// clock, if it can be set.
    pub(super) fn show(&mut self, run: &Run, wall: Instant, pace: Option<&PagePace>) {
        self.record(run);
        let tempo = Tempo {
            is_paused: pace.is_some_and(PagePace::is_paused),
            speed: pace.map_or(1.0, PagePace::speed),
            is_ours: pace.is_some(),
        };
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
        if self.stage.is_empty() {
            self.stage = stage(run, self.number, tempo).to_string().into();
        }
        if forced || self.looked.is_none_or(|(at, _)| wall - at >= LOOK_EVERY) {
            self.look(run, wall);
        }
        self.hub.show(Snapshot {
            run: self.number,
            stage: self.stage.clone(),
            fast: self.fast(run, tempo).to_string().into(),
            slow: self.slow.clone(),
            scan: self.scan.clone(),
            overlays: self.overlays.clone(),
            layers: self.layers.iter().map(MapLayer::last).collect(),
        });
    }

    /// Keeps the timeline up.
    fn record(&mut self, run: &Run) {
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
                tallies: &self.wire.borrow().tallies(),
            });
        }
        if timeline.wants_maps(now) {
            self.look_at_maps(run);
            timeline.maps(now, self.layers.iter().map(MapLayer::last).collect());
        }
    }

    /// Looks at what is large or changes slowly.
    fn look(&mut self, run: &Run, wall: Instant) {
        self.look_at_maps(run);
        let now = run.rig.now();
        let since = self.looked.map_or(Instant::ZERO, |(_, at)| at);
        let tallies = self.wire.borrow().tallies();
        let slow = slow(run, &self.tallies, &tallies, now - since);
        self.slow.renew(slow.to_string());
        self.tallies = tallies;
        self.looked = Some((wall, now));
        let overlays = overlays(&run.instruments().overlays(&run.rig));
        if *self.overlays.text != overlays {
            self.overlays.renew(overlays);
        }
        let wire = self.wire.borrow();
        let scan = wire.scan();
        if scan.turn != self.scan_turn {
            self.scan_turn = scan.turn;
            let pose = believed(run).unwrap_or_else(|| run.rig.world.pose_at(scan.at));
            let points = scan.points(pose);
            let at = scan.at.as_nanos();
            self.scan
                .renew(json!({"type": "scan", "at_ns": at, "points": points}).to_string());
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

    /// The book called `name`, a new one if there is none.
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
        let moving = !run.rig.world.scene().obstacles().is_empty();
        json!({
            "type": "now",
            "run": self.number,
            "at_ns": run.rig.now().as_nanos(),
            "looked_ns": self.looked.map(|(_, at)| at.as_nanos()),
            "paused": tempo.is_paused,
            "speed": tempo.speed,
            "truth": short_pose(run.rig.world.pose()),
            "believed": believed(run).map(short_pose),
            "mode": instruments.mode(&run.rig),
            "pc": station.map(|station| station.view(run.rig.now())),
            "maps": heads,
            "scene": moving.then(|| view::scene(&run.rig.world)),
        })
    }
}

/// Lets the robot's station do a gesture.
fn does(run: &mut Run, gesture: Gesture) -> Result<(), String> {
    let station = run.instruments().station(&run.rig);
    let station = station.ok_or("the PC's end of the radio is a port: this page cannot use it")?;
    let action = station.answer(gesture)?;
    run.command(action).map_err(|error| error.to_string())
}

/// Where the robot believes to be.
fn believed(run: &Run) -> Option<Pose> {
    run.estimate().map(|(_, pose)| pose)
}

/// A map into its book.
pub(super) fn look_at_map(book: &mut MapLayer, map: MapView<'_>) {
    let resolution_m = f64::from(map.cell_mm()) / 1000.0;
    let origin_m = map.origin_mm().map(|mm| f64::from(mm) / 1000.0);
    let size = [map.width(), map.height()];
    book.look(size, resolution_m, origin_m, |y| map.row(y));
}

/// The robot's display into its book. A row is the upper bytes of its pixels, then the lower ones:
/// both have longer runs than the pixels.
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

/// What the robot has to show besides.
fn overlays(overlays: &[Overlay]) -> String {
    json!({"type": "overlays", "overlays": overlays}).to_string()
}

/// What stays the same.
fn stage(run: &Run, number: u64, tempo: Tempo) -> Value {
    let scenario = run.scenario();
    let links = run.rig.links().iter().map(|link| {
        let line = link.line(Direction::ToMaster);
        let [sender, _] = run.rig.line_configs(line);
        json!({"name": link.name, "baud": sender.baud})
    });
    let station = run.instruments().station(&run.rig);
    json!({
        "type": "stage",
        "run": number,
        "kind": "rig",
        "name": scenario.name,
        "description": scenario.description,
        "seed": scenario.seed,
        "scene": view::scene(&run.rig.world),
        "robot": scenario.robot,
        "footprint": view::footprint(&run.rig.world),
        "links": links.collect::<Vec<_>>(),
        "pace": tempo.is_ours,
        "speed_max": SPEED_MAX,
        "pc": station.is_some(),
        "modes": station.map(Station::modes),
        "keys": station.and_then(Station::keys),
    })
}

/// What changes slowly: wires, registers, counters, faults.
fn slow(run: &Run, before: &[[Tally; 2]], after: &[[Tally; 2]], span: Duration) -> Value {
    let lanes = run.rig.links().iter().zip(before.iter().zip(after));
    let lanes = lanes.map(|(link, (before, after))| {
        let lane = |direction: Direction| {
            let index = direction as usize;
            let [sender, _] = run.rig.line_configs(link.line(direction));
            let bytes = after[index].bytes - before[index].bytes;
            let busy = sender.bytes_time(bytes).as_secs_f64();
            let load = busy / span.as_secs_f64().max(1e-9);
            json!({"load": (load * 1000.0).round() / 1000.0, "tally": after[index]})
        };
        json!({
            "name": link.name,
            "to-master": lane(Direction::ToMaster),
            "to-device": lane(Direction::ToDevice),
        })
    });
    let mut counters = Vec::new();
    if let Some(program) = run.rig.program() {
        program.counters(&mut |name, value| counters.push((name, value)));
    }
    let progress = run.progress();
    json!({
        "type": "slow",
        "lanes": lanes.collect::<Vec<_>>(),
        "axes": run.instruments().axes(&run.rig),
        "panels": run.instruments().panels(&run.rig),
        "counters": counters,
        "faults": run.faults().collect::<Vec<_>>(),
        "visited": [progress.visits().len(), progress.waypoints()],
        "violations": run.rig.violations(),
        "trace": run.rig.trace_hash(),
    })
}
