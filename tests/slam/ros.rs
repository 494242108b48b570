//! Messages of ROS 2 with the room's scans and odometry.

use emulators::world::Pose;

use crate::room;

/// A ROS 2 message in CDR: little-endian numbers aligned to their size.
#[derive(Default)]
struct Cdr(Vec<u8>);

impl Cdr {
    fn number<const N: usize>(&mut self, bytes: [u8; N]) -> &mut Self {
        self.0.resize(self.0.len().next_multiple_of(N), 0);
        self.0.extend(bytes);
        self
    }

    fn string(&mut self, text: &str) -> &mut Self {
        let len = u32::try_from(text.len() + 1).expect("short");
        self.number(len.to_le_bytes()).0.extend(text.bytes());
        self.0.push(0);
        self
    }

    fn header(&mut self, at_s: f64, frame: &str) -> &mut Self {
        #[expect(clippy::cast_possible_truncation, reason = "small")]
        let (seconds, nanos) = (at_s as i32, (at_s.fract() * 1e9) as i32);
        self.number(seconds.to_le_bytes());
        self.number(nanos.to_le_bytes()).string(frame)
    }

    fn floats(&mut self, numbers: &[f32]) -> &mut Self {
        for number in numbers {
            self.number(number.to_le_bytes());
        }
        self
    }

    fn message(&self) -> Vec<u8> {
        [&[0, 1, 0, 0], &self.0[..]].concat()
    }
}

pub(crate) fn laser_scan(at_s: f64, ranges: &[f32]) -> Vec<u8> {
    let mut cdr = Cdr::default();
    let degree = 1_f32.to_radians();
    let count = u32::try_from(ranges.len()).expect("short");
    cdr.header(at_s, "laser")
        .floats(&[-90.0 * degree, 89.0 * degree, degree, 0.0, 0.1, 0.05, 20.0])
        .number(count.to_le_bytes())
        .floats(ranges)
        .number([0; 4]);
    cdr.message()
}

pub(crate) fn odometry(at_s: f64, pose: Pose) -> Vec<u8> {
    let mut cdr = Cdr::default();
    cdr.header(at_s, "odom").string("base_link");
    let (z, w) = libm::sincos(pose.theta / 2.0);
    for number in [pose.x, pose.y, 0.0, 0.0, 0.0, z, w] {
        cdr.number(number.to_le_bytes());
    }
    (0..36 + 6 + 36).for_each(|_| {
        cdr.number([0; 8]);
    });
    cdr.message()
}

/// The room's CARMEN log as messages.
pub(crate) fn room_messages() -> (Vec<(u16, f64, Vec<u8>)>, Pose) {
    let (log, truth) = room::log();
    let mut messages = Vec::new();
    for line in log.lines().filter(|line| line.starts_with("FLASER")) {
        let numbers: Vec<f64> = line
            .split(' ')
            .filter_map(|field| field.parse().ok())
            .collect();
        let (ranges, rest) = numbers[1..].split_at(180);
        let at_s = rest[6];
        #[expect(clippy::cast_possible_truncation, reason = "as the messages have it")]
        let ranges: Vec<f32> = ranges.iter().map(|range| *range as f32).collect();
        messages.push((
            1,
            at_s,
            odometry(at_s, Pose::new(rest[3], rest[4], rest[5])),
        ));
        messages.push((0, at_s, laser_scan(at_s, &ranges)));
    }
    (messages, truth)
}
