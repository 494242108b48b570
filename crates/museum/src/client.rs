//! The PC program: the fielded one and ours, with the same bytes and the same clicks.

mod clicks;
mod screen;

use emulators::Device;
use emulators::pc::{Pc, Script};
use protocols::pcui::message::{self, MapProperties};
use protocols::pcui::{FRAME_MAX, message::Waypoint};
use protocols::{Instant, LineEvent};

use super::{Bug, Observation, Variant};
pub(super) use clicks::{pu_08, pu_13};
use engine::codec::PCUI;
use engine::robots::rescue::pc_action;
use engine::robots::rescue::pc_program::fielded::Client;
use engine::robots::rescue::pc_program::{self, Gesture};

const PC: &str = "PC program";
pub(super) const CLIENT: &str = "the fielded PC program";

const fn fielded(id: &'static str, sees: &'static str, show: fn(Variant) -> Observation) -> Bug {
    Bug::new(id, PC, sees, CLIENT, show)
}

pub(super) const ROWS: [Bug; 10] = [
    fielded(
        "UI-01",
        "one flipped bit of an id turns a plain row into a coded one, which is drawn",
        screen::ui_01,
    ),
    fielded(
        "UI-02",
        "a frame that is too short, or has a row outside the map: the program ignores all later ones",
        screen::ui_02,
    ),
    fielded(
        "UI-03",
        "a pose of -10 mm and -90 degrees is shown as 65526 and 65446",
        screen::ui_03,
    ),
    fielded(
        "UI-04",
        "a waypoint at -20 mm is shown at 65516",
        screen::ui_04,
    ),
    fielded(
        "UI-05",
        "a click after the robot's own list uses an existing number: the wrong waypoint is deleted",
        clicks::ui_05,
    ),
    fielded(
        "UI-06",
        "a click on a button beside the map sets a waypoint: the robot starts",
        clicks::ui_06,
    ),
    fielded(
        "UI-07",
        "a click before the map's size is known sets a waypoint at (0, 0)",
        clicks::ui_07,
    ),
    fielded(
        "UI-08",
        "a stray P before a frame causes the loss of the frame",
        screen::ui_08,
    ),
    fielded(
        "UI-09",
        "the rows of a map that is not square are drawn over each other",
        screen::ui_09,
    ),
    fielded(
        "UI-10",
        "the last column of a coded row stays white, which means free",
        screen::ui_10,
    ),
];

enum Program {
    Fielded(Client),
    Sound(Box<Pc>),
}

/// One of the two programs, connected, with an operator.
struct Operator {
    program: Program,
    seen: Observation,
}

impl Operator {
    fn new(variant: Variant) -> Self {
        let program = match variant {
            Variant::Defective => Program::Fielded(Client::default()),
            Variant::Sound => {
                let mut pc = Pc::new(Script::default());
                let opened = pc.perform(Instant::ZERO, emulators::pc::Action::Open);
                opened.expect("no limit is touched");
                pc.line_event(Pc::AIR, Instant::ZERO, LineEvent::Opened);
                Program::Sound(Box::new(pc))
            }
        };
        Self {
            program,
            seen: Observation::default(),
        }
    }

    /// An operator whose program received a map of 3 m x 3 m.
    fn with_map(variant: Variant) -> Self {
        let mut desk = Self::new(variant);
        desk.take(&properties(10, [3_000, 3_000], [1_000, 1_000], 90));
        desk
    }

    /// Passes bytes of the robot to the program without recording them.
    fn take(&mut self, bytes: &[u8]) {
        match &mut self.program {
            Program::Fielded(client) => client.receive(bytes),
            Program::Sound(pc) => pc.receive(Pc::AIR, Instant::ZERO, bytes),
        }
    }

    /// Passes bytes of the robot to the program and records them.
    fn receive(&mut self, bytes: &[u8]) {
        self.seen.bytes("robot", &PCUI, bytes);
        self.take(bytes);
    }

    /// Clicks at a position on the map; returns the bytes sent, or the reason for sending none.
    fn click(&mut self, at: [i16; 2]) -> Result<Vec<u8>, String> {
        let gesture = Gesture::Add {
            at: at.map(i32::from),
        };
        match &mut self.program {
            Program::Fielded(client) => Ok(client.click(at)),
            Program::Sound(pc) => said(pc, gesture),
        }
    }

    /// Deletes a waypoint by its index in the list.
    fn delete(&mut self, index: usize) -> Result<Vec<u8>, String> {
        let at = self.places().get(index).copied().unwrap_or_default();
        match &mut self.program {
            Program::Fielded(client) => Ok(client.right_click(index)),
            Program::Sound(pc) => said(pc, Gesture::Delete { index, at }),
        }
    }

    /// Positions of the waypoints as displayed.
    fn places(&self) -> Vec<[i32; 2]> {
        match &self.program {
            Program::Fielded(client) => client.places(),
            Program::Sound(pc) => {
                let list = pc_program::waypoints(pc);
                list.iter().map(|mm| mm.map(i32::from)).collect()
            }
        }
    }

    /// Pose as displayed: x, y, psi.
    fn pose(&self) -> Option<[i32; 3]> {
        match &self.program {
            Program::Fielded(client) => client.pose(),
            Program::Sound(pc) => {
                let (_, map) = pc.record().map_properties?;
                let [x, y] = map.position_mm;
                Some([x, y, map.psi_deg].map(i32::from))
            }
        }
    }

    /// Cells of the map as stored, row by row.
    fn cells(&self) -> &[u8] {
        match &self.program {
            Program::Fielded(client) => client.held().map_or(&[], |held| &held.cells),
            Program::Sound(pc) => pc.map().map_or(&[], |map| &map.pixels),
        }
    }

    /// The map as painted, last row first.
    fn painting(&self) -> Vec<u8> {
        match &self.program {
            Program::Fielded(client) => client.painting(),
            Program::Sound(pc) => {
                let rows = pc.map().map(|map| map.pixels.chunks(map.width));
                rows.map_or(Vec::new(), |rows| rows.rev().flatten().copied().collect())
            }
        }
    }

    /// Records the bytes sent, or the reason for sending none.
    fn note_sent(&mut self, sent: &Result<Vec<u8>, String>) {
        match sent {
            Ok(bytes) => self.seen.bytes("PC", &PCUI, bytes),
            Err(why) => self.seen.figure("the person is told", why),
        }
    }

    fn judged(self, has_defect: bool) -> Observation {
        self.seen.judged(has_defect)
    }
}

/// Bytes that our PC program sends after a gesture.
fn said(pc: &mut Pc, gesture: Gesture) -> Result<Vec<u8>, String> {
    let action = pc_program::answer(pc, gesture).map_err(|why| why.to_string())?;
    let done = pc.perform(Instant::ZERO, pc_action(&action)?);
    done.expect("answers are within the limits");
    let mut buf = [0; 2 * FRAME_MAX];
    let len = pc.transmit(Pc::AIR, &mut buf);
    Ok(buf[..len].to_vec())
}

/// A frame with the map's properties and the robot's pose.
pub(super) fn properties(
    resolution_mm: u8,
    size_mm: [u16; 2],
    position_mm: [i16; 2],
    psi_deg: i16,
) -> Vec<u8> {
    let map = MapProperties {
        resolution_mm,
        size_mm,
        layers: 1,
        position_mm,
        layer: 0,
        psi_deg,
    };
    let mut frame = [0; FRAME_MAX];
    let len = message::encode_map_properties(&map, &mut frame).expect("thirteen bytes");
    frame[..len].to_vec()
}

/// The robot's list of waypoints: numbered and chained from 0.
fn robots_list(places: &[[i16; 2]]) -> Vec<u8> {
    let waypoints = (0..).zip(places).map(|(id, &position_mm)| Waypoint {
        position_mm,
        layer: 0,
        id,
        previous: id - 1,
    });
    super::frames::list_frame(&waypoints.collect::<Vec<_>>())
}
