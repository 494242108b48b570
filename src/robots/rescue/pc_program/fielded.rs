//! The fielded PC program, as far as its faults go: what it makes of the robot's bytes, and what it
//! sends when somebody clicks. It is the other side of the comparison only; nothing here is used
//! by the rig's own PC.
//!
//! ```text
//! bytes -> start word, length, sum -> payload read without bounds -> what is shown
//! click -> list of waypoints as it stands, with the numbers that it has -> frame
//! ```

use emulators::pc::CELLS_MAX;
use protocols::pcui::message::{NO_WAYPOINT, Waypoint};
use protocols::pcui::{HEADER_LEN, MAGIC, PAYLOAD_MAX, checksum};

/// The map as it is painted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Painting {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Values row by row, each row as long as there are rows (UI-09); 0 until they are told.
    pub cells: Vec<u8>,
}

/// The program at its desk.
#[derive(Clone, Debug, Default)]
pub struct Client {
    held: Vec<u8>,
    is_deaf: bool,
    resolution_mm: Option<u8>,
    painting: Painting,
    pose: Option<[i32; 3]>,
    waypoints: Vec<Waypoint>,
    next_id: i16,
}

impl Client {
    /// Whether an exception has ended its serial handler: it hears nothing any more (UI-02).
    pub const fn is_deaf(&self) -> bool {
        self.is_deaf
    }

    /// The pose as it is shown: x and y in millimetres, psi in degrees, all without sign (UI-03).
    pub const fn pose(&self) -> Option<[i32; 3]> {
        self.pose
    }

    /// The map.
    pub const fn painting(&self) -> &Painting {
        &self.painting
    }

    /// The waypoints with their numbers.
    pub fn waypoints(&self) -> &[Waypoint] {
        &self.waypoints
    }

    /// The waypoints' places as they are shown: those of the robot without sign (UI-04).
    pub fn places(&self) -> Vec<[i32; 2]> {
        let shown =
            |waypoint: &Waypoint| waypoint.position_mm.map(|mm| i32::from(mm.cast_unsigned()));
        self.waypoints.iter().map(shown).collect()
    }

    /// Takes bytes of the robot.
    pub fn receive(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if self.is_deaf {
                return;
            }
            let Some((id, payload)) = self.collect(byte) else {
                continue;
            };
            self.is_deaf = self.read(id, &payload).is_none();
        }
    }

    /// A left click at a place of the map: a waypoint there, wherever that is (UI-06), and at
    /// (0, 0) while the map's scale is not known (UI-07). What is sent.
    pub fn click(&mut self, at_mm: [i16; 2]) -> Vec<u8> {
        let id = self.next_id;
        self.next_id = self.next_id.wrapping_add(1);
        self.waypoints.push(Waypoint {
            position_mm: self.resolution_mm.map_or([0; 2], |_| at_mm),
            layer: 0,
            id,
            previous: self.waypoints.last().map_or(NO_WAYPOINT, |last| last.id),
        });
        self.list()
    }

    /// A right click at the waypoint `index`: the first one of its number goes, others keep theirs
    /// (UI-05, PU-08). The list is sent twice.
    pub fn right_click(&mut self, index: usize) -> Vec<u8> {
        if let Some(hit) = self.waypoints.get(index).copied()
            && let Some(first) = self.waypoints.iter().position(|one| one.id == hit.id)
        {
            let gone = self.waypoints.remove(first);
            for one in &mut self.waypoints {
                if one.previous == gone.id {
                    one.previous = gone.previous;
                }
            }
        }
        self.list().repeat(2)
    }

    /// The list as a frame, however long (PU-13).
    fn list(&self) -> Vec<u8> {
        let count = u16::try_from(self.waypoints.len()).unwrap_or(u16::MAX);
        let mut payload = count.to_le_bytes().to_vec();
        for one in &self.waypoints {
            payload.extend(one.position_mm.map(i16::to_le_bytes).as_flattened());
            payload.push(one.layer.cast_unsigned());
            payload.extend([one.id, one.previous].map(i16::to_le_bytes).as_flattened());
        }
        let len = u16::try_from(payload.len()).unwrap_or(u16::MAX);
        let sum = checksum(&payload);
        [
            &MAGIC[..],
            &len.to_le_bytes(),
            &sum.to_le_bytes(),
            b"LWP",
            &payload,
        ]
        .concat()
    }

    /// A frame's id and payload, once `byte` completes it. Only the payload is covered by the sum
    /// (UI-01), and a byte that breaks the start word off cannot begin it anew (UI-08).
    fn collect(&mut self, byte: u8) -> Option<([u8; 3], Vec<u8>)> {
        if let Some(&expected) = MAGIC.get(self.held.len()) {
            if byte == expected {
                self.held.push(byte);
            } else {
                self.held.clear();
            }
            return None;
        }
        self.held.push(byte);
        let header: &[u8; HEADER_LEN] = self.held.first_chunk()?;
        let len = usize::from(u16::from_le_bytes([header[8], header[9]]));
        if len <= PAYLOAD_MAX && self.held.len() < HEADER_LEN + len {
            return None;
        }
        let frame = core::mem::take(&mut self.held);
        let payload = &frame[HEADER_LEN..];
        let sum = u32::from_le_bytes([frame[10], frame[11], frame[12], frame[13]]);
        let is_sound = payload.len() == len && checksum(payload) == sum;
        is_sound.then(|| ([frame[14], frame[15], frame[16]], payload.to_vec()))
    }

    /// What a frame says; `None` is the exception that ends the handler.
    fn read(&mut self, id: [u8; 3], payload: &[u8]) -> Option<()> {
        let byte = |at: usize| payload.get(at).copied();
        let word = |at: usize| Some(u16::from_le_bytes([byte(at)?, byte(at + 1)?]));
        match &id {
            b"MPD" => {
                let resolution = byte(0)?;
                let [width, height] = [word(1)?, word(3)?];
                let cells = |mm: u16| mm.checked_div(u16::from(resolution)).map(usize::from);
                self.resize(cells(width)?, cells(height)?)?;
                self.resolution_mm = Some(resolution);
                self.pose = Some([word(6)?, word(8)?, word(11)?].map(i32::from));
            }
            b"MAP" => {
                let y = usize::from(word(1)?);
                for x in 0..self.painting.width {
                    *self.cell(x, y)? = byte(3 + x)?;
                }
            }
            b"MAR" => self.read_runs(usize::from(word(1)?), payload)?,
            b"LWP" => {
                let list = (0..usize::from(word(0)?)).map(|index| {
                    let at = 2 + 9 * index;
                    let signed = |at| word(at).map(u16::cast_signed);
                    Some(Waypoint {
                        position_mm: [signed(at)?, signed(at + 2)?],
                        layer: byte(at + 4)?.cast_signed(),
                        id: signed(at + 5)?,
                        previous: signed(at + 7)?,
                    })
                });
                self.waypoints = list.collect::<Option<_>>()?;
            }
            _ => {}
        }
        Some(())
    }

    /// Pairs of count and value, up to the last column but one (UI-10).
    fn read_runs(&mut self, y: usize, payload: &[u8]) -> Option<()> {
        let mut x = 0;
        for pair in payload[3..].chunks(2) {
            let &[count, value] = pair else { return None };
            for _ in 0..count {
                if x + 1 >= self.painting.width {
                    return Some(());
                }
                *self.cell(x, y)? = value;
                x += 1;
            }
        }
        Some(())
    }

    fn resize(&mut self, width: usize, height: usize) -> Option<()> {
        if [self.painting.width, self.painting.height] != [width, height] {
            if width * height > CELLS_MAX {
                return None;
            }
            let cells = vec![0; width * height];
            self.painting = Painting {
                width,
                height,
                cells,
            };
        }
        Some(())
    }

    fn cell(&mut self, x: usize, y: usize) -> Option<&mut u8> {
        let at = y * self.painting.height + x;
        self.painting.cells.get_mut(at)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use protocols::pcui::{FRAME_MAX, seal};

    use super::*;

    /// Field-bug catalogue, PU-07: the list that the program produces of its own, by UI-05. The
    /// robot's list has the numbers 0 and 1, a click gets number 0 again, deleting that one hits
    /// the first.
    #[test]
    fn the_list_that_ends_the_robots_program_comes_about_by_three_clicks() {
        let mut client = Client::default();
        client.receive(
            b"PCUI_MSG\x0D\x00\x53\x03\x00\x00MPD\
              \x14\x70\x17\x70\x17\x01\xE8\x03\xE8\x03\x00\x5A\x00",
        );
        let mut robot = Client {
            resolution_mm: Some(20),
            ..Client::default()
        };
        robot.click([9, 9]);
        client.receive(&robot.click([2, 2]));
        client.click([5, 5]);
        let sent = client.right_click(2);
        let golden = b"\x14\x00\x10\x02\x00\x00LWP\x02\x00\
            \x02\x00\x02\x00\x00\x01\x00\xFF\xFF\x05\x00\x05\x00\x00\x00\x00\x01\x00";
        assert_eq!(sent.len(), 2 * 37);
        assert!(sent.ends_with(golden), "{sent:02X?}");
    }

    /// The golden pose of the fielded robot: 1000, 1000, psi 90 on 6 m in cells of 20 mm.
    #[test]
    fn the_fielded_robots_golden_pose_is_read() {
        let mut client = Client::default();
        client.receive(
            b"PCUI_MSG\x0D\x00\x53\x03\x00\x00MPD\
              \x14\x70\x17\x70\x17\x01\xE8\x03\xE8\x03\x00\x5A\x00",
        );
        assert_eq!(client.pose(), Some([1000, 1000, 90]));
        assert_eq!(
            (client.painting().width, client.painting().height),
            (300, 300)
        );
    }

    proptest! {
        /// Its faults are an exception and what is painted wrong, never the end of whoever shows
        /// them: whatever frames it hears, between whatever clicks.
        #[test]
        fn no_frame_brings_the_comparison_down(
            frames in prop::collection::vec(
                (
                    prop::sample::select(vec![*b"MPD", *b"MAP", *b"MAR", *b"LWP", *b"STA"]),
                    prop::collection::vec(any::<u8>(), 0..=40),
                    any::<[i16; 2]>(),
                    0_usize..4,
                ),
                0..12,
            ),
        ) {
            let mut client = Client::default();
            for (id, payload, place, index) in frames {
                let mut frame = [0; FRAME_MAX];
                frame[HEADER_LEN..HEADER_LEN + payload.len()].copy_from_slice(&payload);
                let len = seal(&mut frame, id, payload.len()).expect("short");
                client.receive(&frame[..len]);
                client.click(place);
                client.right_click(index);
                prop_assert_eq!(client.places().len(), client.waypoints().len());
            }
        }
    }
}
