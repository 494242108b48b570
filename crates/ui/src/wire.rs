//! Counters of the traffic on all links while the run continues, and the last scan.

use std::sync::{Arc, Mutex, PoisonError};

use emulators::world::Pose;
use protocols::Instant;
use serde::Serialize;

use engine::Shared;
use engine::codec::{Codec, Count, Counter};
use engine::rig::Link;
use engine::rig::line::{Delivery, Direction};
use engine::rig::trace::{Side, Tap};
use engine::robots::{Beam, ScanDecoder};
use engine::run::Run;
use engine::run::wire_log::{self as logged, WireLog};
use show::view::millimetres;

/// Counters of one direction of a link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub(super) struct Tally {
    /// Bytes.
    pub(super) bytes: u64,
    /// Valid frames.
    pub(super) frames: u64,
    /// Rejected candidates for a frame.
    pub(super) errors: u64,
    /// Number of bytes hit by faults, and of chunks lost in a cut.
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

/// One turn of the lidar.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Scan {
    /// Number of complete turns.
    pub(super) turn: u64,
    /// Time of its last packet.
    pub(super) at: Instant,
    beams: Vec<Beam>,
}

impl Scan {
    /// End points of the beams, x and y alternately, if they were cast at `pose`.
    pub(super) fn points(&self, pose: Pose) -> Vec<f64> {
        let point = |beam: &Beam| {
            let angle = pose.theta + beam.bearing;
            [
                millimetres(pose.x + beam.distance_m * libm::cos(angle)),
                millimetres(pose.y + beam.distance_m * libm::sin(angle)),
            ]
        };
        self.beams.iter().flat_map(point).collect()
    }
}

/// All lanes of a rig.
pub(super) struct Wire {
    lanes: Vec<[Lane; 2]>,
    scanner: Option<(usize, Box<dyn ScanDecoder>)>,
    scan: Scan,
    log: Arc<Mutex<WireLog>>,
}

/// The counters at some time, to continue from there.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Counted {
    tallies: Vec<[Tally; 2]>,
    scan: Scan,
}

/// Number of bytes that synchronise a decoder: a turn of a lidar and a frame of any format.
const PRIMER: usize = 4_096;

/// Passes the traffic on to the desk.
struct Ear(Shared<Wire>);

impl Wire {
    /// Observes all links of `run` from its beginning, and records the traffic in `log`.
    pub(super) fn listen(run: &mut Run, log: &Arc<Mutex<WireLog>>) -> Shared<Self> {
        let wire = Self::of(run, log);
        let mut kept = log.lock().unwrap_or_else(PoisonError::into_inner);
        let links = run.rig.links().iter().zip(&wire.lanes);
        kept.begin(links.flat_map(|(link, lanes)| {
            [Direction::ToMaster, Direction::ToDevice].map(|way| {
                let codec = lanes[way as usize].decoder.as_ref();
                logged::Lane {
                    link: &link.name,
                    way,
                    kind: link.kind,
                    codec: codec.map(|(codec, _)| *codec),
                }
            })
        }));
        if !run.instruments().has_body() {
            kept.count_exchanges();
        }
        drop(kept);
        wire.tapped(run)
    }

    /// The same for a run that continues from `now` with the counters `counted`.
    pub(super) fn go_on(
        run: &mut Run,
        log: &Arc<Mutex<WireLog>>,
        counted: &Counted,
    ) -> Shared<Self> {
        let mut wire = Self::of(run, log);
        let mut kept = log.lock().unwrap_or_else(PoisonError::into_inner);
        kept.cut(run.rig.now());
        for (index, lane) in wire.lanes.iter_mut().flatten().enumerate() {
            if let Some((_, counter)) = &mut lane.decoder {
                counter.push(&kept.last_bytes(index, PRIMER));
            }
            lane.heard = run.rig.now();
            lane.tally = counted.tallies[index / 2][index % 2];
        }
        if let Some((link, decoder)) = &mut wire.scanner {
            decoder.push(&kept.last_bytes(2 * *link, PRIMER));
        }
        drop(kept);
        wire.scan = counted.scan.clone();
        wire.tapped(run)
    }

    fn of(run: &Run, log: &Arc<Mutex<WireLog>>) -> Self {
        let (instruments, rig) = (run.instruments(), &run.rig);
        let lane = |link: &Link| {
            [Direction::ToMaster, Direction::ToDevice].map(|direction| {
                let codec = instruments.codec_towards(rig, &link.name, direction);
                Lane {
                    decoder: codec.map(|codec| (codec, Counter::towards(codec, direction))),
                    ..Lane::default()
                }
            })
        };
        let scanner = instruments.scanner(rig).and_then(|(link, decoder)| {
            let index = rig.links().iter().position(|one| one.name == link)?;
            Some((index, decoder))
        });
        Self {
            lanes: rig.links().iter().map(lane).collect(),
            scanner,
            scan: Scan::default(),
            log: Arc::clone(log),
        }
    }

    fn tapped(self, run: &mut Run) -> Shared<Self> {
        let wire = Shared::new(self);
        run.rig.add_tap(Box::new(Ear(wire.clone())));
        wire
    }

    /// The counters so far.
    pub(super) fn counted(&self) -> Counted {
        Counted {
            tallies: self.tallies(),
            scan: self.scan.clone(),
        }
    }

    fn log(&self, act: impl FnOnce(&mut WireLog)) {
        act(&mut self.log.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// The last complete turn.
    pub(super) const fn scan(&self) -> &Scan {
        &self.scan
    }

    fn scan_from(&mut self, link: usize, at: Instant, bytes: &[u8]) {
        if let Some((index, decoder)) = &mut self.scanner
            && *index == link
            && let Some(beams) = decoder.push(bytes)
        {
            let turn = self.scan.turn + 1;
            self.scan = Scan { turn, at, beams };
        }
    }

    /// The counters of each link, to the master first.
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
        let mut wire = self.0.lock();
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
        wire.log(|log| log.push(2 * link + direction as usize, at, bytes));
        if direction == Direction::ToMaster {
            wire.scan_from(link, at, bytes);
        }
    }

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        let mut wire = self.0.lock();
        if let (Some(lanes), Some(original)) = (wire.lanes.get_mut(link), &delivery.original) {
            let tally = &mut lanes[direction as usize].tally;
            let hits = (original.strikes.len() + original.effects.len()) as u64;
            tally.faults += hits;
            if hits > 0 {
                wire.log(|log| log.hit(2 * link + direction as usize));
            }
        }
    }
}
