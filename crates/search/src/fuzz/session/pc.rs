//! The PC program: map, poses and waypoints of a robot over a line that flips bits. The judge
//! compares the displayed map with that of the slow reference decoder.

use core::time::Duration;

use emulators::Device;
use emulators::pc::{Action, Pc, Script};
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::pcui::message::{self, MapProperties};
use protocols::pcui::{self, FRAME_MAX, HEADER_LEN};
use protocols::{Instant, LineEvent, rle};

use super::step::Step;
use super::tape::Tape;
use crate::fuzz::subject::{Behaviour, Violation, size};
use engine::codec;
use engine::codec::wire::{Choices, Wire};
use engine::rig::line::Direction;
use engine::robots::rescue::pc_program::fielded;

/// The PC program, or the fielded one.
pub(super) struct Client {
    defects: Vec<String>,
}

/// Defects of the fielded PC program that these laws can detect. It has all of them at once.
const DEFECTS: [&str; 3] = ["UI-01", "UI-02", "UI-08"];

/// Whether the PC program has this defect.
pub(super) fn knows(id: &str) -> bool {
    DEFECTS.contains(&id)
}

impl Client {
    pub(super) const NAME: &'static str = "pc";

    pub(super) fn new(defects: &[String]) -> Self {
        let known = |id: &&String| knows(id);
        Self {
            defects: defects.iter().filter(known).cloned().collect(),
        }
    }
}

/// Maximum number of frames and pauses in a session.
const STEPS_MAX: usize = 16;
/// Number of rows, and of cells in a row.
const WIDTH: usize = 300;
/// A pause that ends every partial frame.
const PAUSE_MS: u32 = 120;
/// Cell values: free, unknown, wall, and intermediate values. No sum of them equals the length of a
/// row, so that a plain row cannot be mistaken for a coded one.
const CELLS: [u8; 5] = [0, 127, 255, 28, 200];

/// A frame with the position of the robot and the size of its map.
fn properties(position_mm: [i16; 2]) -> Vec<u8> {
    let mut frame = [0; FRAME_MAX];
    let properties = MapProperties {
        resolution_mm: 20,
        size_mm: [6000; 2],
        layers: 1,
        position_mm,
        layer: 0,
        psi_deg: 90,
    };
    let len = message::encode_map_properties(&properties, &mut frame).expect("thirty bytes");
    frame[..len].to_vec()
}

/// A run-length encoded row as the robot sends it; plain if that is shorter or selected.
fn row(choices: &mut Choices<'_>) -> Vec<u8> {
    let (y, is_plain) = (choices.below(WIDTH), choices.byte().is_multiple_of(2));
    let mut pixels = [CELLS[choices.below(CELLS.len())]; WIDTH];
    for _ in 0..choices.byte() % 4 {
        let (from, cell) = (choices.below(WIDTH), CELLS[choices.below(CELLS.len())]);
        pixels[from..].fill(cell);
    }
    let y = u16::try_from(y).expect("below 300");
    let mut frame = [0; FRAME_MAX];
    let len = if is_plain {
        let [low, high] = y.to_le_bytes();
        frame[HEADER_LEN..HEADER_LEN + 3].copy_from_slice(&[0, low, high]);
        frame[HEADER_LEN + 3..HEADER_LEN + 3 + WIDTH].copy_from_slice(&pixels);
        pcui::seal(&mut frame, *b"MAP", 3 + WIDTH)
    } else {
        message::encode_row(0, y, &pixels, rle::Dialect::Fielded, &mut frame)
    };
    frame[..len.expect("at most 320 bytes")].to_vec()
}

impl super::Bench for Client {
    const NAME: &'static str = Self::NAME;
    const PORTS: &'static [(&'static str, u32)] = &[("radio", pcui::BAUD)];

    fn steps(&self, choices: &[u8]) -> Vec<Step> {
        let mut choices = Choices::new(choices);
        let mut steps = vec![Step::Send(0, properties([1000; 2]))];
        while !choices.is_empty() && steps.len() < STEPS_MAX {
            let kind = choices.byte() % 16;
            if kind < 2 {
                steps.push(Step::Wait(PAUSE_MS));
                continue;
            }
            let mut bytes = match kind {
                2 | 3 => properties([choices.word(), choices.word()].map(u16::cast_signed)),
                4 => {
                    let mut waypoints = Vec::new();
                    codec::Pcui::build(&mut choices, &mut waypoints);
                    waypoints
                }
                _ => row(&mut choices),
            };
            match choices.byte() % 8 {
                // A line that flips bits does not correct checksums.
                0 => {
                    let at = choices.below(bytes.len());
                    bytes[at] ^= 1 << (choices.byte() % 8);
                }
                1 | 2 => {
                    let at = choices.below(HEADER_LEN);
                    bytes[at] ^= 1 << (choices.byte() % 8);
                }
                _ => {}
            }
            steps.push(Step::Send(0, bytes));
        }
        steps
    }

    fn judge(
        &self,
        steps: &[Step],
        behaviour: &mut Behaviour,
        tape: &mut Tape,
    ) -> Result<(), Violation> {
        let mut operator = Operator::new(!self.defects.is_empty());
        let mut expected = Expected::default();
        for step in steps {
            match step {
                Step::Wait(ms) => {
                    operator.wait(*ms);
                    expected.pause();
                }
                Step::Send(_, bytes) => {
                    tape.note(0, operator.now, Direction::ToDevice, bytes);
                    operator.receive(bytes);
                    expected.heard.extend(bytes);
                }
                Step::Reply(_) => {}
            }
        }
        operator.wait(PAUSE_MS);
        expected.pause();
        expected.compare(&operator)?;
        // After a pause the program must accept a valid frame, whatever came before.
        let last = properties([123, 45]);
        tape.note(0, operator.now, Direction::ToDevice, &last);
        operator.receive(&last);
        behaviour.note(&operator.figures());
        if operator.position_mm() != Some([123, 45]) {
            let detail = format!("it shows the robot at {:?} mm", operator.position_mm());
            return Err(Violation::new("the-robot-is-heard-after-all", detail));
        }
        Ok(())
    }

    fn plainer(&self, step: &Step) -> Vec<Step> {
        let Step::Send(port, bytes) = step else {
            return Vec::new();
        };
        // Simpler cells; the frame stays valid or invalid as before.
        let mut plainer = Vec::new();
        for value in [0, 28] {
            let mut other = bytes.clone();
            let cells = other.iter_mut().skip(HEADER_LEN + 3);
            cells.for_each(|cell| *cell = value);
            if codec::Pcui::frame_at(bytes).is_some() {
                codec::Pcui::repair(&mut other);
            }
            plainer.push(Step::Send(*port, other));
        }
        plainer.truncate(usize::from(bytes.iter().skip(HEADER_LEN + 3).any(|&b| b > 28)) * 2);
        plainer
    }

    fn defects(&self) -> &[String] {
        &self.defects
    }
}

/// The program under test.
enum Program {
    Sound(Box<Pc>, Box<World>),
    Fielded(Box<fielded::Client>),
}

/// A program with its port open.
struct Operator {
    program: Program,
    now: Instant,
}

impl Operator {
    fn new(is_fielded: bool) -> Self {
        let now = Instant::ZERO;
        let program = if is_fielded {
            Program::Fielded(Box::default())
        } else {
            let mut pc = Pc::new(Script::new(Vec::new()).expect("nothing in it"));
            pc.perform(now, Action::Open).expect("within all limits");
            pc.line_event(Pc::AIR, now, LineEvent::Opened);
            let scene = Scene::new(Vec::<Shape>::new(), vec![]).expect("an open floor");
            let body = BodyConfig::default().ideal();
            let world = World::new(scene, body, Pose::default(), 1).expect("room for it");
            Program::Sound(Box::new(pc), Box::new(world))
        };
        Self { program, now }
    }

    fn receive(&mut self, bytes: &[u8]) {
        match &mut self.program {
            _ if bytes.is_empty() => {}
            Program::Sound(pc, _) => pc.receive(Pc::AIR, self.now, bytes),
            Program::Fielded(client) => client.receive(bytes),
        }
    }

    fn wait(&mut self, ms: u32) {
        self.now += Duration::from_millis(u64::from(ms));
        if let Program::Sound(pc, world) = &mut self.program {
            pc.poll(self.now, world);
        }
    }

    fn position_mm(&self) -> Option<[i32; 2]> {
        match &self.program {
            Program::Sound(pc, _) => {
                let (_, properties) = pc.record().map_properties?;
                Some(properties.position_mm.map(i32::from))
            }
            Program::Fielded(client) => client.pose().map(|[x, y, _]| [x, y]),
        }
    }

    /// A row of the displayed map.
    fn row(&self, y: usize) -> Option<&[u8]> {
        let (cells, width) = match &self.program {
            Program::Sound(pc, _) => (&pc.map()?.pixels, pc.map()?.width),
            Program::Fielded(client) => (&client.held()?.cells, client.held()?.width),
        };
        cells.get(y * width..(y + 1) * width)
    }

    fn figures(&self) -> [u64; 4] {
        match &self.program {
            Program::Sound(pc, _) => {
                let counts = &pc.record().counts;
                let heard = [counts.rows, counts.coded_rows, counts.bad_frames];
                let [rows, coded, bad_frames] = heard.map(size);
                [
                    rows,
                    coded,
                    bad_frames,
                    size(counts.bad_messages + counts.bad_rows),
                ]
            }
            Program::Fielded(client) => [u64::from(client.is_deaf()), 0, 0, 0],
        }
    }
}

/// The map that the bytes define.
#[derive(Default)]
struct Expected {
    /// Bytes since the last pause.
    heard: Vec<u8>,
    /// Received rows without their last column, which the fielded code ignores.
    rows: std::collections::BTreeMap<usize, [u8; WIDTH - 1]>,
    /// Whether the robot has reported a map of another size; then no row of its map is known.
    is_another: bool,
}

impl Expected {
    /// Decodes the received bytes: complete rows within the map, each by its own coding.
    fn pause(&mut self) {
        let heard = core::mem::take(&mut self.heard);
        let mut at = 0;
        while at < heard.len() {
            match codec::Pcui::frame_at(&heard[at..]) {
                Some(len) => {
                    self.read(&heard[at..at + len]);
                    at += len;
                }
                None => at += 1,
            }
        }
    }

    fn read(&mut self, frame: &[u8]) {
        let (id, payload) = (&frame[14..17], &frame[HEADER_LEN..]);
        // 6000 mm in cells of 20.
        self.is_another |= id == b"MPD" && !payload.starts_with(&[20, 0x70, 0x17, 0x70, 0x17]);
        let [0, low, high, ref data @ ..] = *payload else {
            return;
        };
        let y = usize::from(u16::from_le_bytes([low, high]));
        let cells: Vec<u8> = match id {
            b"MAP" if data.len() == WIDTH => data.to_vec(),
            b"MAR" if data.len().is_multiple_of(2) => {
                let pairs = data.chunks(2);
                pairs
                    .flat_map(|pair| vec![pair[1]; usize::from(pair[0])])
                    .collect()
            }
            _ => return,
        };
        if y < WIDTH && (WIDTH - 1..=WIDTH).contains(&cells.len()) {
            let row = cells.first_chunk().expect("long enough");
            self.rows.insert(y, *row);
        }
    }

    fn compare(&self, operator: &Operator) -> Result<(), Violation> {
        if self.is_another {
            return Ok(());
        }
        for y in 0..WIDTH {
            let Some(shown) = operator
                .row(y)
                .and_then(|row| row.first_chunk::<{ WIDTH - 1 }>())
            else {
                continue;
            };
            let is_right = match self.rows.get(&y) {
                Some(told) => shown == told,
                None => shown
                    .iter()
                    .all(|cell| *cell == shown[0] && [0, 127].contains(cell)),
            };
            if !is_right {
                let what = if self.rows.contains_key(&y) {
                    "another than was told"
                } else {
                    "that was never told"
                };
                let detail = format!("row {y} shows {:02X?}..", &shown[..6]);
                return Err(Violation::new(
                    format!("rows-show-what-was-told: one {what}"),
                    detail,
                ));
            }
        }
        Ok(())
    }
}
