//! Messages of ROS 2 in their usual encoding, CDR: numbers are aligned to their size, counted from
//! behind the four bytes that contain the byte order.

use emulators::world::Pose;

use super::{Beams, Heard, Refusal, checked, pose};
use crate::finding::Kind;
use crate::{BEAMS_MAX, FARTHEST_M};

/// `sensor_msgs/msg/LaserScan`. Its stamp is the time of the first beam.
pub(super) fn scan(data: &[u8]) -> Result<Heard<Beams>, Refusal> {
    let mut fields = Fields::of(data)?;
    let at_s = fields.header()?;
    let first = fields.f32("angle_min")?;
    fields.f32("angle_max")?;
    let step = fields.f32("angle_increment")?;
    let beam_s = fields.f32("time_increment")?;
    fields.f32("scan_time")?;
    let nearest = fields.f32("range_min")?;
    let farthest = fields.f32("range_max")?;
    let count = fields.u32("ranges")? as usize;
    if count > BEAMS_MAX {
        let words = format!("{count} ranges, expected 0 to {BEAMS_MAX}");
        return Err((Kind::Absurd, words));
    }
    let ranges: Result<Vec<f64>, Refusal> = (0..count).map(|_| fields.f32("ranges")).collect();
    // A range below the minimum is not a reading; NaN is kept and counted later.
    let known = |range: f64| if range < nearest { 0.0 } else { range };
    let what = checked(Beams {
        first,
        step,
        beam_s,
        farthest_m: if farthest > 0.0 { farthest } else { FARTHEST_M },
        ranges: ranges?.into_iter().map(known).collect(),
        seat: Pose::default(),
    })?;
    Ok(Heard { at_s, what })
}

/// `nav_msgs/msg/Odometry`.
pub(super) fn odometry(data: &[u8]) -> Result<Heard<Pose>, Refusal> {
    let mut fields = Fields::of(data)?;
    let at_s = fields.header()?;
    fields.string("child_frame_id")?;
    let what = fields.pose()?;
    Ok(Heard { at_s, what })
}

/// `geometry_msgs/msg/PoseStamped`.
pub(super) fn pose_stamped(data: &[u8]) -> Result<Heard<Pose>, Refusal> {
    let mut fields = Fields::of(data)?;
    let at_s = fields.header()?;
    let what = fields.pose()?;
    Ok(Heard { at_s, what })
}

/// The fields of a message in order.
struct Fields<'a> {
    bytes: &'a [u8],
    at: usize,
    is_little: bool,
}

impl<'a> Fields<'a> {
    fn of(data: &'a [u8]) -> Result<Self, Refusal> {
        match data {
            [0, order @ (0 | 1), _, _, bytes @ ..] => Ok(Self {
                bytes,
                at: 0,
                is_little: *order == 1,
            }),
            _ => Err(refused("is no CDR: expected 00 00 or 00 01 first")),
        }
    }

    /// The next `N` bytes, aligned to `N`.
    fn number<const N: usize>(&mut self, name: &str) -> Result<[u8; N], Refusal> {
        let at = self.at.next_multiple_of(N);
        let bytes = self
            .bytes
            .get(at..)
            .and_then(|rest| rest.first_chunk::<N>());
        let mut bytes = *bytes.ok_or_else(|| refused(&format!("ends before {name}")))?;
        self.at = at + N;
        if !self.is_little {
            bytes.reverse();
        }
        Ok(bytes)
    }

    fn u32(&mut self, name: &str) -> Result<u32, Refusal> {
        self.number(name).map(u32::from_le_bytes)
    }

    fn f32(&mut self, name: &str) -> Result<f64, Refusal> {
        self.number(name).map(f32::from_le_bytes).map(f64::from)
    }

    fn f64(&mut self, name: &str) -> Result<f64, Refusal> {
        self.number(name).map(f64::from_le_bytes)
    }

    /// Skips a string.
    fn string(&mut self, name: &str) -> Result<(), Refusal> {
        let len = self.u32(name)? as usize;
        let end = self
            .at
            .checked_add(len)
            .filter(|end| *end <= self.bytes.len());
        self.at = end.ok_or_else(|| refused(&format!("ends in {name}")))?;
        Ok(())
    }

    /// `std_msgs/msg/Header`: its time in seconds.
    fn header(&mut self) -> Result<f64, Refusal> {
        let seconds = self.number("stamp").map(i32::from_le_bytes)?;
        let nanos = self.u32("stamp")?;
        self.string("frame_id")?;
        Ok(f64::from(seconds) + f64::from(nanos) / 1e9)
    }

    /// `geometry_msgs/msg/Pose`.
    fn pose(&mut self) -> Result<Pose, Refusal> {
        let mut numbers = [0.0; 7];
        for number in &mut numbers {
            *number = self.f64("pose")?;
        }
        let [x, y, _, qx, qy, qz, qw] = numbers;
        pose([x, y], [qx, qy, qz, qw])
    }
}

fn refused(words: &str) -> Refusal {
    (Kind::Unreadable, words.to_owned())
}
