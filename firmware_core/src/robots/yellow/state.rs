//! State machine of the robot and its motor drivers.
//!
//! ```text
//!            0.5 s                     +-> MANUAL --------+
//! OFF -> SWITCH ON -> ON --desired-----+-> AUTO REACTIVE -+--> ON -> SWITCH OFF -> OFF
//!                                      +-> AUTO POSITION -+            0.5 s
//! ```
//!
//! The user button switches the reactive drive on, and everything off. Every change from one
//! activity to another passes through ON, where the robot stands.

use core::time::Duration;

use protocols::Instant;
use protocols::telemetry::message::State;

/// Time that the drivers take to switch on or off.
const SWITCHING: Duration = Duration::from_millis(500);
/// Silence of the PC after which manual driving ends.
const MANUAL_HOLDS: Duration = Duration::from_secs(2);
/// Time that an interrupted manoeuvre stands before it ends: two messages, so that the PC sees that
/// the manoeuvre had started.
const INTERRUPTED: Duration = Duration::from_millis(400);

/// Enabled defects of the fielded program; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The watchdog of MANUAL is declared but never checked.
    pub manual_never_ends: bool,
    /// The end of a manoeuvre requests OFF, even if another order came meanwhile.
    pub end_erases_order: bool,
    /// The machine runs each 10 ms instead of each 1 ms.
    pub is_slow: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        manual_never_ends: false,
        end_erases_order: false,
        is_slow: false,
    };
}

/// Mode of the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The motors' drivers are off.
    Off,
    /// The drivers are being switched on.
    SwitchOn,
    /// The drivers are on, and the robot stands.
    On,
    /// Driving with speeds of the PC.
    Manual,
    /// Driving by the IR sensors.
    AutoReactive,
    /// Driving to a pose.
    AutoPosition,
    /// The drivers are being switched off.
    SwitchOff,
}

impl Mode {
    /// State as the PC sees it: the PC does not know the drivers.
    pub const fn told(self) -> State {
        match self {
            Self::Off | Self::SwitchOn | Self::On | Self::SwitchOff => State::Off,
            Self::Manual => State::Manual,
            Self::AutoReactive => State::AutoReactive,
            Self::AutoPosition => State::AutoPosition,
        }
    }

    /// Name in messages for operators.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::SwitchOn => "switch on",
            Self::On => "on",
            Self::Manual => "manual",
            Self::AutoReactive => "reactive",
            Self::AutoPosition => "position",
            Self::SwitchOff => "switch off",
        }
    }

    const fn of(state: State) -> Option<Self> {
        match state {
            State::Off => None,
            State::Manual => Some(Self::Manual),
            State::AutoReactive => Some(Self::AutoReactive),
            State::AutoPosition => Some(Self::AutoPosition),
        }
    }
}

/// Requested mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Desired {
    Off,
    /// Stand, with the drivers on.
    On,
    Active(Mode),
}

/// The state machine.
#[derive(Clone, Debug)]
pub(super) struct Machine {
    defects: Defects,
    mode: Mode,
    since: Instant,
    desired: Desired,
    button: bool,
    /// Time of the PC's last message.
    heard_at: Instant,
    /// A manoeuvre has ended, and the machine has not reacted yet.
    has_arrived: bool,
    /// Time at which an interrupted manoeuvre ends.
    ends_at: Option<Instant>,
    pub(super) time_outs: u32,
    pub(super) arrivals: u32,
    pub(super) interruptions: u32,
}

impl Machine {
    pub(super) const fn new(defects: Defects) -> Self {
        Self {
            defects,
            mode: Mode::Off,
            since: Instant::ZERO,
            desired: Desired::Off,
            button: false,
            heard_at: Instant::ZERO,
            has_arrived: false,
            ends_at: None,
            time_outs: 0,
            arrivals: 0,
            interruptions: 0,
        }
    }

    pub(super) const fn mode(&self) -> Mode {
        self.mode
    }

    /// Time between two steps.
    pub(super) const fn period(&self) -> Duration {
        match self.defects.is_slow {
            true => Duration::from_millis(10),
            false => Duration::from_millis(1),
        }
    }

    /// Whether the motors' drivers are on.
    pub(super) const fn drivers_are_on(&self) -> bool {
        !matches!(self.mode, Mode::Off)
    }

    /// Notes a message of the PC.
    pub(super) const fn heard(&mut self, now: Instant) {
        self.heard_at = now;
    }

    /// Takes the state that the PC requests.
    pub(super) const fn order(&mut self, state: State) {
        self.desired = match Mode::of(state) {
            Some(mode) => Desired::Active(mode),
            None => Desired::Off,
        };
        if !self.defects.end_erases_order {
            self.has_arrived = false;
        }
        self.ends_at = None;
    }

    /// Notes the end of the manoeuvre: the next step handles it.
    pub(super) const fn arrived(&mut self) {
        if !self.has_arrived {
            self.arrivals = self.arrivals.saturating_add(1);
        }
        self.has_arrived = true;
    }

    /// Notes a loss of odometry: a manoeuvre that depends on it ends at the current pose.
    pub(super) fn interrupt(&mut self, now: Instant) {
        if self.mode == Mode::AutoPosition && !self.has_arrived && self.ends_at.is_none() {
            self.interruptions = self.interruptions.saturating_add(1);
            self.ends_at = Some(now + INTERRUPTED);
        }
    }

    /// Whether the manoeuvre is interrupted and waits for its end.
    pub(super) const fn is_interrupted(&self) -> bool {
        self.ends_at.is_some()
    }

    /// Takes the button's state; only a press counts.
    pub(super) const fn button(&mut self, is_down: bool) {
        if is_down && !self.button {
            self.desired = match self.mode {
                Mode::Off => Desired::Active(Mode::AutoReactive),
                _ => Desired::Off,
            };
        }
        self.button = is_down;
    }

    /// Runs one step; returns true if the mode has changed.
    pub(super) fn step(&mut self, now: Instant) -> bool {
        let is_over = self.ends_at.is_some_and(|at| now >= at);
        if core::mem::take(&mut self.has_arrived) || is_over {
            self.desired = Desired::Off;
        }
        let is_alone = now - self.heard_at >= MANUAL_HOLDS && !self.defects.manual_never_ends;
        if self.mode == Mode::Manual && is_alone {
            self.time_outs = self.time_outs.saturating_add(1);
            self.desired = Desired::On;
        }
        let next = self.next(now);
        let changes = next != self.mode;
        if changes {
            (self.mode, self.since) = (next, now);
            self.ends_at = None;
        }
        changes
    }

    fn next(&self, now: Instant) -> Mode {
        let is_switched = now - self.since >= SWITCHING;
        match (self.mode, self.desired) {
            (Mode::Off, Desired::On | Desired::Active(_)) => Mode::SwitchOn,
            (Mode::SwitchOn, _) if is_switched => Mode::On,
            (Mode::On, Desired::Active(mode)) => mode,
            (Mode::On, Desired::Off) => Mode::SwitchOff,
            (Mode::SwitchOff, _) if is_switched => Mode::Off,
            (Mode::Manual | Mode::AutoReactive | Mode::AutoPosition, desired)
                if desired != Desired::Active(self.mode) =>
            {
                Mode::On
            }
            (mode, _) => mode,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    /// A machine that got the order at 0, in its state at 600 ms.
    fn told(state: State, defects: Defects) -> Machine {
        let mut machine = Machine::new(defects);
        machine.heard(at(0));
        machine.order(state);
        [0, 499, 500, 501, 600]
            .into_iter()
            .for_each(|millis| _ = machine.step(at(millis)));
        machine
    }

    /// The drivers take half a second to switch on, and to switch off; between two activities the
    /// robot stands.
    #[test]
    fn drivers_take_half_a_second() {
        let mut machine = Machine::new(Defects::NONE);
        machine.order(State::AutoReactive);
        assert!(machine.step(at(10)) && machine.mode() == Mode::SwitchOn);
        assert!(!machine.step(at(509)) && machine.drivers_are_on());
        assert!(machine.step(at(510)) && machine.mode() == Mode::On);
        assert!(machine.step(at(511)) && machine.mode() == Mode::AutoReactive);
        assert!(!machine.step(at(9_000)));
        machine.order(State::AutoPosition);
        assert!(machine.step(at(9_001)) && machine.mode() == Mode::On);
        assert!(machine.step(at(9_002)) && machine.mode() == Mode::AutoPosition);
        machine.order(State::Off);
        assert!(machine.step(at(9_010)) && machine.step(at(9_011)));
        assert_eq!(
            (machine.mode(), machine.step(at(9_510))),
            (Mode::SwitchOff, false)
        );
        assert!(machine.step(at(9_511)) && !machine.drivers_are_on());
    }

    /// Two seconds without a message of the PC end a manual drive, and no other one; the fielded
    /// watchdog is never checked.
    #[test]
    fn a_drive_by_hand_ends_after_two_seconds_of_silence() {
        let after = |state, defects, millis| {
            let mut machine = told(state, defects);
            machine.heard(at(700));
            machine.step(at(millis));
            (machine.mode(), machine.time_outs)
        };
        let sound = Defects::NONE;
        assert_eq!(after(State::Manual, sound, 2_699), (Mode::Manual, 0));
        assert_eq!(after(State::Manual, sound, 2_700), (Mode::On, 1));
        assert_eq!(
            after(State::AutoReactive, sound, 9_000),
            (Mode::AutoReactive, 0)
        );
        let fielded = Defects {
            manual_never_ends: true,
            ..sound
        };
        assert_eq!(after(State::Manual, fielded, 9_000), (Mode::Manual, 0));
    }

    /// An interrupted manoeuvre stands for 400 ms; another order continues at once. Modes without a
    /// pose are not interrupted.
    #[test]
    fn an_interrupted_manoeuvre_stands_before_it_ends() {
        let mut machine = told(State::AutoPosition, Defects::NONE);
        machine.interrupt(at(1_000));
        machine.interrupt(at(1_200));
        assert!(machine.is_interrupted() && machine.interruptions == 1);
        assert!(!machine.step(at(1_399)) && machine.mode() == Mode::AutoPosition);
        assert!(machine.step(at(1_400)) && machine.mode() == Mode::On);
        assert!(!machine.is_interrupted());
        let mut machine = told(State::AutoPosition, Defects::NONE);
        machine.interrupt(at(1_000));
        machine.order(State::AutoPosition);
        assert!(!machine.is_interrupted() && !machine.step(at(2_000)));
        let mut machine = told(State::AutoReactive, Defects::NONE);
        machine.interrupt(at(1_000));
        assert_eq!(
            (machine.is_interrupted(), machine.interruptions),
            (false, 0)
        );
    }

    /// An end is counted once, and requests OFF; an order that came meanwhile is kept, except by
    /// the fielded program.
    #[test]
    fn the_end_of_a_manoeuvre_erases_no_order() {
        let after = |end_erases_order, order: Option<State>| {
            let defects = Defects {
                end_erases_order,
                ..Defects::NONE
            };
            let mut machine = told(State::AutoPosition, defects);
            machine.arrived();
            machine.arrived();
            if let Some(order) = order {
                machine.order(order);
            }
            (700..720).for_each(|millis| _ = machine.step(at(millis)));
            (machine.mode(), machine.arrivals)
        };
        assert_eq!(after(false, None), (Mode::SwitchOff, 1));
        let again = Some(State::AutoPosition);
        assert_eq!(
            [after(false, again), after(true, again)],
            [(Mode::AutoPosition, 1), (Mode::SwitchOff, 1)]
        );
    }

    /// A press of the button counts: it switches on if all is off, and off in any active mode.
    #[test]
    fn the_button_switches_on_and_off() {
        let mut machine = Machine::new(Defects::NONE);
        machine.button(true);
        machine.button(true);
        [0, 500, 501]
            .into_iter()
            .for_each(|millis| _ = machine.step(at(millis)));
        assert_eq!(
            (machine.mode(), machine.mode().told()),
            (Mode::AutoReactive, State::AutoReactive)
        );
        machine.button(false);
        assert!(!machine.step(at(600)));
        machine.button(true);
        assert!(machine.step(at(601)) && machine.mode() == Mode::On);
        assert_eq!(machine.mode().told(), State::Off);
        assert_eq!(machine.period(), Duration::from_millis(1));
    }
}
