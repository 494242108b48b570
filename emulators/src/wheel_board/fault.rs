//! Faults of a board.

/// Names of all faults.
///
/// | name | what happens | figure |
/// |---|---|---|
/// | `off` | no supply: no samples, bridges off; afterwards as after `restart` | |
/// | `restart` | the chip starts again: counters 0, bridges off until outputs come; once | |
/// | `stuck` | an encoder counts nothing | 0 left, 1 right; both without |
/// | `wrong` | counts are multiplied by a factor | factor, 1.1 |
/// | `slow` | the motors are weaker | part of their speed, 0.5 |
/// | `garbage` | the ADC gives any value | |
/// | `blind` | a range sensor sees nothing | its number; all without |
pub(super) const NAMES: [&str; 7] = [
    "off", "restart", "stuck", "wrong", "slow", "garbage", "blind",
];

const USUAL_WRONG: f64 = 1.1;
const USUAL_SLOW: f64 = 0.5;

/// Active faults.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Faults {
    /// Whether the left and right encoder are stuck.
    pub(super) stuck: [bool; 2],
    /// Counts for one edge.
    pub(super) count_factor: f64,
    /// Part of the motors' speed that is left.
    pub(super) speed: f64,
    /// Whether the ADC gives random values.
    pub(super) garbage: bool,
    /// Range sensors that see nothing, a bit each.
    pub(super) blind: u64,
}

impl Default for Faults {
    fn default() -> Self {
        Self {
            stuck: [false; 2],
            count_factor: 1.0,
            speed: 1.0,
            garbage: false,
            blind: 0,
        }
    }
}

impl Faults {
    pub(super) fn set(&mut self, fault: &str, figure: Option<f64>, begins: bool) {
        let figure = figure.filter(|figure| figure.is_finite());
        let none = Self::default();
        let factor = |usual: f64| figure.unwrap_or(usual).clamp(-100.0, 100.0);
        match fault {
            "stuck" => {
                for (side, stuck) in [0.0, 1.0].into_iter().zip(&mut self.stuck) {
                    if figure.is_none_or(|figure| figure == side) {
                        *stuck = begins;
                    }
                }
            }
            "wrong" if begins => self.count_factor = factor(USUAL_WRONG),
            "wrong" => self.count_factor = none.count_factor,
            "slow" if begins => self.speed = factor(USUAL_SLOW),
            "slow" => self.speed = none.speed,
            "garbage" => self.garbage = begins,
            "blind" => {
                let bits = match figure {
                    None => u64::MAX,
                    Some(number) if (0.0..64.0).contains(&number) => {
                        #[expect(
                            clippy::cast_possible_truncation,
                            clippy::cast_sign_loss,
                            reason = "below 64"
                        )]
                        let bit = 1 << number as u32;
                        bit
                    }
                    Some(_) => 0,
                };
                self.blind = if begins {
                    self.blind | bits
                } else {
                    self.blind & !bits
                };
            }
            _ => {}
        }
    }

    pub(super) const fn is_blind(&self, sensor: usize) -> bool {
        sensor < 64 && self.blind >> sensor & 1 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(faults: &[(&str, Option<f64>, bool)]) -> Faults {
        let mut all = Faults::default();
        for (fault, figure, begins) in faults {
            all.set(fault, *figure, *begins);
        }
        all
    }

    /// Sensors go blind and see again one by one or together; 64 is no sensor.
    #[test]
    fn sensors_are_blind_by_their_number() {
        let blind = |faults: &[(&str, Option<f64>, bool)]| {
            let faults = with(faults);
            [0, 1, 2, 63].map(|sensor| faults.is_blind(sensor))
        };
        let [on, off] = [true, false];
        assert_eq!(blind(&[("blind", Some(1.0), on)]), [off, on, off, off]);
        let two = [("blind", Some(1.0), on), ("blind", Some(2.0), on)];
        assert_eq!(blind(&two), [off, on, on, off]);
        let one = [two[0], two[1], ("blind", Some(1.0), off)];
        assert_eq!(blind(&one), [off, off, on, off]);
        assert_eq!(
            blind(&[two[0], ("blind", Some(0.0), off)]),
            [off, on, off, off]
        );
        assert_eq!(blind(&[("blind", None, on)]), [on; 4]);
        assert_eq!(
            blind(&[("blind", None, on), ("blind", None, off)]),
            [off; 4]
        );
        assert_eq!(blind(&[("blind", Some(63.0), on)]), [off, off, off, on]);
        assert_eq!(
            blind(&[("blind", Some(64.0), on), ("blind", Some(-1.0), on)]),
            [off; 4]
        );
        assert!(!with(&[("blind", None, on)]).is_blind(64));
    }

    #[test]
    fn figures_of_faults_have_their_usual_values_and_bounds() {
        let wrong = |figure| with(&[("wrong", figure, true)]).count_factor;
        assert_eq!(
            [wrong(None), wrong(Some(2.0)), wrong(Some(f64::NAN))],
            [1.1, 2.0, 1.1]
        );
        assert_eq!([wrong(Some(1e9)), wrong(Some(-1e9))], [100.0, -100.0]);
        let slow = |figure| with(&[("slow", figure, true)]).speed;
        assert_eq!([slow(None), slow(Some(0.2))], [0.5, 0.2]);
        let over = [
            ("wrong", None, true),
            ("slow", None, true),
            ("garbage", None, true),
        ];
        let over = over
            .into_iter()
            .chain(over.map(|(fault, _, _)| (fault, None, false)));
        assert_eq!(with(&over.collect::<Vec<_>>()), Faults::default());
        assert!(with(&[("garbage", None, true)]).garbage);
        let stuck = |figure| with(&[("stuck", figure, true)]).stuck;
        assert_eq!(stuck(None), [true; 2]);
        assert_eq!(
            [stuck(Some(0.0)), stuck(Some(1.0))],
            [[true, false], [false, true]]
        );
        assert_eq!(stuck(Some(2.0)), [false; 2]);
    }
}
