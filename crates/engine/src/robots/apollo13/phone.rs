//! The phone: an app with faders and toggles, and the operator who holds it and watches the car.
//!
//! Addresses are those of the car's layout: `/1/speed`, `/1/direction`, `/1/kill`,
//! `/modes/toggle4`, `/modes/follow_aruco`, and our own `/modes/mapping`. Goals, which are set by
//! mouse on the PC in the seed, are sent as `/goal` with x, y and heading.
//!
//! Packets are lost and not confirmed, so the app repeats the positions of its controls, and a new
//! goal for some seconds. The operator sends the next goal when the car has stopped near the last
//! one. If it stops elsewhere, the operator sends its pose, as with the mouse in the seed
//! (`/pose`), and orders the same goal again.

use core::time::Duration;
use std::collections::VecDeque;

use emulators::world::{Pose, World};
use emulators::{Device, Event, EventKind};
use firmware_core::map_view::MapView;
use protocols::{Instant, LineConfig, Port};
use rosc::{OscMessage, OscPacket, OscType};

use super::script::{MODES, Mode, PLACE_ACTS, Wish};
use crate::robots::script::Script;
use crate::robots::station::{DriveKeys, PlaceAct};
use crate::robots::{Gesture, Station, StationView};
use crate::scenario::{Action, SetPoint, Step};

/// Interval at which the app reports its presence and the positions of its controls.
const PING: Duration = Duration::from_millis(250);
/// Time for which a new goal is repeated.
const GOAL_SAID: Duration = Duration::from_secs(2);
/// Interval between two checks of the car.
const LOOK: Duration = Duration::from_millis(100);
/// Distance from a goal at which the car has arrived, metres: the tolerance of its path follower.
const NEAR_M: f64 = 0.30;
/// Standstill after which the car has stopped.
const RESTED: Duration = Duration::from_millis(1_500);
/// Time after an arrival in which repeated goals are ignored, because the phone may not have seen
/// the arrival.
const JUST_NOW: Duration = Duration::from_secs(5);
/// Standstill after which the operator assumes that the car has given up.
const GAVE_UP: Duration = Duration::from_secs(12);
/// Precision of a click on a map: to 10 cm, to 10 degrees.
const CLICK_M: f32 = 0.1;
const CLICK_RAD: f32 = core::f32::consts::PI / 18.0;
/// Steering value of straight ahead.
const STRAIGHT: i8 = 8;

/// The phone.
#[derive(Clone, Debug)]
pub(super) struct Phone {
    script: Script<Wish>,
    connected: bool,
    mode: Option<Mode>,
    /// Whether the phone orders goals; otherwise the waypoints are positions that the car must
    /// pass.
    has_goals: bool,
    by_hand: [i8; 2],
    goals: Vec<[f64; 2]>,
    /// Heading at a single goal, radians, if given.
    heading: Option<f32>,
    /// Index of the current goal in `goals`.
    goal: usize,
    /// Whether the goal must be sent.
    is_news: bool,
    /// Whether an empty list stopped the car: the next goals start it again.
    waits_for_goals: bool,
    /// The goal sent last, and the time.
    sent: Option<([f32; 3], Instant)>,
    /// Time of the last arrival.
    arrived: Option<Instant>,
    rests_since: Option<Instant>,
    look_at: Option<Instant>,
    ping_at: Option<Instant>,
    out: VecDeque<Vec<u8>>,
    events: VecDeque<Event>,
}

impl Phone {
    /// The wireless network.
    pub(super) const NETWORK: Port = Port(0);
    /// At most 54 Mbit/s.
    pub(super) const LINE: LineConfig = LineConfig::new_8n1(20_000_000);

    pub(super) fn new(script: Script<Wish>, has_goals: bool) -> Self {
        Self {
            script,
            connected: false,
            mode: None,
            has_goals,
            by_hand: [0, STRAIGHT],
            goals: Vec::new(),
            heading: None,
            goal: 0,
            is_news: false,
            waits_for_goals: false,
            sent: None,
            arrived: None,
            rests_since: None,
            look_at: None,
            ping_at: None,
            out: VecDeque::new(),
            events: VecDeque::new(),
        }
    }

    /// The goals, and the index of the current one.
    pub(super) fn goals(&self) -> (&[[f64; 2]], usize) {
        (&self.goals, self.goal)
    }

    /// Whether the goals need not be ordered again.
    fn is_at_them(&self, now: Instant) -> bool {
        let is_new = |at: Instant| now - at <= JUST_NOW;
        self.goal < self.goals.len() || self.arrived.is_some_and(is_new)
    }

    fn say(&mut self, address: &str, values: &[f32]) {
        let packet = OscPacket::Message(OscMessage {
            addr: address.to_owned(),
            args: values.iter().map(|value| OscType::Float(*value)).collect(),
        });
        if let Ok(bytes) = rosc::encoder::encode(&packet)
            && self.connected
        {
            self.out.push_back(bytes);
        }
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
            Wish::Connect => {
                self.connected = true;
                self.ping_at = Some(now);
            }
            Wish::Disconnect => {
                self.connected = false;
                self.ping_at = None;
            }
            // The car is driving to the goals, or has just arrived.
            Wish::Goals(goals) if goals == self.goals && self.is_at_them(now) => {}
            Wish::Goals(goals) if self.has_goals => {
                let has_none = goals.is_empty();
                (self.goals, self.goal, self.heading) = (goals, 0, None);
                self.is_news = self.mode == Some(Mode::Autonomous);
                // The phone has no message that removes a goal, so it stops the car.
                if has_none && self.is_news {
                    self.order(Mode::Stop);
                    self.waits_for_goals = true;
                } else if !has_none && self.waits_for_goals {
                    self.order(Mode::Autonomous);
                }
            }
            Wish::Goals(_) => {}
            Wish::Mode(mode) => self.order(mode),
            // Sent once: later the pose would be different.
            Wish::Pose(pose) => self.say("/pose", &pose),
            Wish::GoTo([x, y, heading]) => {
                (self.goals, self.goal) = (vec![[x, y].map(f64::from)], 0);
                self.heading = Some(heading);
                self.order(Mode::Autonomous);
            }
            Wish::Drive(by_hand) => {
                if self.mode != Some(Mode::Remote) {
                    self.order(Mode::Remote);
                }
                self.by_hand = by_hand;
                self.say_faders();
            }
        }
        self.rests_since = None;
        self.look_at = Some(now);
    }

    fn order(&mut self, mode: Mode) {
        self.waits_for_goals = false;
        self.mode = Some(mode);
        self.by_hand = [0, STRAIGHT];
        if mode != Mode::Stop {
            self.say("/1/speed", &[0.0]);
        }
        self.say_toggles(mode);
        self.sent = None;
        self.is_news = mode == Mode::Autonomous;
    }

    fn say_toggles(&mut self, mode: Mode) {
        let [auto, gates, mapping]: [f32; 3] = match mode {
            Mode::Stop => return self.say("/1/kill", &[1.0]),
            Mode::Remote => [0.0; 3],
            Mode::Autonomous => [1.0, 0.0, 0.0],
            Mode::Gates => [0.0, 1.0, 0.0],
            Mode::Mapping => [0.0, 0.0, 1.0],
        };
        // Never two at once: toggles are switched off first.
        let mut toggles = [
            ("/modes/toggle4", auto),
            ("/modes/follow_aruco", gates),
            ("/modes/mapping", mapping),
        ];
        toggles.sort_by(|one, other| one.1.total_cmp(&other.1));
        for (address, value) in toggles {
            self.say(address, &[value]);
        }
        self.say("/1/kill", &[0.0]);
    }

    fn say_faders(&mut self) {
        let [level, value] = self.by_hand.map(f32::from);
        self.say("/1/direction", &[value]);
        self.say("/1/speed", &[level]);
    }

    /// Sends the positions of all controls.
    fn say_again(&mut self, now: Instant) {
        if let Some(mode) = self.mode {
            self.say_toggles(mode);
        }
        if self.mode == Some(Mode::Remote) {
            self.say_faders();
        }
        if let Some((goal, _)) = self.sent.filter(|(_, at)| now - *at <= GOAL_SAID) {
            self.say("/goal", &goal);
        }
    }

    /// Corrects the car's believed pose: the operator clicks on the position that they see.
    fn say_pose(&mut self, world: &World) {
        let car = world.pose();
        #[expect(clippy::cast_possible_truncation, reason = "metres fit an f32")]
        let [x, y, heading] = [car.x, car.y, car.theta].map(|value| value as f32);
        let clicked = |value: f32, grain: f32| (value / grain).round() * grain;
        let values = [
            clicked(x, CLICK_M),
            clicked(y, CLICK_M),
            clicked(heading, CLICK_RAD),
        ];
        self.say("/pose", &values);
    }

    /// Checks the car: whether it has arrived, or has stopped elsewhere.
    fn watch(&mut self, now: Instant, world: &World) {
        let goal = self.goals.get(self.goal).copied();
        let goal = goal.filter(|_| self.mode == Some(Mode::Autonomous));
        let Some([x, y]) = goal else {
            return self.watch_without_goal(now, world);
        };
        let car = world.pose();
        if core::mem::take(&mut self.is_news) {
            // The heading points away from the previous goal.
            let before = self.goal.checked_sub(1).and_then(|it| self.goals.get(it));
            let [from_x, from_y] = before.copied().unwrap_or([car.x, car.y]);
            let ahead = libm::atan2(y - from_y, x - from_x);
            #[expect(clippy::cast_possible_truncation, reason = "metres fit an f32")]
            let mut values = [x, y, ahead].map(|value| value as f32);
            values[2] = self.heading.unwrap_or(values[2]);
            self.say("/goal", &values);
            self.sent = Some((values, now));
            self.note(now, "goal-sent", format!("{x:.2}, {y:.2} m"));
            self.rests_since = None;
            return;
        }
        if world.is_moving() {
            self.rests_since = None;
            return;
        }
        let rested = now - *self.rests_since.get_or_insert(now);
        let off_m = libm::hypot(x - car.x, y - car.y);
        if off_m <= NEAR_M && rested >= RESTED {
            let detail = format!("{x:.2}, {y:.2} m, {off_m:.2} m off");
            self.note(now, "goal-reached", detail);
            self.goal += 1;
            self.is_news = true;
            self.arrived = Some(now);
        } else if rested >= GAVE_UP {
            self.note(now, "goal-again", format!("stands {off_m:.2} m off"));
            self.say_pose(world);
            self.order(Mode::Autonomous);
        }
    }

    /// Repeats orders to a standing car, because it may have missed them: orders are not confirmed.
    fn watch_without_goal(&mut self, now: Instant, world: &World) {
        if world.is_moving() {
            self.rests_since = None;
            return;
        }
        let rested = now - *self.rests_since.get_or_insert(now);
        if let Some(mode) = self.mode.filter(|_| rested >= GAVE_UP) {
            self.note(now, "mode-again", mode.name().to_owned());
            if mode != Mode::Mapping {
                self.say_pose(world);
            }
            self.order(mode);
            self.rests_since = Some(now);
        }
    }
}

impl Device for Phone {
    /// Ignores bytes: the car sends nothing to the phone.
    fn receive(&mut self, _port: Port, _now: Instant, _bytes: &[u8]) {}

    fn poll(&mut self, now: Instant, world: &mut World) {
        while let Some(wish) = self.script.take(now) {
            self.wish(now, wish);
        }
        if self.ping_at.take_if(|at| *at <= now).is_some() {
            self.ping_at = Some(now + PING);
            self.say("/ping", &[]);
            self.say_again(now);
        }
        if self.look_at.is_some_and(|at| at <= now) {
            let drives_itself = [Mode::Autonomous, Mode::Gates, Mode::Mapping];
            let is_driving =
                self.connected && self.mode.is_some_and(|mode| drives_itself.contains(&mode));
            if is_driving {
                self.watch(now, world);
            }
            self.look_at = is_driving.then_some(now + LOOK);
        }
    }

    /// Sends one packet at a time.
    fn transmit(&mut self, _port: Port, buf: &mut [u8]) -> usize {
        let Some(packet) = self.out.pop_front() else {
            return 0;
        };
        let len = packet.len().min(buf.len());
        buf[..len].copy_from_slice(&packet[..len]);
        len
    }

    fn poll_at(&self) -> Option<Instant> {
        let times = [self.script.due(), self.look_at, self.ping_at];
        times.into_iter().flatten().min()
    }

    fn line_config(&self, _port: Port) -> LineConfig {
        Self::LINE
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.events.drain(..).collect()
    }
}

impl Station for Phone {
    fn modes(&self) -> &'static [&'static str] {
        const NAMES: [&str; 5] = [MODES[0].0, MODES[1].0, MODES[2].0, MODES[3].0, MODES[4].0];
        &NAMES
    }

    fn place_acts(&self) -> &'static [PlaceAct] {
        &PLACE_ACTS
    }

    /// Level 2 is 0.22 m/s; half of the steering range to each side. Straight ahead is 8, not 0.
    fn keys(&self) -> Option<DriveKeys> {
        Some(DriveKeys {
            ahead: SetPoint::list([2, 8]),
            left: SetPoint::list([0, -30]),
            limit: SetPoint::list([10, 50]),
        })
    }

    fn view(&self, _now: Instant) -> StationView {
        let millimetres = |metres: f64| {
            #[expect(
                clippy::cast_possible_truncation,
                reason = "the cast stops at the limits of 16 bits"
            )]
            let whole = (metres * 1_000.0).round() as i16;
            whole
        };
        let by_hand = match self.mode {
            Some(Mode::Remote) => SetPoint::list(self.by_hand),
            _ => Vec::new(),
        };
        StationView {
            connection: match self.connected {
                true => "connected",
                false => "closed",
            },
            waypoints: self.goals.iter().map(|at| at.map(millimetres)).collect(),
            confirmed: true,
            order: self.mode.map(|mode| (mode.name(), by_hand)),
            ..StationView::default()
        }
    }

    fn map(&self) -> Option<MapView<'_>> {
        None
    }

    fn stated_pose(&self) -> Option<Pose> {
        None
    }

    fn answer(&self, gesture: Gesture) -> Result<Action, String> {
        gesture.on(&self.goals)
    }

    fn insert_step(&mut self, mission: usize, index: usize, step: &Step) -> Result<(), String> {
        let wish = Wish::of(&step.action)?;
        self.script.insert(mission, index, step, wish);
        Ok(())
    }
}
