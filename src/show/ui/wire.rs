//! What passes the wires, counted while the run goes on, and the last scan among it.

use core::cell::RefCell;
use core::f64::consts::TAU;
use std::rc::Rc;

use emulators::world::Pose;
use protocols::{Decode, Instant, xv11};
use serde::Serialize;

use crate::codec::{Codec, Count, Counter};
use crate::rig::Rig;
use crate::rig::line::{Delivery, Direction};
use crate::rig::trace::{Side, Tap};
use crate::robots::{self, ScanLink};
use crate::scenario::Robot;
use crate::show::view::millimetres;

/// What came out of one direction of a link so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub(super) struct Tally {
    /// Bytes.
    pub(super) bytes: u64,
    /// Sound frames.
    pub(super) frames: u64,
    /// Candidates for a frame that were none.
    pub(super) errors: u64,
    /// Bytes that faults hit, and pieces that a cut swallowed.
    pub(super) faults: u64,
}

impl Tally {
    fn add(&mut self, count: Count) {
        self.frames += count.frames;
        self.errors += count.errors;
    }
}

/// One direction of a link.
#[derive(Default)]
struct Lane {
    tally: Tally,
    decoder: Option<(&'static Codec, Counter)>,
    heard: Instant,
}

/// A turn of the lidar.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Scan {
    /// Number of turns that were complete by then.
    pub(super) turn: u64,
    /// When its last packet came.
    pub(super) at: Instant,
    /// Bearings and distances of the beams that came back, radians and metres.
    beams: Vec<[f64; 2]>,
}

impl Scan {
    /// Where the beams ended, x and y in turn, if they were cast at `pose`.
    pub(super) fn points(&self, pose: Pose) -> Vec<f64> {
        let point = |&[bearing, distance]: &[f64; 2]| {
            let angle = pose.theta + bearing;
            [
                millimetres(pose.x + distance * libm::cos(angle)),
                millimetres(pose.y + distance * libm::sin(angle)),
            ]
        };
        self.beams.iter().flat_map(point).collect()
    }
}

/// Gathers a turn from packets.
struct ScanEar {
    link: ScanLink,
    decoder: xv11::Decoder,
    ranges_mm: [u16; 360],
    last: Scan,
}

impl ScanEar {
    fn hear(&mut self, at: Instant, bytes: &[u8]) {
        for frame in self.decoder.push(bytes).flatten() {
            let first = usize::from(frame.index()) * xv11::READINGS_PER_FRAME;
            for (slot, reading) in self.ranges_mm[first..].iter_mut().zip(frame.readings()) {
                *slot = match reading {
                    xv11::Reading::Range { distance_mm, .. } => distance_mm,
                    xv11::Reading::Invalid { .. } => 0,
                };
            }
            if usize::from(frame.index()) == xv11::FRAMES_PER_TURN - 1 {
                let bearing =
                    |degree: u16| self.link.first_bearing + f64::from(degree) / 360.0 * TAU;
                let beams = (0..).zip(self.ranges_mm).filter(|&(_, mm)| mm > 0);
                let beams = beams.map(|(degree, mm)| [bearing(degree), f64::from(mm) / 1000.0]);
                self.last = Scan {
                    turn: self.last.turn + 1,
                    at,
                    beams: beams.collect(),
                };
                self.ranges_mm = [0; 360];
            }
        }
    }
}

/// All lanes of a rig.
pub(super) struct Wire {
    lanes: Vec<[Lane; 2]>,
    scan_index: Option<usize>,
    scan: ScanEar,
}

/// What puts the wire's bytes where the desk finds them.
struct Ear(Rc<RefCell<Wire>>);

impl Wire {
    /// Listens to all links of `rig` from now on.
    pub(super) fn listen(robot: Robot, rig: &mut Rig) -> Rc<RefCell<Self>> {
        let link = robots::scan_link(robot);
        let lane = |name: &str| {
            let codec = robots::protocol(robot, rig, name);
            core::array::from_fn(|_| Lane {
                decoder: codec.map(|codec| (codec, Counter::new(codec))),
                ..Lane::default()
            })
        };
        let wire = Rc::new(RefCell::new(Self {
            lanes: rig.links().iter().map(|link| lane(&link.name)).collect(),
            scan_index: rig.links().iter().position(|one| one.name == link.link),
            scan: ScanEar {
                link,
                decoder: xv11::Decoder::default(),
                ranges_mm: [0; 360],
                last: Scan::default(),
            },
        }));
        rig.add_tap(Box::new(Ear(Rc::clone(&wire))));
        wire
    }

    /// The last whole turn.
    pub(super) const fn scan(&self) -> &Scan {
        &self.scan.last
    }

    /// Each link's two directions, to the master first.
    pub(super) fn tallies(&self) -> Vec<[Tally; 2]> {
        let both = |lanes: &[Lane; 2]| [lanes[0].tally, lanes[1].tally];
        self.lanes.iter().map(both).collect()
    }
}

impl Tap for Ear {
    fn record(&mut self, link: usize, direction: Direction, side: Side, at: Instant, bytes: &[u8]) {
        if side == Side::Sent {
            return;
        }
        let mut wire = self.0.borrow_mut();
        let Some(lanes) = wire.lanes.get_mut(link) else {
            return;
        };
        let Lane {
            tally,
            decoder,
            heard,
        } = &mut lanes[direction as usize];
        tally.bytes += bytes.len() as u64;
        if let Some((codec, counter)) = decoder {
            if at - *heard > codec.idle() {
                tally.add(counter.idle());
            }
            tally.add(counter.push(bytes));
        }
        *heard = at;
        if wire.scan_index == Some(link) && direction == Direction::ToMaster {
            wire.scan.hear(at, bytes);
        }
    }

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        let mut wire = self.0.borrow_mut();
        if let (Some(lanes), Some(original)) = (wire.lanes.get_mut(link), &delivery.original) {
            let tally = &mut lanes[direction as usize].tally;
            tally.faults += (original.strikes.len() + original.effects.len()) as u64;
        }
    }
}
