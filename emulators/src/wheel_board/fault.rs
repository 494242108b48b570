//! What can go wrong with a board.

/// Names of all faults.
///
/// | name | what happens | figure |
/// |---|---|---|
/// | `off` | no supply: no samples, bridges off; afterwards as after `restart` | |
/// | `restart` | the chip starts again: counters 0, bridges off until outputs come; once | |
/// | `stuck` | an encoder counts nothing | 0 left, 1 right; both without |
/// | `wrong` | counts are so many times what they should be | factor, 1.1 |
/// | `slow` | the motors are weaker | part of their speed, 0.5 |
/// | `garbage` | the ADC gives any value | |
/// | `blind` | a range sensor sees nothing | its number; all without |
pub(super) const NAMES: [&str; 7] = [
    "off", "restart", "stuck", "wrong", "slow", "garbage", "blind",
];

const USUAL_WRONG: f64 = 1.1;
const USUAL_SLOW: f64 = 0.5;

/// What is wrong at the moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Faults {
    /// Of the left and right encoder.
    pub(super) stuck: [bool; 2],
    /// Counts for one edge.
    pub(super) count_factor: f64,
    /// Part of the motors' speed that is left.
    pub(super) speed: f64,
    /// Whether the ADC gives anything.
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
