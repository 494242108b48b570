//! The PC as a device at the other end of the telemetry link: the program and its operator.

use core::time::Duration;

use std::collections::VecDeque;

use emulators::world::{Pose, World};
use emulators::{Device, Event, EventKind};
use firmware_core::Master as _;
use firmware_core::map_view::MapView;
use firmware_core::robots::yellow::pc::{PcCommand, PcProgram, Refused, Task, TaskState};
use protocols::{Instant, LineConfig, LineEvent, Port};

use super::script::{MODES, NAVIGATE, PLACE_ACTS, WHEEL_MAX_M_S, Wish};
use crate::robots::instruments::in_metres;
use crate::robots::script::Script;
use crate::robots::station::{DriveKeys, PlaceAct, StationState};
use crate::robots::{Gesture, Station, StationView};
use crate::scenario::{Action, SetPoint, Step};

/// Interval between two checks of a running task.
const LOOK: Duration = Duration::from_millis(50);
/// Maximum number of tries for a target, and for an order of the operator that failed.
const TRIES: u32 = 3;

/// The PC.
#[derive(Clone, Debug)]
pub(super) struct PcStation {
    program: PcProgram,
    script: Script<Wish>,
    connected: bool,
    /// The command that waits until the program can accept it.
    wanted: Option<PcCommand>,
    targets: Vec<[f64; 2]>,
    tour: Option<Tour>,
    /// The last command of the operator, and the number of tries.
    tried: Option<(PcCommand, u32)>,
    order: Option<(&'static str, Vec<SetPoint>)>,
    /// The task whose end has not been reported.
    told: Option<(Task, TaskState)>,
    alike: u64,
    bytes: u64,
    look_at: Option<Instant>,
    events: VecDeque<Event>,
}

/// A tour from target to target.
#[derive(Clone, Copy, Debug)]
struct Tour {
    next: usize,
    tries: u32,
}

impl PcStation {
    pub(super) fn new(program: PcProgram, script: Script<Wish>) -> Self {
        Self {
            program,
            script,
            connected: false,
            wanted: None,
            targets: Vec::new(),
            tour: None,
            tried: None,
            order: None,
            told: None,
            alike: 0,
            bytes: 0,
            look_at: None,
            events: VecDeque::new(),
        }
    }

    pub(super) const fn program(&self) -> &PcProgram {
        &self.program
    }

    /// The task that the program was given last.
    pub(super) fn task_name(&self) -> Option<&'static str> {
        self.program.task().map(name_of)
    }

    fn note(&mut self, at: Instant, rule: &'static str, detail: String) {
        self.events.push_back(Event {
            at,
            kind: EventKind::Note,
            rule,
            detail,
            bytes: Vec::new(),
        });
    }

    fn wish(&mut self, now: Instant, wish: Wish) {
        match wish {
            Wish::Connect => self.connected = true,
            Wish::Disconnect => self.connected = false,
            Wish::Targets(targets) => self.aim(targets),
            Wish::Navigate => {
                self.order = Some((NAVIGATE, Vec::new()));
                self.begin_tour();
            }
            Wish::Do(name, command) => self.begin(command, (name, Vec::new())),
            Wish::Drive(wheels, command) => self.begin(command, ("manual", wheels)),
        }
        self.look_at = Some(now);
    }

    /// Sets other targets for a tour, also after its end. The same targets do not restart the tour;
    /// the required map is built in any case.
    fn aim(&mut self, targets: Vec<[f64; 2]>) {
        let is_new = self.targets != targets;
        self.targets = targets;
        let is_tour = self
            .order
            .as_ref()
            .is_some_and(|(name, _)| *name == NAVIGATE);
        let maps = self.program.task() == Some(Task::Mapping)
            && self.program.task_state() == TaskState::InProgress;
        match self.tour {
            Some(_) if !is_new => {}
            Some(_) if maps => self.tour = Some(Tour { next: 0, tries: 0 }),
            Some(_) => self.begin_tour(),
            None if is_tour => self.begin_tour(),
            None => {}
        }
    }

    fn begin(&mut self, command: PcCommand, order: (&'static str, Vec<SetPoint>)) {
        (self.tour, self.order) = (None, Some(order));
        self.tried = Some((command, 1));
        self.wanted = Some(command);
    }

    fn begin_tour(&mut self) {
        self.tour = Some(Tour { next: 0, tries: 0 });
        self.tried = None;
        self.wanted = self.to_target(0);
        if self.wanted.is_none() {
            self.tour = None;
        }
    }

    fn to_target(&self, index: usize) -> Option<PcCommand> {
        let [x, y] = *self.targets.get(index)?;
        #[expect(clippy::cast_possible_truncation, reason = "metres fit an f32")]
        let [x_m, y_m] = [x as f32, y as f32];
        Some(PcCommand::Navigate {
            x_m,
            y_m,
            heading_rad: None,
        })
    }

    /// Passes on the waiting command; a running task that blocks it is stopped first.
    fn press_on(&mut self, now: Instant) {
        let Some(command) = self.wanted else {
            return;
        };
        let stopping = self.program.task() == Some(Task::Stop)
            && self.program.task_state() == TaskState::InProgress;
        if stopping && !matches!(command, PcCommand::Stop) {
            return;
        }
        match self.program.command(now, command) {
            Ok(()) => {
                self.wanted = None;
                self.told = None;
            }
            Err(Refused::Busy(_)) => {
                if let Err(refused) = self.program.command(now, PcCommand::Stop) {
                    self.refuse(now, refused);
                }
            }
            // A destination requires a map.
            Err(Refused::NoMap) if self.tour.is_some() => {
                self.wanted = Some(PcCommand::MapStart);
            }
            Err(refused) => self.refuse(now, refused),
        }
    }

    fn refuse(&mut self, now: Instant, refused: Refused) {
        (self.wanted, self.tour) = (None, None);
        self.note(now, "command-refused", refused.to_string());
    }

    /// Reports the end of a task, and continues a tour.
    fn follow(&mut self, now: Instant) {
        let alike = self.alike();
        if alike > self.alike {
            self.note(now, "places-alike", format!("{alike} looks so far"));
        }
        self.alike = alike;
        let (Some(task), state) = (self.program.task(), self.program.task_state()) else {
            return;
        };
        if self.told == Some((task, state)) {
            return;
        }
        self.told = Some((task, state));
        let is_done = match state {
            TaskState::Done => true,
            TaskState::Failed(_) => false,
            TaskState::Standby | TaskState::InProgress => return,
        };
        self.note(
            now,
            rule_of(task, is_done),
            self.program.status().to_owned(),
        );
        if self.wanted.is_some() {
            return;
        }
        match (self.tour, self.tried) {
            (Some(tour), _) => self.go_on(task, is_done, tour),
            (None, Some((command, tries))) if !is_done && tries < TRIES => {
                self.tried = Some((command, tries + 1));
                self.wanted = Some(command);
            }
            (None, _) => {}
        }
    }

    /// Starts the next target; after a missed target the robot localises itself before the next
    /// try.
    fn go_on(&mut self, task: Task, is_done: bool, tour: Tour) {
        let (next, tries) = match (task, is_done) {
            (Task::Navigating, true) => (tour.next + 1, 0),
            (Task::Navigating | Task::Mapping, false) if tour.tries + 1 < TRIES => {
                (tour.next, tour.tries + 1)
            }
            (Task::Mapping, true) | (Task::Localising, _) => (tour.next, tour.tries),
            _ => return self.tour = None,
        };
        let target = self.to_target(next);
        self.tour = target.map(|_| Tour { next, tries });
        self.wanted = match task {
            Task::Navigating if !is_done => target.map(|_| PcCommand::Localise),
            Task::Mapping if !is_done => target.map(|_| PcCommand::MapStart),
            _ => target,
        };
    }

    fn alike(&self) -> u64 {
        let mut alike = 0;
        self.program.counters(&mut |name, count| {
            if name == "ambiguous" {
                alike = count;
            }
        });
        alike
    }

    fn bad(&self) -> u64 {
        let mut bad = 0;
        self.program.counters(&mut |name, count| {
            if name.starts_with("bad ") {
                bad += count;
            }
        });
        bad
    }
}

/// The name of a task: that of the mode that starts it.
const fn name_of(task: Task) -> &'static str {
    match task {
        Task::Reactive => "reactive",
        Task::Stop => "stop",
        Task::Manual => "manual",
        Task::Mapping => "map",
        Task::Localising => "localise",
        Task::Navigating => NAVIGATE,
        Task::SettingPose => "set-pose",
    }
}

const fn rule_of(task: Task, is_done: bool) -> &'static str {
    match (task, is_done) {
        (Task::Reactive, true) => "reactive-done",
        (Task::Reactive, false) => "reactive-failed",
        (Task::Stop, true) => "stop-done",
        (Task::Stop, false) => "stop-failed",
        (Task::Manual, true) => "manual-done",
        (Task::Manual, false) => "manual-failed",
        (Task::Mapping, true) => "map-done",
        (Task::Mapping, false) => "map-failed",
        (Task::Localising, true) => "localise-done",
        (Task::Localising, false) => "localise-failed",
        (Task::Navigating, true) => "navigate-done",
        (Task::Navigating, false) => "navigate-failed",
        (Task::SettingPose, true) => "set-pose-done",
        (Task::SettingPose, false) => "set-pose-failed",
    }
}

impl Device for PcStation {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        if self.connected {
            self.bytes += bytes.len() as u64;
            self.program.receive(port, now, bytes);
        }
    }

    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        self.program.line_event(port, now, event);
    }

    fn poll(&mut self, now: Instant, _: &mut World) {
        while let Some(wish) = self.script.take(now) {
            self.wish(now, wish);
        }
        if self.connected {
            self.press_on(now);
        }
        self.program.poll(now);
        self.follow(now);
        let goes_on = self.program.task_state() == TaskState::InProgress;
        let is_busy = self.wanted.is_some() || goes_on;
        self.look_at = is_busy.then_some(now + LOOK);
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        let len = self.program.transmit(port, buf);
        // Bytes that are written to a closed connection are lost.
        if self.connected { len } else { 0 }
    }

    fn poll_at(&self) -> Option<Instant> {
        let times = [self.script.due(), self.look_at, self.program.poll_at()];
        times.into_iter().flatten().min()
    }

    fn line_config(&self, port: Port) -> LineConfig {
        self.program.line_config(port)
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.events.drain(..).collect()
    }
}

impl Station for PcStation {
    fn modes(&self) -> &'static [&'static str] {
        const NAMES: [&str; MODES.len() + 1] = [
            MODES[0].0, MODES[1].0, MODES[2].0, MODES[3].0, MODES[4].0, NAVIGATE,
        ];
        &NAMES
    }

    fn place_acts(&self) -> &'static [PlaceAct] {
        &PLACE_ACTS
    }

    /// 0.3 m/s forward, 1.1 rad/s rotation.
    fn keys(&self) -> Option<DriveKeys> {
        Some(DriveKeys {
            ahead: SetPoint::list([0.3, 0.3]),
            left: SetPoint::list([-0.1, 0.1]),
            limit: SetPoint::list([WHEEL_MAX_M_S; 2]),
        })
    }

    fn view(&self, now: Instant) -> StationView {
        let heard = self.program.telemetry();
        let state = heard.and_then(|(_, told)| told.state);
        let since = heard.map(|(at, _)| (now - at).as_millis());
        StationView {
            connection: if self.connected {
                "connected"
            } else {
                "closed"
            },
            heard_ms: since.map(|ms| u64::try_from(ms).unwrap_or(u64::MAX)),
            state: state.map(|state| StationState {
                mode: state.name(),
                ..StationState::default()
            }),
            pose: self.program.believed_pose().map(wire_pose),
            size_mm: None,
            waypoints: self
                .targets
                .iter()
                .map(|place| place.map(millimetres))
                .collect(),
            confirmed: true,
            rows_missing: None,
            order: self.order.clone(),
            bytes: self.bytes,
            bad: self.bad(),
        }
    }

    fn map(&self) -> Option<MapView<'_>> {
        self.program.global_map()
    }

    fn stated_pose(&self) -> Option<Pose> {
        self.program.believed_pose().map(in_metres)
    }

    fn answer(&self, gesture: Gesture) -> Result<Action, String> {
        gesture.on(&self.targets)
    }

    fn insert_step(&mut self, mission: usize, index: usize, step: &Step) -> Result<(), String> {
        let wish = Wish::of(&step.action)?;
        self.script.insert(mission, index, step, wish);
        Ok(())
    }
}

fn millimetres(metres: f64) -> i16 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the cast stops at the limits of 16 bits"
    )]
    let whole = (metres * 1_000.0).round() as i16;
    whole
}

/// Millimetres and degrees of the map.
fn wire_pose(pose: firmware_core::pose::Pose) -> [i16; 3] {
    let pose = in_metres(pose);
    let degrees = pose.theta.to_degrees() / 1_000.0;
    [pose.x, pose.y, degrees].map(millimetres)
}
