//! Choice of the driver: the phone, the planner, or none.
//!
//! Facts: seed 003 and its published code: a loop of 20 Hz, toggles for autonomous driving and for
//! gates, and a kill switch that overrides everything. With both toggles on, the fielded loop has
//! no branch and the last command persists; here the car stops. The car also stops if the phone is
//! silent for a second, which is our own addition.

use core::time::Duration;

use protocols::Instant;

use super::steering::STRAIGHT;

/// Period of the fielded loop.
pub const PERIOD: Duration = Duration::from_millis(50);
/// Maximum silence of the phone while it drives; then the car stops.
pub const SILENCE_MAX: Duration = Duration::from_secs(1);

/// Defects of the fielded arbiter; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// With both toggles on, the last command persists.
    pub both_persist: bool,
    /// The car continues driving without a phone.
    pub never_silent: bool,
}

/// A command to the car's board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drive {
    /// Motor level, -10 to 10.
    pub level: i8,
    /// Steering value, -50 to 50.
    pub steering: i8,
}

impl Drive {
    /// Motor off, wheels straight.
    pub const STOP: Self = Self {
        level: 0,
        steering: STRAIGHT,
    };
}

/// Driver of the car.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The phone drives.
    Remote,
    /// The planner drives to goals.
    Autonomous,
    /// The planner drives through gates.
    Gates,
    /// The planner drives to unseen areas.
    Mapping,
    /// More than one toggle is on.
    Contradiction,
    /// The kill switch is on.
    Killed,
}

/// Toggles and values of the phone.
#[derive(Clone, Debug)]
pub struct Arbiter {
    defects: Defects,
    remote: Drive,
    heard: Option<Instant>,
    is_killed: bool,
    is_autonomous: bool,
    is_gates: bool,
    is_mapping: bool,
    last: Drive,
}

impl Arbiter {
    /// An arbiter before the first message.
    pub const fn new(defects: Defects) -> Self {
        Self {
            defects,
            remote: Drive::STOP,
            heard: None,
            is_killed: false,
            is_autonomous: false,
            is_gates: false,
            is_mapping: false,
            last: Drive::STOP,
        }
    }

    /// Takes a change of a phone's control: its address and value. Returns whether the address is
    /// known.
    pub fn hear(&mut self, now: Instant, address: &str, value: f32) -> bool {
        let is_on = value != 0.0;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "saturates; cut as the fielded code does"
        )]
        let whole = value as i8;
        match address {
            "/1/speed" => self.remote.level = whole.clamp(-10, 10),
            "/1/direction" => self.remote.steering = whole.clamp(-50, 50),
            "/1/kill" => self.is_killed = is_on,
            // The layout and the receiving code of the seed use different addresses.
            "/modes/toggle4" | "/modes/autonomous" => self.is_autonomous = is_on,
            "/modes/follow_aruco" => self.is_gates = is_on,
            // Our addition: in the seed an operator starts a mapping drive on the PC.
            "/modes/mapping" => self.is_mapping = is_on,
            "/1" | "/modes" | "/about" | "/accxyz" | "/ping" => {}
            _ => return false,
        }
        self.heard = Some(now);
        true
    }

    /// The current mode.
    pub const fn mode(&self) -> Mode {
        if self.is_killed {
            return Mode::Killed;
        }
        match (self.is_autonomous, self.is_gates, self.is_mapping) {
            (true, false, false) => Mode::Autonomous,
            (false, true, false) => Mode::Gates,
            (false, false, true) => Mode::Mapping,
            (false, false, false) => Mode::Remote,
            _ => Mode::Contradiction,
        }
    }

    /// The command to send at `now`; `planned` is the planner's wish, if any.
    pub fn decide(&mut self, now: Instant, planned: Option<Drive>) -> Drive {
        let is_silent = self.heard.is_none_or(|heard| now - heard > SILENCE_MAX);
        let drive = match self.mode() {
            Mode::Killed => Drive {
                level: 0,
                steering: 0,
            },
            Mode::Contradiction if self.defects.both_persist => self.last,
            Mode::Contradiction => Drive::STOP,
            Mode::Autonomous | Mode::Gates | Mode::Mapping => planned.unwrap_or(Drive::STOP),
            Mode::Remote if is_silent && !self.defects.never_silent => Drive::STOP,
            Mode::Remote => self.remote,
        };
        self.last = drive;
        drive
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::ZERO + Duration::from_millis(ms)
    }

    const PLANNED: Drive = Drive {
        level: 2,
        steering: -20,
    };

    #[test]
    fn ap9_each_mode_has_its_driver() {
        let mut arbiter = Arbiter::new(Defects::default());
        assert_eq!(arbiter.decide(at(0), Some(PLANNED)), Drive::STOP);
        assert!(
            arbiter.hear(at(10), "/1/speed", 3.9) && arbiter.hear(at(10), "/1/direction", -200.0)
        );
        let remote = Drive {
            level: 3,
            steering: -50,
        };
        assert_eq!(
            (arbiter.mode(), arbiter.decide(at(20), Some(PLANNED))),
            (Mode::Remote, remote)
        );
        arbiter.hear(at(30), "/modes/toggle4", 1.0);
        assert_eq!(
            (arbiter.mode(), arbiter.decide(at(40), Some(PLANNED))),
            (Mode::Autonomous, PLANNED)
        );
        assert_eq!(arbiter.decide(at(40), None), Drive::STOP);
        arbiter.hear(at(50), "/modes/autonomous", 0.0);
        arbiter.hear(at(50), "/modes/follow_aruco", 1.0);
        assert_eq!(
            (arbiter.mode(), arbiter.decide(at(60), Some(PLANNED))),
            (Mode::Gates, PLANNED)
        );
        arbiter.hear(at(50), "/modes/follow_aruco", 0.0);
        arbiter.hear(at(50), "/modes/mapping", 1.0);
        assert_eq!(
            (arbiter.mode(), arbiter.decide(at(60), Some(PLANNED))),
            (Mode::Mapping, PLANNED)
        );
        arbiter.hear(at(60), "/modes/follow_aruco", 1.0);
        assert_eq!(arbiter.mode(), Mode::Contradiction);
        assert!(!arbiter.hear(at(60), "/1/horn", 1.0));
    }

    /// The kill switch overrides everything, and the planner continues without the phone.
    #[test]
    fn ap9_the_kill_switch_stops_in_every_mode() {
        let mut arbiter = Arbiter::new(Defects::default());
        arbiter.hear(at(0), "/modes/autonomous", 1.0);
        assert_eq!(arbiter.decide(at(5_000), Some(PLANNED)), PLANNED);
        arbiter.hear(at(5_000), "/1/kill", 1.0);
        let killed = Drive {
            level: 0,
            steering: 0,
        };
        assert_eq!(
            (arbiter.mode(), arbiter.decide(at(5_050), Some(PLANNED))),
            (Mode::Killed, killed)
        );
    }

    #[test]
    fn ap9_both_modes_at_once_stop_the_car_and_persist_when_fielded() {
        for (defects, expected) in [
            (Defects::default(), Drive::STOP),
            (
                Defects {
                    both_persist: true,
                    ..Defects::default()
                },
                PLANNED,
            ),
        ] {
            let mut arbiter = Arbiter::new(defects);
            arbiter.hear(at(0), "/modes/autonomous", 1.0);
            arbiter.decide(at(10), Some(PLANNED));
            arbiter.hear(at(20), "/modes/follow_aruco", 1.0);
            assert_eq!(arbiter.mode(), Mode::Contradiction);
            assert_eq!(arbiter.decide(at(30), None), expected);
        }
    }

    #[test]
    fn ap9_a_phone_that_is_silent_for_a_second_stops_the_car() {
        for (never_silent, level) in [(false, 0), (true, 4)] {
            let mut arbiter = Arbiter::new(Defects {
                never_silent,
                ..Defects::default()
            });
            arbiter.hear(at(100), "/1/speed", 4.0);
            assert_eq!(arbiter.decide(at(1_100), None).level, 4);
            assert_eq!(arbiter.decide(at(1_101), None).level, level);
        }
    }
}
