//! Faults of the base, besides the defects of its firmware.

use protocols::Instant;

use super::{Announce, AvrBase, StartCause};
use crate::world::Wheel;

/// Names of the faults. The last one needs a base that announces its stop button: a person holds
/// the button.
const NAMES: [&str; 7] = [
    "off",
    "restart",
    "stuck",
    "wrong",
    "battery-low",
    "wheel-held",
    "stop-button",
];

/// Default number of counts for each true one: the two wires of each encoder are exchanged, so that
/// it counts backwards.
const WRONG: f64 = -1.0;

/// Encoders as the firmware sees them.
#[derive(Clone, Debug)]
pub(super) struct Encoders {
    /// No count comes.
    stuck: bool,
    /// Counts seen for each true one; 1 is sound.
    factor: f64,
    /// True counts at the last look, and the counts that the firmware saw.
    last: [Option<(i64, f64)>; 2],
}

impl Default for Encoders {
    fn default() -> Self {
        Self {
            stuck: false,
            factor: 1.0,
            last: [None; 2],
        }
    }
}

impl Encoders {
    /// Count of `wheel` that the firmware sees for the true count `edges`.
    pub(super) fn count(&mut self, wheel: Wheel, edges: i64) -> i64 {
        let last = &mut self.last[wheel as usize];
        let (before, seen) = last.unwrap_or((edges, edges as f64));
        // Without a fault the result is exact: counts are whole and far below 2^53.
        let factor = if self.stuck { 0.0 } else { self.factor };
        let seen = seen + (edges - before) as f64 * factor;
        *last = Some((edges, seen));
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a count of edges times a bounded factor"
        )]
        let seen = seen.floor() as i64;
        seen
    }
}

impl AvrBase {
    /// Faults that this base can have.
    pub(super) fn faults(&self) -> &'static [&'static str] {
        match self.config.announce {
            Announce::Nothing => &NAMES[..NAMES.len() - 1],
            Announce::StopButton => &NAMES,
        }
    }

    pub(super) fn change_fault(
        &mut self,
        now: Instant,
        fault: &str,
        figure: Option<f64>,
        begins: bool,
    ) {
        match (fault, begins) {
            ("off", true) => {
                self.forget(now, StartCause::PowerOn);
                self.bus.clear();
                self.debug.clear();
                self.journal.note(now, "off", "no supply".into());
                self.start.crashed_until = Some(Instant::from_nanos(u64::MAX));
            }
            ("off", false) | ("restart", true) => self.reset(now, StartCause::PowerOn),
            ("stuck", _) => self.encoders.stuck = begins,
            ("wrong", true) => self.encoders.factor = figure.unwrap_or(WRONG),
            ("wrong", false) => self.encoders.factor = 1.0,
            ("battery-low", _) => self.battery.is_low = begins,
            ("wheel-held", _) => self.motors.held = held(figure).map(|is_held| is_held && begins),
            ("stop-button", true) => self.press_stop(now),
            ("stop-button", false) => self.release_stop(now),
            _ => {}
        }
    }
}

/// The wheels, left and right, that the fault `wheel-held` of this figure holds: debris is wedged
/// between wheel and frame, so the wheel stands still whatever its motor does. 0 is the left one, 1
/// the right one; without a figure both are held.
fn held(figure: Option<f64>) -> [bool; 2] {
    [0.0, 1.0].map(|wheel| figure.is_none_or(|figure| figure == wheel))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_names_the_wheel_that_is_held() {
        let figures = [None, Some(0.0), Some(1.0), Some(2.0)];
        let expected = [[true, true], [true, false], [false, true], [false, false]];
        assert_eq!(figures.map(held), expected);
    }

    #[test]
    fn counts_stand_still_while_stuck_and_go_on_from_there() {
        let mut encoders = Encoders::default();
        let count = |encoders: &mut Encoders, edges| encoders.count(Wheel::Left, edges);
        assert_eq!(count(&mut encoders, 100), 100);
        encoders.stuck = true;
        assert_eq!(count(&mut encoders, 150), 100);
        encoders.stuck = false;
        assert_eq!(count(&mut encoders, 160), 110);
        encoders.factor = -1.0;
        assert_eq!(count(&mut encoders, 170), 100);
    }

    /// Only a base that announces its stop button has one that a person can hold.
    #[test]
    fn a_base_without_a_stop_button_knows_no_fault_of_it() {
        let faults = |announce| {
            let config = crate::avr_base::AvrBaseConfig {
                announce,
                ..Default::default()
            };
            AvrBase::new(config, 1).faults()
        };
        let usual = [
            "off",
            "restart",
            "stuck",
            "wrong",
            "battery-low",
            "wheel-held",
        ];
        assert_eq!(faults(Announce::Nothing), usual);
        let with_button = faults(Announce::StopButton);
        assert_eq!(with_button[..6], usual);
        assert_eq!(with_button[6..], ["stop-button"]);
    }

    /// A wrong encoder counts half as much again, or backwards if the fault has no figure. After
    /// the fault it counts correctly.
    #[test]
    fn wrong_encoders_are_sound_again_when_the_fault_ends() {
        let mut base = AvrBase::new(super::super::AvrBaseConfig::default(), 7);
        let mut factor = |figure, begins| {
            base.change_fault(Instant::ZERO, "wrong", figure, begins);
            base.encoders.factor
        };
        assert_eq!([factor(Some(1.5), true), factor(None, false)], [1.5, 1.0]);
        assert_eq!([factor(None, true), factor(Some(1.5), false)], [-1.0, 1.0]);
        let mut flags = |fault, begins| {
            base.change_fault(Instant::ZERO, fault, None, begins);
            (base.encoders.stuck, base.battery.is_low)
        };
        assert_eq!(
            [flags("stuck", true), flags("stuck", false)],
            [(true, false), (false, false)]
        );
        assert_eq!(flags("battery-low", true), (false, true));
        assert_eq!(flags("battery-low", false), (false, false));
        assert_eq!(flags("nothing", true), (false, false));
    }

    /// The base starts when its supply returns and when a restart begins, not when the fault ends.
    #[test]
    fn a_base_starts_with_its_supply_and_when_it_is_restarted() {
        let mut base = AvrBase::new(super::super::AvrBaseConfig::default(), 7);
        let mut told = |fault, begins| {
            base.change_fault(Instant::from_secs(1), fault, None, begins);
            let events = crate::Device::take_events(&mut base);
            let rules: Vec<_> = events.iter().map(|event| event.rule).collect();
            (rules, base.start.crashed_until.is_some())
        };
        assert_eq!(told("off", true), (vec!["off"], true));
        assert_eq!(told("off", false), (vec!["started"], false));
        assert_eq!(told("restart", true), (vec!["started"], false));
        assert_eq!(told("restart", false), (vec![], false));
    }

    /// A pressed button holds the motors; a released one holds them for a while only.
    #[test]
    fn a_stop_button_is_let_go_when_its_fault_ends() {
        let config = super::super::AvrBaseConfig {
            announce: Announce::StopButton,
            ..Default::default()
        };
        let mut base = AvrBase::new(config, 7);
        let pressed = |base: &mut AvrBase, ms, begins| {
            base.change_fault(Instant::from_millis(ms), "stop-button", None, begins);
            base.button
        };
        use super::super::ButtonState;
        assert_eq!(pressed(&mut base, 100, true), ButtonState::Pressed);
        let ButtonState::Lingering(after) = pressed(&mut base, 200, false) else {
            panic!("{:?}", base.button);
        };
        assert!(after > Instant::from_millis(200), "{after}");
    }
}
