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
