//! A contact encoder of two switches, read by a program that polls it.
//!
//! ```text
//! edges     0   1   2   3   0         four to a cycle of the contacts
//! pin A     0   0   1   1   0
//! pin B     0   1   1   0   0
//! ```
//!
//! A program that looks after each edge counts all edges. After two edges both pins have changed,
//! and the direction is unknown. The usual library counts them as two edges forward from 0 and 2
//! and as two backward from 1 and 3, so on average as none. After three edges it counts one
//! backward. So the encoder is useless at more than one edge a look, even without wear.
//!
//! Source: state table of PJRC's Encoder library, on pins without interrupts.

/// Change of the count at one poll, by the pins before and now, both as `B A`.
const COUNTED: [[i8; 4]; 4] = [[0, -1, 1, 2], [1, 0, -2, -1], [-1, -2, 0, 1], [2, 1, -1, 0]];

/// The contacts as a program sees them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PolledEncoder {
    pins: u8,
    count: i64,
}

impl PolledEncoder {
    /// Takes a look at the contacts, `edges` from their position at first. If `is_open`, contact A
    /// is open and reads high.
    pub fn look(&mut self, edges: i64, is_open: bool) {
        let sound = match edges.rem_euclid(4) {
            0 => 0b00,
            1 => 0b10,
            2 => 0b11,
            _ => 0b01,
        };
        let pins = sound | u8::from(is_open);
        let counted = COUNTED[usize::from(self.pins & 3)][usize::from(pins & 3)];
        self.count += i64::from(counted);
        self.pins = pins;
    }

    /// Counts since the start.
    pub const fn count(&self) -> i64 {
        self.count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Edges per metre with 60 counts a turn of a wheel of 32 mm: 60 / (2 pi 0.032 m).
    const EDGES_PER_M: f64 = 298.415_518;

    /// Counted edges per true edge at `speed`, polled every 10 ms for 20 s.
    fn ratio(speed: f64) -> f64 {
        let mut encoder = PolledEncoder::default();
        #[expect(clippy::cast_possible_truncation, reason = "a few thousand")]
        let edges = |look: u32| (f64::from(look) * 0.010 * speed * EDGES_PER_M).floor() as i64;
        for look in 1..=2_000 {
            encoder.look(edges(look), false);
        }
        encoder.count() as f64 / edges(2_000) as f64
    }

    /// By hand: 0.22 m/s are 0.66 edges a look, all single. 0.45 m/s are 1.343: of 1000 looks 657
    /// see one and 343 two, which cancel: 657 / 1343 = 0.49. 0.9 m/s are 2.69: 31 of 100 see two,
    /// 69 see three and count one backward: -0.69 / 2.69 = -0.26.
    #[test]
    fn ap4_beyond_one_edge_a_look_counts_get_lost_and_then_turn_round() {
        for (speed, expected, within) in [
            (0.10, 1.0, 0.001),
            (0.22, 1.0, 0.001),
            (-0.22, 1.0, 0.001),
            (0.33, 1.0, 0.001),
            (0.45, 0.49, 0.02),
            (0.90, -0.26, 0.02),
        ] {
            let ratio = ratio(speed);
            assert!((ratio - expected).abs() < within, "{speed} m/s: {ratio}");
        }
    }

    /// A contact that never closes: the edges of the other one count forward and backward. By hand,
    /// if both were closed at first, the states are 2, 2, 3, 3, then 2, 2, 3, 3 forever.
    #[test]
    fn a_contact_that_never_closes_counts_nothing() {
        let mut encoder = PolledEncoder::default();
        for (edges, count) in (1..=400).zip([2, 2, 3, 3].into_iter().cycle()) {
            encoder.look(edges, true);
            assert_eq!(encoder.count(), count, "{edges}");
        }
    }
}
