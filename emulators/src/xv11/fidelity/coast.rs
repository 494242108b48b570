//! The coast-down: times reconstructed from the speed words, as no capture has time stamps.

use protocols::xv11::Frame;

use crate::xv11::encoder::TEETH;

/// Speeds between which the coast-down is timed: from the last one that is surely steady, to where
/// the encoder is lost, to the last that is surely shown.
const FROM_RPM: f64 = 290.0;
const VIA_RPM: f64 = 185.0;
const TO_RPM: f64 = 75.0;

/// Speeds in the order in which they were shown, one per tooth.
#[derive(Debug, Default)]
pub(super) struct Teeth {
    /// 64ths of a turn per minute.
    words: Vec<u16>,
    /// Packets that showed the last of them.
    packets: u64,
}

impl Teeth {
    pub(super) fn frame(&mut self, frame: &Frame) {
        let word = frame.speed().0;
        if self.words.last() == Some(&word) {
            self.packets += 1;
        } else {
            self.words.push(word);
            self.packets = 1;
        }
    }

    /// Packets that show the speed of the last tooth, if the head stopped after it.
    pub(super) fn stalled_packets(&self) -> u64 {
        let last = self.words.last().map_or(f64::MAX, |&word| rpm(word));
        if last < VIA_RPM { self.packets } else { 0 }
    }

    /// Seconds of both halves of the last coast-down, interpolated between the middles of teeth.
    pub(super) fn coast_s(&self) -> Option<[f64; 2]> {
        let [from, via, to] = [FROM_RPM, VIA_RPM, TO_RPM].map(|rpm| self.falls_below(rpm));
        let (from, via, to) = (from?, via?, to?);
        (from < via && via < to).then_some([via - from, to - via])
    }

    /// Time at which the speed last fell below `limit` rpm, seconds since the first tooth.
    fn falls_below(&self, limit: f64) -> Option<f64> {
        let mut end_s = 0.0;
        let mut before: Option<(f64, f64)> = None;
        let mut fell = None;
        for &word in &self.words {
            let tooth_s = tooth_s(word);
            let speed = rpm_of(tooth_s);
            let middle_s = end_s + tooth_s / 2.0;
            if let Some((at_s, faster)) = before.filter(|&(_, faster)| faster >= limit)
                && speed < limit
            {
                let part = (faster - limit) / (faster - speed);
                fell = Some(at_s + part * (middle_s - at_s));
            }
            before = Some((middle_s, speed));
            end_s += tooth_s;
        }
        fell
    }
}

/// Time of a tooth. A doubled tooth took twice as long as its speed suggests.
fn tooth_s(word: u16) -> f64 {
    let shown_s = rpm_of(rpm(word).max(1.0));
    if is_doubled(word) {
        2.0 * shown_s
    } else {
        shown_s
    }
}

/// Time of a tooth from its speed, and its speed from its time.
fn rpm_of(tooth_s: f64) -> f64 {
    60.0 / f64::from(TEETH) / tooth_s
}

/// Whether the speed is too high for the sensor: one tooth was counted as two.
fn is_doubled(word: u16) -> bool {
    rpm(word) > 330.0
}

fn rpm(word: u16) -> f64 {
    f64::from(word) / 64.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The head turns at 330 rpm at most, 4 / 330 s a tooth. A tooth shown faster by at least a
    /// 64th of a rpm took twice its time.
    #[test]
    fn a_tooth_that_is_faster_than_the_line_allows_is_two() {
        assert!((tooth_s(330 * 64) - 4.0 / 330.0).abs() < 1e-12);
        assert!((tooth_s(330 * 64 + 1) - 8.0 / (330.0 + 1.0 / 64.0)).abs() < 1e-12);
    }

    /// Teeth of 300, 240 and 120 rpm take 4 / 300, 4 / 240 and 4 / 120 s. Their middles lie at
    /// 6.667, 21.667 and 46.667 ms. The speed falls below 200 rpm a third of the interval from the
    /// second to the third; below 270 half of that from the first to the second.
    #[test]
    fn a_speed_is_passed_between_the_middles_of_two_teeth() {
        let mut teeth = Teeth {
            words: [300, 240, 120].map(|rpm: u16| rpm * 64).to_vec(),
            packets: 1,
        };
        let is = |teeth: &Teeth, limit: f64, ms: f64| {
            let found = teeth.falls_below(limit).expect("it does");
            assert!((found * 1e3 - ms).abs() < 1e-3, "{limit}: {found}");
        };
        is(&teeth, 200.0, 21.667 + 25.0 / 3.0);
        is(&teeth, 270.0, 6.667 + 15.0 / 2.0);
        is(&teeth, 240.001, 21.666_5);
        assert_eq!(
            [teeth.falls_below(100.0), teeth.falls_below(310.0)],
            [None; 2]
        );
        // The speed rises and falls again: the last time counts.
        teeth.words.extend([240, 120].map(|rpm: u16| rpm * 64));
        // The last tooth begins at 80 ms, and its middle is 4 / 240 s later: the middles of the
        // last two teeth lie at 71.667 and 96.667 ms.
        is(&teeth, 200.0, 71.667 + 25.0 / 3.0);
    }

    /// Teeth of 300, 240, 120 and 60 rpm: their middles lie at 6.667, 21.667, 46.667 and 96.667 ms.
    /// 290 rpm are passed a sixth of the interval behind the first, 185 at 33.125 and 75 at 84.167
    /// ms.
    #[test]
    fn a_coast_has_two_halves() {
        let coast = |rpm: &[u16]| {
            let teeth = Teeth {
                words: rpm.iter().map(|rpm| rpm * 64).collect(),
                packets: 1,
            };
            teeth.coast_s()
        };
        let [first, second] = coast(&[300, 240, 120, 60]).expect("it coasts");
        assert!((first * 1e3 - 23.958).abs() < 1e-3, "{first}");
        assert!((second * 1e3 - 51.042).abs() < 1e-3, "{second}");
        // It does not get that slow, or turns fast again.
        assert_eq!(coast(&[300, 240, 120]), None);
        assert_eq!(coast(&[300, 240, 120, 60, 300, 240]), None);
        assert_eq!(coast(&[300, 240, 120, 60, 240, 120]), None);
    }

    /// Three packets show 100 rpm, then one shows 184.98 and two 185 rpm.
    #[test]
    fn packets_of_a_head_that_stopped_are_those_of_its_last_tooth() {
        use protocols::xv11::{RawReading, SpeedWord};
        let mut teeth = Teeth::default();
        let mut shown = vec![teeth.stalled_packets()];
        for word in [
            100 * 64,
            100 * 64,
            100 * 64,
            185 * 64 - 1,
            185 * 64,
            185 * 64,
        ] {
            teeth.frame(&Frame::new(0, SpeedWord(word), [RawReading([0; 4]); 4]));
            shown.push(teeth.stalled_packets());
        }
        assert_eq!(shown, [0, 1, 2, 3, 1, 0, 0]);
        assert_eq!(teeth.words, [6_400, 11_839, 11_840]);
    }
}
