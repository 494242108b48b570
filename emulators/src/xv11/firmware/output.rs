//! Readings and packets: measured ones, ones without a distance, and ones of a loop without input.

use protocols::Instant;
use protocols::xv11::{FRAME_LEN, Frame, RawReading, Reading, SpeedWord};

use super::Phase;
use crate::world::World;
use crate::xv11::scan::{Full, Pace};
use crate::xv11::{Fault, Xv11};

/// Codes that the encoder gives; meanings are inferred from where they occur.
pub(super) mod code {
    pub(in crate::xv11) const SKIPPED: u8 = 0x21;
    pub(in crate::xv11) const WAITING: u8 = 0x22;
    pub(in crate::xv11) const RESYNCHRONISED: u8 = 0x50;
    pub(in crate::xv11) const LOST: u8 = 0x52;
}

/// Bytes of the packet on the line that still go out at a restart on command, as in the capture.
const CUT_BYTES: u64 = 7;

impl Xv11 {
    pub(super) fn give_up_due(&self, at: Instant) -> bool {
        match self.firmware.phase {
            Phase::Slow {
                give_up_at,
                resume: None,
                ..
            } => give_up_at <= at,
            _ => false,
        }
    }

    /// One packet without measuring.
    pub(super) fn free_run(&mut self, at: Instant) {
        let (Phase::Slow { run, .. } | Phase::Lost { run }) = &mut self.firmware.phase else {
            return;
        };
        let tick = run.next_tick(&self.uart);
        run.tick = tick + 1;
        let (index, code) = (run.index(tick), run.code);
        let reading = self.firmware.scan.excuse(code);
        if !self.profile.whole_turns() {
            self.send(
                at,
                Full {
                    index,
                    word: self.firmware.word,
                    readings: [reading; 4],
                },
            );
        }
    }

    /// Measures all slots due by `at`.
    pub(super) fn measure_until(&mut self, at: Instant, world: &World) {
        let Some(pace) = self.firmware.scan.pace else {
            return;
        };
        while let Some((slot, due)) = self.firmware.scan.next().filter(|&(_, due)| due <= at) {
            self.measure(slot, due, pace, world);
        }
    }

    pub(super) fn measure(&mut self, slot: u16, due: Instant, pace: Pace, world: &World) {
        let scan = &mut self.firmware.scan;
        if scan.resync > 0 {
            scan.resync -= 1;
            self.excuse(due, code::RESYNCHRONISED);
        } else if pace.is_rushed() && scan.measured || self.profile.skips_mark() && slot == 360 {
            self.excuse(due, code::SKIPPED);
        } else {
            let reading = self.eye.measure(world, due, slot, pace.angle_at(due));
            self.store(due, reading);
            self.firmware.scan.measured = true;
        }
    }

    pub(super) fn excuse(&mut self, at: Instant, code: u8) {
        let reading = self.firmware.scan.excuse(code);
        self.firmware.scan.measured = false;
        self.store(at, reading);
    }

    fn store(&mut self, at: Instant, reading: RawReading) {
        let word = self.firmware.word;
        if let Some(full) = self.firmware.scan.store(reading, word) {
            self.send(at, full);
        }
    }

    fn send(&mut self, at: Instant, mut full: Full) {
        if self.faults.has(Fault::DenseStarts) {
            full.readings = dense(full.index, full.readings);
        }
        if self.profile.whole_turns() {
            self.send_part_of_turn(at, full);
        } else {
            let frame = Frame::new(full.index, SpeedWord(full.word), full.readings);
            let mut bytes = *frame.as_bytes();
            if self.faults.has(Fault::Garbage) {
                let place = usize::try_from(self.garbage.below(FRAME_LEN as u64));
                let flip = u8::try_from(1 + self.garbage.below(255));
                bytes[place.expect("below 22")] ^= flip.expect("1 to 255");
            }
            self.uart.push(at, &bytes);
        }
        let mut cut = None;
        if self.faults.take(Fault::Restart) {
            cut = Some(self.uart.part_out_at(CUT_BYTES));
            self.firmware.restart_at = cut;
        }
        self.uart.release(at, cut);
    }

    /// Firmware 2.1: a header, then the readings as they are measured. Whether the real one sends
    /// them so or as one burst is unknown.
    fn send_part_of_turn(&mut self, at: Instant, full: Full) {
        let [a, b, c, d] = full.readings.map(|reading| reading.0);
        let readings = [a, b, c, d].concat();
        if full.index == 0 {
            let [low, high] = full.word.to_le_bytes();
            let header = [0x5A, 0xA5, 0x00, 0xC0, low, high];
            self.uart.push(at, &[&header[..], &readings].concat());
            self.firmware.turn_begun = true;
        } else if self.firmware.turn_begun {
            self.uart.push(at, &readings);
        }
    }
}

/// The same readings full of packet starts: FA and an index as strength, FA as last distance byte.
fn dense(index: u8, readings: [RawReading; 4]) -> [RawReading; 4] {
    let mut degree = 0;
    readings.map(|raw| {
        degree += 1;
        match Reading::from(raw) {
            Reading::Range {
                distance_mm, weak, ..
            } => RawReading::from(Reading::Range {
                distance_mm: distance_mm & 0xFF00 | 0xFA,
                strength: u16::from_le_bytes([0xFA, 0xA0 + (index + degree) % 90]),
                weak,
            }),
            Reading::Invalid { .. } => raw,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Packet 88 ends in the index bytes of the next four packets: F9, and then from A0 on. A
    /// reading that is no range stays.
    #[test]
    fn dense_readings_look_like_packet_starts() {
        let range = RawReading::from(Reading::Range {
            distance_mm: 0x1234,
            strength: 9,
            weak: true,
        });
        let invalid = RawReading([0x21, 0x80, 3, 4]);
        let found = dense(86, [range, invalid, range, range]);
        assert_eq!(found[1], invalid);
        let seen = [found[0], found[2], found[3]].map(|raw| match Reading::from(raw) {
            Reading::Range {
                distance_mm,
                strength,
                weak,
            } => (distance_mm, strength.to_le_bytes(), weak),
            other => panic!("{other:?}"),
        });
        let expected = [0xA0 + 87, 0xA0 + 89, 0xA0].map(|at| (0x12FA, [0xFA, at], true));
        assert_eq!(seen, expected);
    }

    /// A wait for a tooth is over at its time, unless measuring is to continue by itself.
    #[test]
    fn a_wait_without_a_second_edge_is_given_up_at_its_time() {
        use crate::xv11::Config;
        use crate::xv11::firmware::{FreeRun, Resume};
        let at = Instant::from_millis;
        let due = |resume: Option<Instant>, now: Instant| {
            let mut lidar = Xv11::new("lidar", 1, Config::default());
            let run = FreeRun {
                code: code::WAITING,
                from: at(5),
                base: 0,
                tick: 1,
            };
            let pace = Pace {
                edge: at(5),
                first: 3,
                count: 24,
                slot_s: 1e-3,
                angle_deg: 0.0,
                deg_per_s: 1_000.0,
            };
            lidar.firmware.phase = Phase::Slow {
                run,
                resume: resume.map(|at| Resume {
                    at,
                    pace,
                    doubled: false,
                }),
                give_up_at: at(20),
            };
            lidar.give_up_due(now)
        };
        let waits = [19, 20, 21].map(|millis| due(None, at(millis)));
        assert_eq!(waits, [false, true, true]);
        assert!(!due(Some(at(30)), at(21)));
        let lidar = Xv11::new("lidar", 1, Config::default());
        assert!(!lidar.give_up_due(at(9_000)));
    }
}
