//! Whole turns of a stream, in packets or in frames of firmware 2.1.

use protocols::Decode as _;
use protocols::xv11::{Decoder, Frame, Reading, turn};

/// Packets in a turn.
pub(super) const PACKETS: usize = 90;
/// Largest part by which the speed of a turn may differ from the median of all turns.
const STEADY: f64 = 0.03;

/// A turn of the head.
#[derive(Clone, Debug)]
pub(super) struct Turn {
    /// Turns per minute by tooth; one figure of firmware 2.1.
    pub(super) speeds_rpm: Vec<f64>,
    /// Reading of each degree.
    pub(super) readings: Vec<Reading>,
    /// Packets; none of firmware 2.1.
    pub(super) packets: Vec<Frame>,
}

impl Turn {
    fn of(packets: &[Frame]) -> Self {
        let teeth = packets.iter().filter(|packet| packet.index() % 6 == 1);
        Self {
            speeds_rpm: teeth.map(|packet| f64::from(packet.speed_rpm())).collect(),
            readings: packets
                .iter()
                .flat_map(|packet| packet.readings())
                .collect(),
            packets: packets.to_vec(),
        }
    }

    fn of_frame(frame: &turn::Frame) -> Self {
        // The word is the time of a degree in units of 10 ns.
        let seconds = f64::from(frame.period()) * 1e-8 * 360.0;
        Self {
            speeds_rpm: vec![60.0 / seconds.max(1e-3)],
            readings: (0..360).map(|degree| frame.reading(degree)).collect(),
            packets: Vec::new(),
        }
    }

    /// Distance and strength at `degree`.
    pub(super) fn range(&self, degree: usize) -> Option<(f64, f64)> {
        match self.readings[degree] {
            Reading::Range {
                distance_mm,
                strength,
                ..
            } => Some((f64::from(distance_mm), f64::from(strength))),
            Reading::Invalid { .. } => None,
        }
    }

    fn rpm(&self) -> f64 {
        self.speeds_rpm.iter().sum::<f64>() / self.speeds_rpm.len().max(1) as f64
    }
}

/// The whole turns of `bytes` at an even speed, from the first to the last.
pub(super) fn steady(bytes: &[u8]) -> Vec<Turn> {
    let all = whole(bytes);
    let mut speeds: Vec<f64> = all.iter().map(Turn::rpm).collect();
    speeds.sort_by(f64::total_cmp);
    let Some(&median) = speeds.get(speeds.len() / 2) else {
        return Vec::new();
    };
    let is_steady = |turn: &Turn| (turn.rpm() / median - 1.0).abs() < STEADY;
    all.into_iter()
        .skip_while(|turn| !is_steady(turn))
        .take_while(is_steady)
        .collect()
}

fn whole(bytes: &[u8]) -> Vec<Turn> {
    let mut frames = turn::Decoder::default();
    let frames: Vec<Turn> = frames
        .push(bytes)
        .filter_map(Result::ok)
        .map(|frame| Turn::of_frame(&frame))
        .collect();
    if !frames.is_empty() {
        return frames;
    }
    let mut packets = Decoder::default();
    let packets: Vec<Frame> = packets.push(bytes).filter_map(Result::ok).collect();
    let mut turns = Vec::new();
    let mut rest = &packets[..];
    while let Some(first) = rest.iter().position(|packet| packet.index() == 0) {
        let Some(turn) = rest[first..].get(..PACKETS) else {
            break;
        };
        let in_order = (0_u8..)
            .zip(turn)
            .all(|(index, packet)| packet.index() == index);
        if in_order {
            turns.push(Turn::of(turn));
        }
        rest = &rest[first + if in_order { PACKETS } else { 1 }..];
    }
    turns
}

#[cfg(test)]
mod tests {
    use protocols::xv11::{RawReading, SpeedWord};

    use super::*;

    /// A packet at this speed whose four distances are its index and 1 m.
    fn packet(index: u8, rpm: u16) -> Vec<u8> {
        let reading = RawReading::from(Reading::Range {
            distance_mm: 1_000 + u16::from(index),
            strength: 50,
            weak: false,
        });
        let frame = Frame::new(index, SpeedWord(64 * rpm), [reading; 4]);
        frame.as_bytes().to_vec()
    }

    fn turn_at(rpm: u16) -> Vec<u8> {
        (0..90).flat_map(|index| packet(index, rpm)).collect()
    }

    /// Six packets a tooth: the second of them has its speed first.
    #[test]
    fn a_turn_has_fifteen_teeth_and_360_readings() {
        let mut bytes = Vec::new();
        for index in 0..90 {
            bytes.extend(packet(index, if index % 6 == 1 { 290 } else { 300 }));
        }
        let turns = whole(&bytes);
        assert_eq!(turns.len(), 1);
        assert_eq!(turns[0].speeds_rpm, [290.0; 15]);
        assert_eq!((turns[0].readings.len(), turns[0].packets.len()), (360, 90));
        assert_eq!(turns[0].range(4), Some((1_001.0, 50.0)));
        assert_eq!(turns[0].range(359), Some((1_089.0, 50.0)));
        assert_eq!(turns[0].rpm(), 290.0);
    }

    /// Half a turn before the first, a lost packet in the second, half a turn at the end.
    #[test]
    fn only_turns_in_order_are_whole() {
        let half: Vec<u8> = (45..90).flat_map(|index| packet(index, 300)).collect();
        let torn = (0..90).filter(|index| *index != 50);
        let torn: Vec<u8> = torn.flat_map(|index| packet(index, 200)).collect();
        let begun: Vec<u8> = (0..60).flat_map(|index| packet(index, 300)).collect();
        let bytes = [half, turn_at(310), torn, turn_at(320), turn_at(330), begun].concat();
        let speeds: Vec<f64> = whole(&bytes).iter().map(Turn::rpm).collect();
        assert_eq!(speeds, [310.0, 320.0, 330.0]);
        assert!(whole(&[]).is_empty());
    }

    /// Of 100, 300, 300, 308, 292, 310 and 300 turns a minute the median is 300, of which 3 % are
    /// 9: the first is too slow, and the sixth, which is too fast, is the end.
    #[test]
    fn turns_are_steady_within_three_per_cent_of_the_median() {
        let bytes = [100, 300, 300, 308, 292, 310, 300].map(turn_at).concat();
        let speeds: Vec<f64> = steady(&bytes).iter().map(Turn::rpm).collect();
        assert_eq!(speeds, [300.0, 300.0, 308.0, 292.0]);
        assert!(steady(&[1, 2, 3]).is_empty());
    }

    /// 50,000 units of 10 ns a degree are 0.18 s a turn, 333.3 a minute; none at all is a
    /// millisecond.
    #[test]
    fn a_frame_of_2_1_has_one_speed() {
        let reading = RawReading::from(Reading::Range {
            distance_mm: 1_234,
            strength: 70,
            weak: true,
        });
        let missing = RawReading::from(Reading::Invalid {
            code: 0x35,
            strength: 0,
        });
        let mut readings = [reading; 360];
        readings[7] = missing;
        let frames = [50_000, 0].map(|period| turn::Frame::new(period, &readings));
        let bytes = frames.map(|frame| frame.as_bytes().to_vec()).concat();
        let turns = whole(&bytes);
        assert_eq!(turns.len(), 2);
        assert!((turns[0].rpm() - 1_000.0 / 3.0).abs() < 1e-9);
        assert_eq!(turns[1].speeds_rpm, [60_000.0]);
        assert_eq!(turns[0].range(6), Some((1_234.0, 70.0)));
        assert_eq!((turns[0].range(7), turns[0].packets.len()), (None, 0));
    }
}
