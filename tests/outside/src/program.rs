//! The car's program: drives an arc, computes its pose from the counts, draws the lidar's readings
//! into a map.

use core::f64::consts::TAU;

use hilrig::firmware_core::growing_map::GrowingMap;
use hilrig::firmware_core::pose::Point as Place;
use hilrig::prelude::*;

use crate::{board, turret};

/// Edge of a map cell, mm, and maximum number of cells.
const CELL_MM: f64 = 100.0;
const CELLS_MAX: usize = 100_000;

/// The program's figures of its car.
#[derive(Clone, Copy, Debug)]
pub struct Figures {
    /// Travel per count, metres.
    pub tick_m: f64,
    /// Distance between the axles, metres.
    pub wheelbase_m: f64,
}

/// First steers, then drives, then stops: start time, degrees, cm/s.
const PLAN: [(Instant, i8, i8); 3] = [
    (Instant::ZERO, 12, 0),
    (Instant::from_millis(500), 12, 40),
    (Instant::from_millis(5500), 12, 0),
];
const ORDER_EVERY: Duration = Duration::from_millis(100);

/// The program.
#[derive(Clone)]
pub struct Arc {
    figures: Figures,
    pose: Pose,
    at: Instant,
    count: i32,
    heard: Vec<u8>,
    decoder: turret::TurretDecoder,
    map: GrowingMap,
    scan: Vec<Place>,
    next_order: Instant,
    orders: Vec<u8>,
    packets: u64,
    bad_packets: u64,
}

impl Arc {
    /// The link of the lidar.
    pub const LIDAR: Port = Port(0);
    /// The link of the servo board.
    pub const BOARD: Port = Port(1);

    /// The program of a car that starts at `pose`.
    pub fn new(figures: Figures, pose: Pose) -> Self {
        Self {
            figures,
            pose,
            at: Instant::ZERO,
            count: 0,
            heard: Vec::new(),
            decoder: turret::TurretDecoder::default(),
            map: GrowingMap::new(CELL_MM as f32, CELLS_MAX),
            scan: Vec::new(),
            next_order: Instant::ZERO,
            orders: Vec::new(),
            packets: 0,
            bad_packets: 0,
        }
    }

    fn plan(now: Instant) -> [i8; 2] {
        let due = PLAN.iter().rev().find(|(from, ..)| *from <= now);
        due.map_or([0; 2], |&(_, angle, speed)| [angle, speed])
    }

    fn count_ways(&mut self, now: Instant) {
        while let Some(&[what, a, b, c, d, sum]) = self.heard.first_chunk() {
            if what != b'E' || what ^ a ^ b ^ c ^ d != sum {
                self.heard.remove(0);
                continue;
            }
            self.heard.drain(..6);
            let count = i32::from_le_bytes([a, b, c, d]);
            let way = f64::from(count - self.count) * self.figures.tick_m;
            let [angle, _] = Self::plan(now);
            let turn = way * f64::from(angle).to_radians().tan() / self.figures.wheelbase_m;
            let middle = self.pose.theta + turn / 2.0;
            let theta = (self.pose.theta + turn).rem_euclid(TAU);
            let (x, y) = (middle.cos() * way, middle.sin() * way);
            self.pose = Pose::new(self.pose.x + x, self.pose.y + y, theta);
            (self.count, self.at) = (count, now);
        }
    }

    fn draw(&mut self, packet: turret::Packet) {
        let (bearing, mm) = (packet.bearing(), f64::from(packet.distance_mm()));
        if packet.index() == 0 {
            self.scan.clear();
        }
        if mm == 0.0 {
            return;
        }
        let (x, y) = (bearing.cos() * mm, bearing.sin() * mm);
        self.scan.push(Place::new(x as f32, y as f32));
        let angle = bearing + self.pose.theta;
        let from = [self.pose.x * 1000.0, self.pose.y * 1000.0];
        // Cells up to one cell before the end of the beam are free.
        let free = ((mm - CELL_MM) / CELL_MM).max(0.0) as usize;
        for step in 0..free {
            self.mark(from, angle, step as f64 * CELL_MM, 0);
        }
        self.mark(from, angle, mm, 255);
    }

    fn mark(&mut self, from: [f64; 2], angle: f64, mm: f64, value: u8) {
        let [x, y] = [from[0] + angle.cos() * mm, from[1] + angle.sin() * mm];
        // A beam that would make the map too large is omitted.
        let _ = self.map.set(Place::new(x as f32, y as f32), value);
    }
}

impl Master for Arc {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        if port == Self::BOARD {
            self.heard.extend(bytes);
            self.count_ways(now);
            return;
        }
        let found: Vec<_> = self.decoder.push(bytes).collect();
        for packet in found {
            match packet {
                Ok(packet) => {
                    self.packets += 1;
                    self.draw(packet);
                }
                Err(_) => self.bad_packets += 1,
            }
        }
    }

    fn poll(&mut self, now: Instant) {
        while self.next_order <= now {
            let [angle, speed] = Self::plan(now);
            self.orders.extend(board::command(b'S', angle));
            self.orders.extend(board::command(b'D', speed));
            self.next_order += ORDER_EVERY;
        }
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        if port != Self::BOARD {
            return 0;
        }
        let len = buf.len().min(self.orders.len());
        buf[..len].copy_from_slice(&self.orders[..len]);
        self.orders.drain(..len).len()
    }

    fn poll_at(&self) -> Option<Instant> {
        Some(self.next_order)
    }

    fn line_config(&self, port: Port) -> LineConfig {
        match port {
            Self::BOARD => board::LINE,
            _ => turret::LINE,
        }
    }

    fn take_work(&mut self) -> Work {
        Work::NONE
    }
}

impl Inspect for Arc {
    fn estimate(&self) -> Option<(Instant, ProgramPose)> {
        let Pose { x, y, theta } = self.pose;
        let [x_mm, y_mm] = [x * 1000.0, y * 1000.0].map(|mm| mm as f32);
        Some((self.at, ProgramPose::new(x_mm, y_mm, theta as f32)))
    }

    fn map(&self) -> Option<MapView<'_>> {
        Some(self.map.view())
    }

    fn scan(&self) -> &[Place] {
        &self.scan
    }

    fn mode(&self) -> &'static str {
        if Self::plan(self.at)[1] == 0 {
            "wait"
        } else {
            "arc"
        }
    }

    fn counters(&self, report: &mut dyn FnMut(&'static str, u64)) {
        report("packets", self.packets);
        report("bad packets", self.bad_packets);
    }
}
