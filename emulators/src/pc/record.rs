//! Everything the PC has learned from the robot.

use protocols::pcui::MessageError;
use protocols::pcui::diagnosis::{Diagnosis, Readings};
use protocols::pcui::message::{MapProperties, MapRow, Message, State, Waypoint};
use protocols::pcui::{Decoder, Frame};
use protocols::{Decode, Instant};

use super::map::{PcMap, RowError};

/// Maximum number of poses kept; further ones are only counted.
pub const TRAJECTORY_MAX: usize = 500_000;

/// A pose that the robot stated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StatedPose {
    /// Time at which the message was complete.
    pub at: Instant,
    /// Position in the robot's map.
    pub position_mm: [i16; 2],
    /// Heading, clockwise, 0 towards -x.
    pub psi_deg: i16,
}

/// Number of received messages, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Bytes in all.
    pub bytes: u64,
    /// MPD frames.
    pub map_properties: u64,
    /// MAP frames.
    pub rows: u64,
    /// MAR frames.
    pub coded_rows: u64,
    /// LWP frames.
    pub waypoint_lists: u64,
    /// STA frames of the robot.
    pub states: u64,
    /// DIA frames.
    pub diagnoses: u64,
    /// Candidates with a wrong checksum or length, or cut off.
    pub bad_frames: u64,
    /// Valid frames without a meaning.
    pub bad_messages: u64,
    /// Rows that do not fit the map.
    pub bad_rows: u64,
    /// Rows that came before the PC knew how wide they should be.
    pub early_rows: u64,
    /// Poses beyond [`TRAJECTORY_MAX`].
    pub poses_dropped: u64,
}

/// Everything the PC has learned.
#[derive(Clone, Debug, Default)]
pub struct Record {
    /// The last map properties.
    pub map_properties: Option<(Instant, MapProperties)>,
    /// The last state.
    pub state: Option<(Instant, State)>,
    /// Since when the robot has been reporting its present mode.
    pub mode_since: Option<Instant>,
    /// The last list of waypoints.
    pub waypoints: Option<(Instant, Vec<Waypoint>)>,
    /// The robot's own diagnosis, if it sends one.
    pub diagnosis: Option<(Instant, Diagnosis)>,
    /// Positions of the victims found by the robot, millimetres in its map.
    pub victims: Vec<[i16; 2]>,
    /// Readings of the robot's sensors, if it sends them.
    pub readings: Option<Readings>,
    /// Number and text of the robot's newest message.
    pub message: Option<(u16, String)>,
    /// The map, once its size is known.
    pub map: Option<PcMap>,
    /// The poses that the robot stated, each change once.
    pub trajectory: Vec<StatedPose>,
    /// Counters of received messages.
    pub counts: Counts,
    decoder: Decoder,
}

/// Subject of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum News {
    MapProperties,
    /// The map's size changed, or became known.
    MapSize,
    Row,
    /// The last missing row arrived.
    MapComplete,
    Waypoints,
    State,
    /// The robot's condition has changed, apart from its figures.
    Condition,
    /// Known already, or not evaluated.
    Nothing,
    /// The number of victims changed.
    Victims,
    /// A new message of the robot.
    Message,
    /// The map's size is invalid.
    BadSize,
    BadMessage(MessageError),
    BadRow(RowError),
}

impl Record {
    /// Bytes that belong to no frame: text of the robot, or parts of damaged frames.
    pub fn text_bytes(&self) -> u64 {
        self.decoder.discarded()
    }

    /// Takes bytes and reports the messages in them to `tell`.
    pub(super) fn take(&mut self, now: Instant, bytes: &[u8], mut tell: impl FnMut(News)) {
        self.counts.bytes += bytes.len() as u64;
        let mut input = bytes;
        while let Some(outcome) = self.decoder.step(&mut input) {
            match outcome {
                Ok(frame) => tell(self.read(now, &frame)),
                Err(_) => self.counts.bad_frames += 1,
            }
        }
    }

    /// Handles an idle line.
    pub(super) fn idle(&mut self, now: Instant, tell: impl FnMut(News)) {
        self.decoder.idle();
        self.take(now, &[], tell);
    }

    fn read(&mut self, now: Instant, frame: &Frame) -> News {
        match frame.message() {
            Ok(Message::Map(properties)) => self.read_properties(now, properties),
            Ok(Message::Row(row)) => {
                self.counts.rows += 1;
                self.read_row(now, row, PcMap::put_row)
            }
            Ok(Message::CodedRow(row)) => {
                self.counts.coded_rows += 1;
                self.read_row(now, row, PcMap::put_coded_row)
            }
            Ok(Message::Waypoints(list)) => {
                self.counts.waypoint_lists += 1;
                self.waypoints = Some((now, list.iter().collect()));
                News::Waypoints
            }
            Ok(Message::State(state)) => {
                self.counts.states += 1;
                if self.state.is_none_or(|(_, old)| old.mode != state.mode) {
                    self.mode_since = Some(now);
                }
                self.state = Some((now, state));
                News::State
            }
            Ok(Message::Diagnosis(told)) => {
                self.counts.diagnoses += 1;
                let now_told = Some((now, told));
                let before = core::mem::replace(&mut self.diagnosis, now_told);
                let is_same = before.is_some_and(|(_, before)| {
                    (before.conditions, before.search) == (told.conditions, told.search)
                });
                if is_same {
                    News::Nothing
                } else {
                    News::Condition
                }
            }
            Ok(Message::Victims(list)) => {
                let victims: Vec<_> = list.iter().collect();
                let is_other = victims.len() != self.victims.len();
                self.victims = victims;
                if is_other {
                    News::Victims
                } else {
                    News::Nothing
                }
            }
            Ok(Message::Sensors(readings)) => {
                self.readings = Some(readings);
                News::Nothing
            }
            Ok(Message::Text(told)) => {
                let is_known = |known: &(u16, String)| known.0 == told.number;
                if self.message.as_ref().is_some_and(is_known) {
                    return News::Nothing;
                }
                self.message = Some((told.number, told.text.escape_ascii().to_string()));
                News::Message
            }
            // Only the PC gives orders.
            Ok(Message::Order(_)) => self.refuse(MessageError::Length {
                expected: 9,
                found: 3,
            }),
            Err(error) => self.refuse(error),
        }
    }

    fn refuse(&mut self, error: MessageError) -> News {
        self.counts.bad_messages += 1;
        News::BadMessage(error)
    }

    fn read_properties(&mut self, now: Instant, properties: MapProperties) -> News {
        self.counts.map_properties += 1;
        self.map_properties = Some((now, properties));
        let pose = StatedPose {
            at: now,
            position_mm: properties.position_mm,
            psi_deg: properties.psi_deg,
        };
        let moved = |last: &StatedPose| StatedPose { at: now, ..*last } != pose;
        if self.trajectory.last().is_none_or(moved) {
            if self.trajectory.len() < TRAJECTORY_MAX {
                self.trajectory.push(pose);
            } else {
                self.counts.poses_dropped += 1;
            }
        }
        let known = self.map.as_ref();
        if known.is_some_and(|map| map.matches(&properties)) {
            return News::MapProperties;
        }
        match PcMap::new(&properties) {
            Some(map) => {
                self.map = Some(map);
                News::MapSize
            }
            None => {
                self.counts.bad_messages += 1;
                News::BadSize
            }
        }
    }

    fn read_row(
        &mut self,
        now: Instant,
        row: MapRow<'_>,
        put: impl FnOnce(&mut PcMap, Instant, u8, u16, &[u8]) -> Result<(), RowError>,
    ) -> News {
        let Some(map) = &mut self.map else {
            self.counts.early_rows += 1;
            return News::Row;
        };
        let was_complete = map.complete_at();
        match put(map, now, row.layer, row.y, row.data) {
            Ok(()) if map.complete_at() != was_complete => News::MapComplete,
            Ok(()) => News::Row,
            Err(error) => {
                self.counts.bad_rows += 1;
                News::BadRow(error)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use protocols::pcui::{FRAME_MAX, HEADER_LEN, seal};

    use super::*;

    /// News in a frame of `id` with this payload.
    fn told(record: &mut Record, id: [u8; 3], payload: &[u8]) -> News {
        let mut frame = [0; FRAME_MAX];
        frame[HEADER_LEN..HEADER_LEN + payload.len()].copy_from_slice(payload);
        let len = seal(&mut frame, id, payload.len()).expect("fits");
        let mut news = Vec::new();
        let now = Instant::from_secs(1);
        record.take(now, &frame[..len], |item| news.push(item));
        assert_eq!(news.len(), 1);
        news[0]
    }

    /// A map of 30 mm x 20 mm in cells of 10 mm, so 3 x 2 cells, in one layer, with the robot at
    /// (0, 0).
    const MAP: [u8; 13] = [10, 30, 0, 20, 0, 1, 0, 0, 0, 0, 0, 0, 0];
    /// A map of the same format without any cell.
    const NO_MAP: [u8; 13] = [10, 9, 0, 20, 0, 1, 0, 0, 0, 0, 0, 0, 0];

    /// Each kind of message is counted as its kind and reports its news.
    #[test]
    fn each_message_is_counted_and_tells_what_is_new() {
        let mut record = Record::default();
        let mut says = |id: &[u8; 3], payload: &[u8]| told(&mut record, *id, payload);
        assert_eq!(says(b"MAP", &[0, 0, 0, 1, 2, 3]), News::Row);
        assert_eq!(says(b"MPD", &MAP), News::MapSize);
        assert_eq!(says(b"MPD", &MAP), News::MapProperties);
        assert_eq!(says(b"MPD", &NO_MAP), News::BadSize);
        assert_eq!(says(b"MAP", &[0, 0, 0, 1, 2, 3]), News::Row);
        assert_eq!(says(b"MAR", &[0, 0, 0, 2, 9]), News::Row);
        let beyond = RowError::Row {
            height: 2,
            found: 2,
        };
        assert_eq!(says(b"MAR", &[0, 2, 0, 2, 9]), News::BadRow(beyond));
        // The second of two rows; messages after it are no news.
        assert_eq!(says(b"MAR", &[0, 1, 0, 2, 9]), News::MapComplete);
        assert_eq!(says(b"MAP", &[0, 1, 0, 1, 2, 3]), News::Row);
        assert_eq!(says(b"LWP", &[0, 0]), News::Waypoints);
        let state = [0; 9];
        assert_eq!(says(b"STA", &state), News::State);
        assert_eq!(says(b"STA", &state), News::State);
        let battery = |percent: u8, search: u8| [0, 30, percent, 0, 0, search, 0, 0, 0, 0, 0, 0];
        assert_eq!(says(b"DIA", &battery(50, 0)), News::Condition);
        assert_eq!(says(b"DIA", &battery(49, 0)), News::Nothing);
        assert_eq!(says(b"DIA", &battery(49, 1)), News::Condition);
        assert_eq!(says(b"VIC", &[]), News::Nothing);
        assert_eq!(says(b"VIC", &[1, 0, 2, 0]), News::Victims);
        assert_eq!(says(b"VIC", &[3, 0, 4, 0]), News::Nothing);
        assert_eq!(says(b"VIC", &[]), News::Victims);
        // Orders are the PC's own: three bytes.
        assert!(matches!(says(b"STA", &[0; 3]), News::BadMessage(_)));
        assert!(matches!(says(b"XYZ", &[]), News::BadMessage(_)));
        let expected = Counts {
            bytes: record.counts.bytes,
            map_properties: 3,
            rows: 3,
            coded_rows: 3,
            waypoint_lists: 1,
            states: 2,
            diagnoses: 3,
            bad_messages: 3,
            bad_rows: 1,
            early_rows: 1,
            ..Counts::default()
        };
        assert_eq!(record.counts, expected);
    }

    /// 500,000 poses are kept, further ones counted.
    #[test]
    fn a_full_trajectory_counts_what_it_does_not_keep() {
        let mut record = Record::default();
        let any = StatedPose {
            at: Instant::ZERO,
            position_mm: [7, 7],
            psi_deg: 0,
        };
        record.trajectory = vec![any; TRAJECTORY_MAX - 1];
        let at = |x: u8| {
            let mut map = MAP;
            map[6] = x;
            map
        };
        let mut kept = |x: u8| {
            told(&mut record, *b"MPD", &at(x));
            (record.trajectory.len(), record.counts.poses_dropped)
        };
        assert_eq!([kept(1), kept(2)], [(500_000, 0), (500_000, 1)]);
        // The position of the last pose that was kept.
        assert_eq!(kept(1), (500_000, 1));
    }
}
