//! The fielded PC program with its defects: its interpretation of the robot's bytes, and the frames
//! that it sends after a click. It exists for comparison only; the rig's own PC does not use it.
//!
//! ```text
//! bytes -> start word, length, sum -> payload read without bounds -> displayed map and pose
//! click -> list of waypoints with their old numbers -> frame
//! ```

use emulators::pc::CELLS_MAX;
use protocols::pcui::message::{NO_WAYPOINT, Waypoint};
use protocols::pcui::{HEADER_LEN, MAGIC, PAYLOAD_MAX, checksum};

/// The program's map: created when the first size arrives; later sizes do not change it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Held {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Values layer by layer and row by row; 0 until they arrive.
    pub cells: Vec<u8>,
}

impl Held {
    /// Index of a cell; `None` stands for the exception of a missing column, row or layer.
    fn index(&self, layer: usize, x: usize, y: usize) -> Option<usize> {
        let at = (layer * self.height + y) * self.width + x;
        (x < self.width && y < self.height && at < self.cells.len()).then_some(at)
    }
}

/// The program.
#[derive(Clone, Debug, Default)]
pub struct Client {
    pending: Vec<u8>,
    is_deaf: bool,
    is_left_alone: bool,
    resolution_mm: Option<u8>,
    /// Last reported columns and rows.
    size: [usize; 2],
    held: Option<Held>,
    pose: Option<[i32; 3]>,
    waypoints: Vec<Waypoint>,
    next_id: i16,
}

impl Client {
    /// Whether an exception has ended its serial handler: it no longer receives bytes (UI-02).
    pub const fn is_deaf(&self) -> bool {
        self.is_deaf
    }

    /// The displayed pose: x and y in millimetres, psi in degrees, all without sign (UI-03).
    pub const fn pose(&self) -> Option<[i32; 3]> {
        self.pose
    }

    /// The stored map, after a size was received.
    pub const fn held(&self) -> Option<&Held> {
        self.held.as_ref()
    }

    /// The picture of the map, with as many pixels as the last reported size has cells. Rows are
    /// painted from the top of the screen, which is the last row of the map; the offset between
    /// rows is the number of rows (UI-09).
    pub fn painting(&self) -> Vec<u8> {
        let [width, height] = self.size;
        let mut pixels = vec![0; width * height];
        let Some(held) = &self.held else {
            return pixels;
        };
        for (above, y) in (0..height).rev().enumerate() {
            for x in 0..width {
                let value = held.index(0, x, y).map(|at| held.cells[at]);
                if let (Some(pixel), Some(value)) = (pixels.get_mut(above * height + x), value) {
                    *pixel = value;
                }
            }
        }
        pixels
    }

    /// The other end has closed the port: the program opened it at its start and never opens it
    /// again (F-12).
    pub const fn closed_by_far_end(&mut self) {
        self.is_left_alone = true;
    }

    /// The waypoints with their numbers.
    pub fn waypoints(&self) -> &[Waypoint] {
        &self.waypoints
    }

    /// The displayed positions of the waypoints: those of the robot without sign (UI-04).
    pub fn places(&self) -> Vec<[i32; 2]> {
        let shown =
            |waypoint: &Waypoint| waypoint.position_mm.map(|mm| i32::from(mm.cast_unsigned()));
        self.waypoints.iter().map(shown).collect()
    }

    /// Processes bytes from the robot.
    pub fn receive(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if self.is_deaf || self.is_left_alone {
                return;
            }
            let Some((id, payload)) = self.collect(byte) else {
                continue;
            };
            self.is_deaf = self.read(id, &payload).is_none();
        }
    }

    /// A left click at a position: adds a waypoint there, even outside the map (UI-06), and at (0,
    /// 0) while the map's scale is unknown (UI-07). Returns the sent bytes.
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

    /// A right click at the waypoint `index`: removes the first one with its number; the others
    /// keep their numbers (UI-05, PU-08). The list is sent twice.
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

    /// The list as a frame of any length (PU-13).
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

    /// A frame's id and payload, when `byte` completes it. The sum covers only the payload (UI-01),
    /// and a byte that breaks the start word cannot begin a new one (UI-08).
    fn collect(&mut self, byte: u8) -> Option<([u8; 3], Vec<u8>)> {
        if let Some(&expected) = MAGIC.get(self.pending.len()) {
            if byte == expected {
                self.pending.push(byte);
            } else {
                self.pending.clear();
            }
            return None;
        }
        self.pending.push(byte);
        let header: &[u8; HEADER_LEN] = self.pending.first_chunk()?;
        let len = usize::from(u16::from_le_bytes([header[8], header[9]]));
        if len <= PAYLOAD_MAX && self.pending.len() < HEADER_LEN + len {
            return None;
        }
        let frame = core::mem::take(&mut self.pending);
        let payload = &frame[HEADER_LEN..];
        let sum = u32::from_le_bytes([frame[10], frame[11], frame[12], frame[13]]);
        let is_sound = payload.len() == len && checksum(payload) == sum;
        is_sound.then(|| ([frame[14], frame[15], frame[16]], payload.to_vec()))
    }

    /// Interprets a frame; `None` stands for the exception that ends the handler.
    fn read(&mut self, id: [u8; 3], payload: &[u8]) -> Option<()> {
        let byte = |at: usize| payload.get(at).copied();
        let word = |at: usize| Some(u16::from_le_bytes([byte(at)?, byte(at + 1)?]));
        match &id {
            b"MPD" => {
                let resolution = byte(0)?;
                let [width, height] = [word(1)?, word(3)?];
                let cells = |mm: u16| mm.checked_div(u16::from(resolution)).map(usize::from);
                self.resize([cells(width)?, cells(height)?], usize::from(byte(5)?))?;
                self.resolution_mm = Some(resolution);
                self.pose = Some([word(6)?, word(8)?, word(11)?].map(i32::from));
            }
            b"MAP" => {
                let (layer, y) = (usize::from(byte(0)?), usize::from(word(1)?));
                for (x, &value) in payload[3..].iter().enumerate() {
                    *self.cell(layer, x, y)? = value;
                }
            }
            b"MAR" => self.read_runs(usize::from(byte(0)?), usize::from(word(1)?), payload)?,
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

    /// Decodes pairs of count and value, up to the last column but one (UI-10). With a count of 0
    /// the value is not read.
    fn read_runs(&mut self, layer: usize, y: usize, payload: &[u8]) -> Option<()> {
        let mut x = 0;
        for pair in payload[3..].chunks(2) {
            for _ in 0..pair[0] {
                if x + 1 >= self.size[0] {
                    return Some(());
                }
                *self.cell(layer, x, y)? = *pair.get(1)?;
                x += 1;
            }
        }
        Some(())
    }

    /// Sets the size of the picture, and of the map if it is the first one; a lack of memory is an
    /// exception too.
    fn resize(&mut self, [width, height]: [usize; 2], layers: usize) -> Option<()> {
        let is_too_large = |cells: usize| cells > CELLS_MAX;
        if is_too_large(width * height) {
            return None;
        }
        self.size = [width, height];
        if self.held.is_none() {
            if is_too_large(width * height * layers) {
                return None;
            }
            self.held = Some(Held {
                width,
                height,
                cells: vec![0; width * height * layers],
            });
        }
        Some(())
    }

    fn cell(&mut self, layer: usize, x: usize, y: usize) -> Option<&mut u8> {
        let held = self.held.as_mut()?;
        let at = held.index(layer, x, y)?;
        held.cells.get_mut(at)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use protocols::pcui::{FRAME_MAX, seal};

    use super::*;

    /// Field-bug catalogue, PU-07: the program creates this list itself because of UI-05. The
    /// robot's list has the numbers 0 and 1, a click gets the number 0 again, and deleting that
    /// waypoint removes the first one.
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
        let held = client.held().expect("a size was told");
        assert_eq!((held.width, held.height), (300, 300));
    }

    /// A program that has received the size `width` x `height`, with cells of 10 mm in one layer.
    fn told(width: u16, height: u16) -> Client {
        let mut client = Client::default();
        client.size_is(width, height);
        client
    }

    impl Client {
        fn size_is(&mut self, width: u16, height: u16) {
            let [width, height] = [width, height].map(|cells| (cells * 10).to_le_bytes());
            let start = [10, width[0], width[1], height[0], height[1], 1];
            self.hear(b"MPD", &[&start[..], &[0; 7]].concat());
        }

        fn hear(&mut self, id: &[u8; 3], payload: &[u8]) {
            let mut frame = [0; FRAME_MAX];
            frame[HEADER_LEN..HEADER_LEN + payload.len()].copy_from_slice(payload);
            let len = seal(&mut frame, *id, payload.len()).expect("it fits");
            self.receive(&frame[..len]);
        }

        fn cells(&self) -> &[u8] {
            &self.held().expect("a size was told").cells
        }
    }

    /// P5: four columns, two rows. The upper row of the screen is painted at pixel 0, the lower one
    /// at pixel 2 instead of 4.
    #[test]
    fn p5_a_map_that_is_not_square_is_painted_over_itself() {
        let mut client = told(4, 2);
        client.hear(b"MAP", &[0, 0, 0, 9, 9, 9, 9]);
        client.hear(b"MAP", &[0, 1, 0, 1, 2, 3, 4]);
        assert_eq!(client.painting(), [1, 2, 9, 9, 9, 9, 0, 0]);
        assert_eq!(client.cells(), [9, 9, 9, 9, 1, 2, 3, 4]);
    }

    /// P5: all pixels of the payload are painted. A pixel beyond the row ends the handler, as do an
    /// unknown layer and an unknown row.
    #[test]
    fn p5_a_plain_row_is_as_long_as_it_is() {
        let mut client = told(300, 300);
        client.hear(b"MAP", &[0, 7, 0, 5, 6]);
        assert_eq!(client.cells()[7 * 300..][..3], [5, 6, 0]);
        client.hear(b"MAP", &[&[0, 8, 0][..], &[4; 300]].concat());
        assert_eq!(client.cells()[9 * 300 - 1], 4);
        assert!(!client.is_deaf());
        for payload in [
            &[&[0, 9, 0][..], &[4; 301]].concat()[..],
            &[1, 9, 0, 4],
            &[0, 0x2C, 1, 4],
        ] {
            let mut client = client.clone();
            client.hear(b"MAP", payload);
            assert!(client.is_deaf(), "{:?}", &payload[..4]);
        }
        client.hear(b"MAR", &[1, 9, 0, 1, 4]);
        assert!(client.is_deaf());
    }

    /// P5: without a pixel to paint, the missing value is never read.
    #[test]
    fn p5_a_coded_row_may_end_in_a_lone_count_of_0() {
        let mut client = told(4, 4);
        client.hear(b"MAR", &[0, 1, 0, 2, 8, 0]);
        assert_eq!(client.cells()[4..8], [8, 8, 0, 0]);
        assert!(!client.is_deaf());
        client.hear(b"MAR", &[0, 1, 0, 2, 8, 1]);
        assert!(client.is_deaf());
    }

    /// P5: the map is created once. A smaller size that arrives later is painted with the old
    /// cells.
    #[test]
    fn p5_a_second_size_keeps_the_map() {
        let mut client = told(4, 4);
        client.hear(b"MAP", &[0, 0, 0, 1, 2, 3, 4]);
        client.hear(b"MAP", &[0, 1, 0, 5, 6, 7, 8]);
        client.size_is(2, 2);
        let held = client.held().expect("a size was told");
        assert_eq!((held.width, held.height), (4, 4));
        assert_eq!(client.painting(), [5, 6, 1, 2]);
    }

    proptest! {
        /// The defects cause an exception or a wrong picture, but never end the process that shows
        /// them, for any frames and clicks.
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
