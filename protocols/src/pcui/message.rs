//! Messages of the PC link.
//!
//! | id | direction | payload |
//! |---|---|---|
//! | MPD | robot to PC | resolution u8 mm, size x, y u16 mm, layers u8, pose x, y i16 mm, z i8, psi i16 deg |
//! | MAP | robot to PC | layer u8, row y u16, one byte a pixel |
//! | MAR | robot to PC | layer u8, row y u16, run-length pairs |
//! | LWP | both | count u16, then per waypoint x, y i16 mm, z i8, id i16, previous id i16 (-1: first) |
//! | STA | PC to robot | mode u8, left, right i8 |
//! | STA | robot to PC | mode u8, left, right measured i8, left, right i16 mm/s, left, right set i8 |
//!
//! DIA, VIC, SEN and TXT are in [`super::diagnosis`].
//!
//! psi turns clockwise: 0 looks to -x, 90 to +y, 180 to +x.

use super::diagnosis::{self, Diagnosis, Readings, Text, VictimList};
use super::error::MessageError;
use super::{Frame, HEADER_LEN, seal};

/// Maximum number of waypoints that fit one frame: (902 - 2) / 9, as many as the report's robot
/// keeps.
pub const WAYPOINTS_MAX: usize = 100;
/// `previous` of the first waypoint.
pub const NO_WAYPOINT: i16 = -1;

const WAYPOINT_LEN: usize = 9;

/// Map properties and the robot's pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapProperties {
    /// Edge of a cell.
    pub resolution_mm: u8,
    /// Width and height of the map.
    pub size_mm: [u16; 2],
    /// Number of layers.
    pub layers: u8,
    /// Position in the map.
    pub position_mm: [i16; 2],
    /// Layer the robot is on.
    pub layer: i8,
    /// Heading, clockwise, 0 towards -x.
    pub psi_deg: i16,
}

/// A row of the map: its layer, its y in cells, its pixels or their run-length code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapRow<'a> {
    /// Layer of the map.
    pub layer: u8,
    /// Row, from the bottom.
    pub y: u16,
    /// Pixels (MAP) or run-length pairs (MAR).
    pub data: &'a [u8],
}

/// A point to visit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Waypoint {
    /// Position in the map.
    pub position_mm: [i16; 2],
    /// Layer of the map.
    pub layer: i8,
    /// Number of the waypoint.
    pub id: i16,
    /// The waypoint to visit before, [`NO_WAYPOINT`] for the first.
    pub previous: i16,
}

/// Mode of the robot, as numbered on the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Mode {
    /// Motors off.
    #[default]
    Stop,
    /// Drives by itself along walls and obstacles.
    Exploration,
    /// Visits its waypoints.
    Waypoint,
    /// Driven by the PC.
    Manual,
    /// Explores all reachable space, then goes home. The report promises this mode and gives it no
    /// number; the number is the rig's own.
    Explore,
}

impl Mode {
    /// The mode of a wire number.
    pub const fn from_wire(number: u8) -> Option<Self> {
        match number {
            0 => Some(Self::Stop),
            1 => Some(Self::Exploration),
            2 => Some(Self::Waypoint),
            3 => Some(Self::Manual),
            4 => Some(Self::Explore),
            _ => None,
        }
    }
}

/// State of the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct State {
    /// The measured value.
    pub mode: Mode,
    /// Measured speed, left and right, in ticks per 40 ms.
    pub speed: [i8; 2],
    /// Measured speed, left and right, in mm/s.
    pub speed_mm_s: [i16; 2],
    /// Set-points, left and right, in ticks per 40 ms.
    pub set_point: [i8; 2],
}

/// Orders of the PC.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Order {
    /// The robot's order.
    pub mode: Mode,
    /// Set-points for manual mode, left and right, in ticks per 40 ms.
    pub set_point: [i8; 2],
}

/// A list of waypoints whose length was checked against its count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WaypointList<'a>(&'a [[u8; WAYPOINT_LEN]]);

impl<'a> WaypointList<'a> {
    /// Number of waypoints.
    pub const fn len(self) -> usize {
        self.0.len()
    }

    /// Whether the list has no waypoint.
    pub const fn is_empty(self) -> bool {
        self.0.is_empty()
    }

    /// The waypoints in the order sent.
    pub fn iter(self) -> impl Iterator<Item = Waypoint> + 'a {
        self.0.iter().map(|bytes| Waypoint {
            position_mm: [i16_at(bytes, 0), i16_at(bytes, 2)],
            layer: bytes[4].cast_signed(),
            id: i16_at(bytes, 5),
            previous: i16_at(bytes, 7),
        })
    }
}

/// The meaning of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message<'a> {
    /// MPD.
    Map(MapProperties),
    /// MAP: pixels as they are.
    Row(MapRow<'a>),
    /// MAR: run-length pairs, see [`crate::rle`].
    CodedRow(MapRow<'a>),
    /// LWP.
    Waypoints(WaypointList<'a>),
    /// STA as the PC sends it.
    Order(Order),
    /// STA as the robot sends it.
    State(State),
    /// DIA.
    Diagnosis(Diagnosis),
    /// VIC.
    Victims(VictimList<'a>),
    /// SEN.
    Sensors(Readings),
    /// TXT.
    Text(Text<'a>),
}

impl Frame {
    /// Content of the frame.
    pub fn message(&self) -> Result<Message<'_>, MessageError> {
        let payload = self.payload();
        match &self.id() {
            b"MPD" => Ok(Message::Map(map_properties(exactly(payload)?))),
            b"MAP" => map_row(payload).map(Message::Row),
            b"MAR" => map_row(payload).map(Message::CodedRow),
            b"LWP" => waypoints(payload).map(Message::Waypoints),
            b"STA" if payload.len() == ORDER_LEN => {
                let [mode_number, left, right] = *exactly::<ORDER_LEN>(payload)?;
                let set_point = [left, right].map(u8::cast_signed);
                Ok(Message::Order(Order {
                    mode: mode(mode_number)?,
                    set_point,
                }))
            }
            b"STA" => state(exactly(payload)?).map(Message::State),
            b"DIA" => Ok(Message::Diagnosis(diagnosis::diagnosis(exactly(payload)?))),
            b"VIC" => diagnosis::victims(payload).map(Message::Victims),
            b"SEN" => Ok(Message::Sensors(diagnosis::readings(exactly(payload)?))),
            b"TXT" => diagnosis::text(payload).map(Message::Text),
            id => Err(MessageError::Id(*id)),
        }
    }
}

const ORDER_LEN: usize = 3;

fn i16_at(bytes: &[u8], at: usize) -> i16 {
    i16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn exactly<const N: usize>(payload: &[u8]) -> Result<&[u8; N], MessageError> {
    payload.try_into().map_err(|_| MessageError::Length {
        expected: N,
        found: payload.len(),
    })
}

fn mode(number: u8) -> Result<Mode, MessageError> {
    Mode::from_wire(number).ok_or(MessageError::Mode(number))
}

fn map_properties(bytes: &[u8; 13]) -> MapProperties {
    MapProperties {
        resolution_mm: bytes[0],
        size_mm: [u16_at(bytes, 1), u16_at(bytes, 3)],
        layers: bytes[5],
        position_mm: [i16_at(bytes, 6), i16_at(bytes, 8)],
        layer: bytes[10].cast_signed(),
        psi_deg: i16_at(bytes, 11),
    }
}

fn map_row(payload: &[u8]) -> Result<MapRow<'_>, MessageError> {
    let ([layer, y_low, y_high], data) =
        payload.split_first_chunk().ok_or(MessageError::Length {
            expected: 3,
            found: payload.len(),
        })?;
    Ok(MapRow {
        layer: *layer,
        y: u16::from_le_bytes([*y_low, *y_high]),
        data,
    })
}

fn waypoints(payload: &[u8]) -> Result<WaypointList<'_>, MessageError> {
    let (count, list) = payload.split_first_chunk().ok_or(MessageError::Length {
        expected: 2,
        found: payload.len(),
    })?;
    let count = usize::from(u16::from_le_bytes(*count));
    match list.as_chunks() {
        (waypoints, []) if waypoints.len() == count => Ok(WaypointList(waypoints)),
        _ => Err(MessageError::Length {
            expected: 2 + WAYPOINT_LEN * count,
            found: payload.len(),
        }),
    }
}

fn state(bytes: &[u8; 9]) -> Result<State, MessageError> {
    Ok(State {
        mode: mode(bytes[0])?,
        speed: [bytes[1], bytes[2]].map(u8::cast_signed),
        speed_mm_s: [i16_at(bytes, 3), i16_at(bytes, 5)],
        set_point: [bytes[7], bytes[8]].map(u8::cast_signed),
    })
}

/// Writes the MPD frame and returns its length; `None` if `frame` is too small.
pub fn encode_map_properties(map: &MapProperties, frame: &mut [u8]) -> Option<usize> {
    let mut payload = Payload::new(frame);
    payload.put(&[map.resolution_mm])?;
    payload.put(&map.size_mm[0].to_le_bytes())?;
    payload.put(&map.size_mm[1].to_le_bytes())?;
    payload.put(&[map.layers])?;
    payload.put(&map.position_mm[0].to_le_bytes())?;
    payload.put(&map.position_mm[1].to_le_bytes())?;
    payload.put(&[map.layer.cast_unsigned()])?;
    payload.put(&map.psi_deg.to_le_bytes())?;
    payload.seal(*b"MPD")
}

/// Writes a row in the shorter of the two forms, run-length only if that is shorter. Returns the
/// frame's length; `None` if `frame` is too small.
pub fn encode_row(
    layer: u8,
    y: u16,
    pixels: &[u8],
    dialect: crate::rle::Dialect,
    frame: &mut [u8],
) -> Option<usize> {
    let mut payload = Payload::new(frame);
    payload.put(&[layer])?;
    payload.put(&y.to_le_bytes())?;
    let space = payload.frame.get_mut(payload.len..)?;
    let limit = space.len().min(pixels.len().saturating_sub(1));
    if let Some(len) = crate::rle::encode(pixels, dialect, &mut space[..limit]) {
        payload.len += len;
        return payload.seal(*b"MAR");
    }
    payload.put(pixels)?;
    payload.seal(*b"MAP")
}

/// Writes the LWP frame and returns its length; `None` if there are more than [`WAYPOINTS_MAX`]
/// waypoints or `frame` is too small.
pub fn encode_waypoints(
    waypoints: impl ExactSizeIterator<Item = Waypoint>,
    frame: &mut [u8],
) -> Option<usize> {
    let mut payload = Payload::new(frame);
    payload.put(&u16::try_from(waypoints.len()).ok()?.to_le_bytes())?;
    for waypoint in waypoints {
        payload.put(&waypoint.position_mm[0].to_le_bytes())?;
        payload.put(&waypoint.position_mm[1].to_le_bytes())?;
        payload.put(&[waypoint.layer.cast_unsigned()])?;
        payload.put(&waypoint.id.to_le_bytes())?;
        payload.put(&waypoint.previous.to_le_bytes())?;
    }
    payload.seal(*b"LWP")
}

/// Writes the STA frame of the PC and returns its length; `None` if `frame` is too small.
pub fn encode_order(order: &Order, frame: &mut [u8]) -> Option<usize> {
    let mut payload = Payload::new(frame);
    payload.put(&[order.mode as u8])?;
    payload.put(&order.set_point.map(i8::cast_unsigned))?;
    payload.seal(*b"STA")
}

/// Writes the STA frame of the robot and returns its length; `None` if `frame` is too small.
pub fn encode_state(state: &State, frame: &mut [u8]) -> Option<usize> {
    let mut payload = Payload::new(frame);
    payload.put(&[state.mode as u8])?;
    payload.put(&state.speed.map(i8::cast_unsigned))?;
    payload.put(&state.speed_mm_s[0].to_le_bytes())?;
    payload.put(&state.speed_mm_s[1].to_le_bytes())?;
    payload.put(&state.set_point.map(i8::cast_unsigned))?;
    payload.seal(*b"STA")
}

/// A payload being written behind the place of its header.
struct Payload<'a> {
    frame: &'a mut [u8],
    len: usize,
}

impl<'a> Payload<'a> {
    const fn new(frame: &'a mut [u8]) -> Self {
        Self {
            frame,
            len: HEADER_LEN,
        }
    }

    fn put(&mut self, bytes: &[u8]) -> Option<()> {
        let end = self.len + bytes.len();
        self.frame.get_mut(self.len..end)?.copy_from_slice(bytes);
        self.len = end;
        Some(())
    }

    fn seal(self, id: [u8; 3]) -> Option<usize> {
        seal(self.frame, id, self.len - HEADER_LEN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Decode;
    use crate::pcui::Decoder;

    /// Start pose of the fielded program: resolution 20 mm, 6 m x 6 m, (1000, 1000), psi 90.
    #[test]
    fn the_map_properties_are_the_golden_bytes() {
        let map = MapProperties {
            resolution_mm: 20,
            size_mm: [6000, 6000],
            layers: 1,
            position_mm: [1000, 1000],
            layer: 0,
            psi_deg: 90,
        };
        let mut frame = [0xA5; 64];
        let len = encode_map_properties(&map, &mut frame).expect("fits");
        let golden = *b"PCUI_MSG\x0D\x00\x53\x03\x00\x00MPD\
            \x14\x70\x17\x70\x17\x01\xE8\x03\xE8\x03\x00\x5A\x00";
        assert_eq!(frame[..len], golden);

        let decoded = Decoder::default()
            .push(&golden)
            .next()
            .expect("complete")
            .expect("valid");
        assert_eq!(decoded.message(), Ok(Message::Map(map)));
    }

    /// A state with mode 2, wheels at 1 and -1 and at 300 and -300 mm/s, and the set-points 5 and
    /// -5.
    #[test]
    fn a_state_is_read_by_hand() {
        let payload = [2, 1, 0xFF, 0x2C, 0x01, 0xD4, 0xFE, 5, 0xFB];
        let state = state(&payload).expect("mode 2 exists");
        assert_eq!(state.speed, [1, -1]);
        assert_eq!(state.speed_mm_s, [300, -300]);
        assert_eq!(state.set_point, [5, -5]);
        assert_eq!(super::state(&[5; 9]), Err(MessageError::Mode(5)));
    }

    /// The words of a refusal in a log.
    #[test]
    fn errors_say_what_was_found_and_expected() {
        extern crate std;
        use std::string::ToString;
        let length = MessageError::Length {
            expected: 9,
            found: 4,
        };
        assert_eq!(length.to_string(), "payload has 4 bytes, expected 9");
        let id = MessageError::Id(*b"X\0Y");
        assert_eq!(id.to_string(), "no message is called \"X\\x00Y\"");
        assert_eq!(
            MessageError::Mode(9).to_string(),
            "mode is 9, expected 0 to 4"
        );
    }

    /// 902 bytes are the most that a payload has: 902 ones add up to 0x386.
    #[test]
    fn the_longest_payload_is_sealed_and_one_byte_more_is_not() {
        use crate::pcui::seal;
        let mut frame = [1; 1000];
        assert_eq!(seal(&mut frame, *b"MAP", 902), Some(17 + 902));
        assert_eq!(frame[8..14], [0x86, 0x03, 0x86, 0x03, 0x00, 0x00]);
        assert_eq!(seal(&mut frame, *b"MAP", 903), None);
        assert_eq!(seal(&mut frame[..918], *b"MAP", 902), None);
    }

    /// The header alone decides whether to wait for the payload.
    #[test]
    fn the_longest_payload_is_waited_for_and_one_byte_more_is_not() {
        use crate::pcui::PAYLOAD_MAX;
        let judged = |payload_len: usize| {
            let mut header = [0; HEADER_LEN];
            header[..8].copy_from_slice(b"PCUI_MSG");
            let length = u16::try_from(payload_len).expect("below 65536");
            header[8..10].copy_from_slice(&length.to_le_bytes());
            Decoder::default().push(&header).next()
        };
        assert_eq!(judged(PAYLOAD_MAX), None);
        let max = u32::try_from(PAYLOAD_MAX).expect("below 65536");
        let found = max + 1;
        let error = crate::FrameError::Length { max, found };
        assert_eq!(judged(PAYLOAD_MAX + 1), Some(Err(error)));
    }

    /// A log shows a frame as its name and bytes.
    #[test]
    fn a_log_shows_name_and_bytes() {
        extern crate std;
        let golden = *b"PCUI_MSG\x01\x00\x07\x00\x00\x00MPD\x07";
        let mut decoder = Decoder::default();
        let frame = decoder
            .push(&golden)
            .next()
            .expect("complete")
            .expect("sound");
        assert_eq!(std::format!("{frame:?}"), "pcui::Frame(MPD, [07])");
    }

    /// Request and reply as the fielded robot exchanged them.
    #[test]
    fn state_and_order_are_the_golden_bytes() {
        let order = Order {
            mode: Mode::Exploration,
            set_point: [1, 2],
        };
        let mut frame = [0xA5; 64];
        let len = encode_order(&order, &mut frame).expect("fits");
        assert_eq!(
            frame[..len],
            *b"PCUI_MSG\x03\x00\x04\x00\x00\x00STA\x01\x01\x02"
        );

        let state = State {
            mode: Mode::Exploration,
            set_point: [1, 2],
            ..State::default()
        };
        let len = encode_state(&state, &mut frame).expect("fits");
        let reply = *b"PCUI_MSG\x09\x00\x04\x00\x00\x00STA\x01\x00\x00\x00\x00\x00\x00\x01\x02";
        assert_eq!(frame[..len], reply);
    }

    /// The fielded robot's row of unknown cells.
    #[test]
    fn a_uniform_row_is_the_golden_run_length_frame() {
        let mut frame = [0xA5; 512];
        let dialect = crate::rle::Dialect::Fielded;
        let len = encode_row(0, 0, &[127; 300], dialect, &mut frame).expect("fits");
        let golden = *b"PCUI_MSG\x07\x00\x29\x02\x00\x00MAR\x00\x00\x00\xFF\x7F\x2C\x7F";
        assert_eq!(frame[..len], golden);
    }

    /// 149 runs are shorter than the pixels, 150 runs are not (fielded threshold: 303 bytes).
    #[test]
    fn a_row_of_150_runs_goes_out_as_pixels() {
        let row: [u8; 300] = core::array::from_fn(|x| u8::from(x / 2 % 2 == 0));
        let mut frame = [0; 512];
        let len = encode_row(0, 7, &row, crate::rle::Dialect::Lossless, &mut frame).expect("fits");
        assert_eq!((len, &frame[14..17]), (HEADER_LEN + 303, &b"MAP"[..]));
    }

    /// The fielded robot took 49 waypoints out of a stale buffer.
    #[test]
    fn a_list_that_is_shorter_than_its_count_is_refused() {
        let mut frame = [0; 64];
        frame[HEADER_LEN] = 50;
        let len = seal(&mut frame, *b"LWP", 11).expect("fits");
        let decoded = Decoder::default()
            .push(&frame[..len])
            .next()
            .expect("whole")
            .expect("valid");
        let error = MessageError::Length {
            expected: 452,
            found: 11,
        };
        assert_eq!(decoded.message(), Err(error));
    }

    /// Finding T2: 2 bytes and 9 a waypoint: none, one, two.
    #[test]
    fn a_list_knows_how_long_it_is() {
        let lens = [0_u8, 1, 2].map(|count| {
            let mut payload = [0; 20];
            payload[0] = count;
            let list = waypoints(&payload[..2 + 9 * usize::from(count)]).expect("sound");
            (list.len(), list.is_empty(), list.iter().count())
        });
        assert_eq!(lens, [(0, true, 0), (1, false, 1), (2, false, 2)]);
    }

    /// Modes 0 to 4 exist; 5 does not.
    #[test]
    fn each_mode_has_its_number() {
        let modes = [
            Mode::Stop,
            Mode::Exploration,
            Mode::Manual,
            Mode::Waypoint,
            Mode::Explore,
        ];
        for known in modes {
            assert_eq!(mode(known as u8), Ok(known));
        }
        assert_eq!(mode(5), Err(MessageError::Mode(5)));
        assert_eq!(mode(255), Err(MessageError::Mode(255)));
    }

    /// Field-bug catalogue, PU-07: two waypoints as the fielded PC program sent them.
    #[test]
    fn a_list_is_written_as_the_fielded_one() {
        let waypoint = |at, id, previous| Waypoint {
            position_mm: [at, at],
            layer: 0,
            id,
            previous,
        };
        let list = [waypoint(2, 1, -1), waypoint(5, 0, 1)];
        let mut frame = [0xA5; 64];
        let len = encode_waypoints(list.into_iter(), &mut frame).expect("fits");
        let golden = b"PCUI_MSG\x14\x00\x10\x02\x00\x00LWP\x02\x00\
            \x02\x00\x02\x00\x00\x01\x00\xFF\xFF\x05\x00\x05\x00\x00\x00\x00\x01\x00";
        assert_eq!(frame[..len], golden[..]);
        assert_eq!(encode_waypoints(list.into_iter(), &mut frame[..36]), None);
    }

    /// Three bytes are an order, with the speeds of both sides; of any other length than 9 more it
    /// is neither.
    #[test]
    fn an_order_is_read_by_hand() {
        let decoded = |bytes: &[u8]| Decoder::default().push(bytes).next().expect("whole");
        let order = decoded(b"PCUI_MSG\x03\x00\x02\x01\x00\x00STA\x03\x01\xFE").expect("sound");
        let expected = Order {
            mode: Mode::Manual,
            set_point: [1, -2],
        };
        assert_eq!(order.message(), Ok(Message::Order(expected)));
        let longer = decoded(b"PCUI_MSG\x04\x00\x06\x00\x00\x00STA\x03\x01\x01\x01");
        let (expected, found) = (9, 4);
        let error = MessageError::Length { expected, found };
        assert_eq!(longer.expect("sound").message(), Err(error));
        let shorter = decoded(b"PCUI_MSG\x01\x00\x03\x00\x00\x00STA\x03");
        let (expected, found) = (9, 1);
        let error = MessageError::Length { expected, found };
        assert_eq!(shorter.expect("sound").message(), Err(error));
    }
}
