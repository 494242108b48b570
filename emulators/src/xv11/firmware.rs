//! What the sensor's processor does: boot, wait, lock on the encoder, measure, lose it again.
//!
//! The behaviour at low speed follows the coast-down at the end of the "hand in box" capture
//! (firmware 2.4); the other generations are taken to do the same.

use core::time::Duration;

use protocols::Instant;
use protocols::xv11::{FRAME_LEN, Frame, RawReading, Reading, SpeedWord};

use super::encoder::{self, Arrival, SECOND_EDGE_DEG, TEETH, TOOTH_DEG, first_slot};
use super::profile::{BOOT_TIME, DOT_TIME, DOTS, PROMPT_TIME};
use super::rotor::{DEG_PER_S, nanos};
use super::scan::{Full, Pace, Scan};
use super::uart::Uart;
use super::{Fault, State, Xv11};
use crate::device::{EventKind, earliest};
use crate::world::World;

/// Codes that the encoder gives; meanings are inferred from where they occur.
mod code {
    pub(super) const SKIPPED: u8 = 0x21;
    pub(super) const WAITING: u8 = 0x22;
    pub(super) const RESYNCHRONISED: u8 = 0x50;
    pub(super) const LOST: u8 = 0x52;
}

/// Readings spoilt after a late tooth.
const RESYNC_READINGS: u8 = 3;
/// Packet after packet without measuring: 45.5 indices per packet time of 1.9097 ms.
const FREE_RUN_TICK: Duration = Duration::from_nanos(41_950);
/// The first tooth slower than this is taken for two: 175.6 rpm was, 183.3 rpm was not.
const DOUBLING_BELOW_RPM: f64 = 180.0;
/// How far the head turns before measuring goes on after a doubled tooth, ...
const DOUBLING_PAUSE_DEG: f64 = 2.35;
/// ... and slots measured until the mistake shows.
const DOUBLING_SLOTS: u16 = 44;
/// A tooth that takes longer than this many of the one before is no longer waited for. A guess.
const WAIT_TEETH: f64 = 1.5;
/// Without a tooth for this long the processor restarts: 311 packets and 7 bytes of the capture
/// after about five packets in the ring.
const RESTART_AFTER: Duration = Duration::from_millis(603);
/// Even teeth in a row before packets are sent: one turn, to find its beginning. A guess.
const GOOD_TEETH: u8 = TEETH;
/// Slowest speed at which that counts. A guess, just above the speed at which doubling begins.
const LOCK_RPM: f64 = 185.0;
/// A head that turns but does not lock makes the processor restart after this. A guess; that it
/// does so for ever is reported twice.
const SPIN_TIME: Duration = Duration::from_secs(2);
/// Speed above which the line cannot take 1980 bytes a turn: 115200 / 10 / 1980 turns a second.
const LINE_RPM: f64 = 349.09;
/// Bytes of the packet on the line that still go out at a restart on command, as in the capture.
const CUT_BYTES: u64 = 7;

const ESC: u8 = 0x1B;

#[derive(Clone, Debug)]
enum Phase {
    Off,
    Boot {
        banner_at: Instant,
    },
    Spin {
        /// Next dot, or the text before them.
        print_at: Option<Instant>,
        dots: u8,
        give_up_at: Instant,
    },
    Locked,
    Slow {
        run: FreeRun,
        resume: Option<Resume>,
        give_up_at: Instant,
    },
    Doubled,
    Lost {
        run: FreeRun,
    },
    Console,
}

/// Packets made without measuring: the loop goes round as fast as it can, and only some of what it
/// makes finds room in the transmitter.
#[derive(Clone, Copy, Debug)]
struct FreeRun {
    code: u8,
    from: Instant,
    /// Packet index at tick 0.
    base: u8,
    tick: u64,
}

/// How measuring goes on after a pause.
#[derive(Clone, Copy, Debug)]
struct Resume {
    at: Instant,
    pace: Pace,
    doubled: bool,
}

/// State of the processor.
#[derive(Clone, Debug)]
pub(super) struct Firmware {
    phase: Phase,
    scan: Scan,
    /// When the last tooth was seen.
    last_edge: Option<Instant>,
    /// How long a tooth takes, as believed.
    tooth_s: f64,
    word: u16,
    good_teeth: u8,
    /// Known end: the processor restarts then.
    restart_at: Option<Instant>,
    /// Whether the 1446-byte frame of firmware 2.1 was begun.
    turn_begun: bool,
    escapes: u8,
    /// Whether late teeth, and a head too fast for the line, were reported since the last lock.
    late_told: bool,
    overspeed_told: bool,
}

impl FreeRun {
    fn at(&self, tick: u64) -> Instant {
        let ticks = u32::try_from(tick).unwrap_or(u32::MAX);
        self.from + FREE_RUN_TICK.saturating_mul(ticks)
    }

    /// The next tick that finds room.
    fn next_tick(&self, uart: &Uart) -> u64 {
        let room = (uart.room_at(FRAME_LEN) - self.from).as_nanos();
        let tick = room.div_ceil(FREE_RUN_TICK.as_nanos());
        u64::try_from(tick).unwrap_or(u64::MAX).max(self.tick)
    }

    fn next_at(&self, uart: &Uart) -> Instant {
        self.at(self.next_tick(uart))
    }

    fn index(&self, tick: u64) -> u8 {
        let index = (u64::from(self.base) + tick) % 90;
        u8::try_from(index).expect("below 90")
    }
}

impl Firmware {
    /// Powered at the beginning of the run.
    pub(super) fn new() -> Self {
        Self {
            phase: Phase::Boot {
                banner_at: Instant::ZERO + BOOT_TIME,
            },
            scan: Scan::new(),
            last_edge: None,
            tooth_s: 0.0,
            word: 0,
            good_teeth: 0,
            restart_at: None,
            turn_begun: false,
            escapes: 0,
            late_told: false,
            overspeed_told: false,
        }
    }

    pub(super) fn state(&self) -> State {
        match self.phase {
            Phase::Off => State::Off,
            Phase::Boot { .. } => State::Boot,
            Phase::Spin { .. } => State::Spin,
            Phase::Locked => State::Locked,
            Phase::Slow { .. } => State::Slow,
            Phase::Doubled => State::Doubled,
            Phase::Lost { .. } => State::Lost,
            Phase::Console => State::Console,
        }
    }

    /// When the processor has something to do by itself.
    pub(super) fn next_at(&self, uart: &Uart) -> Option<Instant> {
        let own = match &self.phase {
            Phase::Off | Phase::Console => None,
            Phase::Boot { banner_at } => Some(*banner_at),
            Phase::Spin {
                print_at,
                give_up_at,
                ..
            } => earliest([*print_at, Some(*give_up_at)]),
            Phase::Locked => self.scan.full_at().or_else(|| self.wait_until()),
            Phase::Doubled => self.scan.full_at().or_else(|| self.scan.end()),
            Phase::Slow {
                run,
                resume,
                give_up_at,
            } => {
                let end = resume.map_or(*give_up_at, |resume| resume.at);
                Some(end.min(run.next_at(uart)))
            }
            Phase::Lost { run } => Some(run.next_at(uart)),
        };
        earliest([own, self.restart_at])
    }

    /// Until when a tooth is waited for.
    fn wait_until(&self) -> Option<Instant> {
        let edge = self.last_edge?;
        Some(edge + nanos(WAIT_TEETH * self.tooth_s))
    }
}

impl Xv11 {
    /// Does what is due at `at`.
    pub(super) fn step(&mut self, at: Instant, world: &World) {
        let cut = self
            .firmware
            .restart_at
            .filter(|&cut| self.edge_at.is_none_or(|edge| edge > cut));
        self.uart.release(at, cut);
        if self.edge_at.is_some_and(|edge| edge <= at) {
            self.tooth_passes(at, world);
        } else if self.firmware.restart_at.is_some_and(|cut| cut <= at) {
            self.restart(at);
        } else if self.firmware.next_at(&self.uart).is_some_and(|n| n <= at) {
            self.work(at, world);
        }
    }

    fn work(&mut self, at: Instant, world: &World) {
        match self.firmware.phase.clone() {
            Phase::Off | Phase::Console => {}
            Phase::Boot { .. } => self.boot(at),
            Phase::Spin { .. } => self.spin(at),
            Phase::Locked if self.firmware.scan.full_at().is_none() => self.lose(at, world),
            Phase::Doubled if self.firmware.scan.full_at().is_none() => self.lose(at, world),
            Phase::Locked | Phase::Doubled => self.measure_until(at, world),
            Phase::Slow { resume, .. } => match resume.filter(|resume| resume.at <= at) {
                Some(resume) => self.resume(resume),
                None if self.give_up_due(at) => self.lose(at, world),
                None => self.free_run(at),
            },
            Phase::Lost { .. } => self.free_run(at),
        }
    }

    pub(super) fn switch_off(&mut self, now: Instant) {
        self.uart.power_off(now);
        self.firmware = Firmware {
            phase: Phase::Off,
            ..Firmware::new()
        };
    }

    pub(super) fn switch_on(&mut self, now: Instant) {
        self.firmware = Firmware {
            phase: Phase::Boot {
                banner_at: now + BOOT_TIME,
            },
            ..Firmware::new()
        };
    }

    fn restart(&mut self, at: Instant) {
        self.uart.reset(at);
        self.switch_on(at);
        self.note(at, "restarted", "the processor restarts".to_owned());
    }

    /// Somebody wants a restart: in the middle of the next packet, or at once if there is none.
    pub(super) fn order_restart(&mut self, now: Instant) {
        match self.firmware.phase {
            Phase::Off => {}
            Phase::Locked | Phase::Slow { .. } | Phase::Doubled | Phase::Lost { .. } => {
                self.faults.set(Fault::Restart);
            }
            Phase::Boot { .. } | Phase::Spin { .. } | Phase::Console => self.restart(now),
        }
    }

    fn boot(&mut self, at: Instant) {
        self.uart.print(at, self.profile.banner());
        let text_at = at + PROMPT_TIME;
        self.firmware.phase = Phase::Spin {
            print_at: Some(text_at),
            dots: 0,
            give_up_at: text_at + SPIN_TIME,
        };
        self.note(at, "booted", "boot text printed".to_owned());
    }

    fn spin(&mut self, at: Instant) {
        let Phase::Spin {
            print_at,
            dots,
            give_up_at,
        } = &mut self.firmware.phase
        else {
            return;
        };
        if let Some(due) = print_at.filter(|&due| due <= at) {
            // The text counts as dot number zero.
            let text = if *dots == 0 {
                self.profile.spin_text()
            } else {
                "."
            };
            self.uart.print(at, text);
            *print_at = (*dots < DOTS).then_some(due + DOT_TIME);
            *dots += 1;
            return;
        }
        // Nothing is said about a head that stands still: only one that turns is given up.
        let turned = self
            .firmware
            .last_edge
            .is_some_and(|edge| at - edge < SPIN_TIME);
        *give_up_at = at + SPIN_TIME;
        if turned || self.faults.has(Fault::EncoderBlind) {
            self.restart(at);
        }
    }

    /// A tooth passes the sensor at `at`, whether or not it is seen.
    fn tooth_passes(&mut self, at: Instant, world: &World) {
        self.rotor.advance(at);
        let normal = self.encoder.draw();
        self.rotor.wander(normal);
        let tooth = self.encoder.tooth();
        let edge_deg = self.rotor.angle_deg();
        if self.encoder.pass() {
            self.rotor.wrap();
        }
        self.plan();
        if self.faults.has(Fault::EncoderBlind) {
            return;
        }
        let took_s = self
            .firmware
            .last_edge
            .replace(at)
            .map(|before| (at - before).as_secs_f64());
        let Some(took_s) = took_s else { return };
        let seen = Tooth {
            at,
            tooth,
            edge_deg,
            took_s,
        };
        match self.firmware.phase {
            Phase::Off | Phase::Boot { .. } | Phase::Console | Phase::Slow { .. } => {}
            Phase::Spin { .. } => self.await_lock(seen),
            Phase::Locked => self.next_tooth(seen, world),
            Phase::Doubled => self.lose(at, world),
            Phase::Lost { .. } => {
                self.firmware.restart_at = Some(at + RESTART_AFTER);
                self.await_lock(seen);
            }
        }
    }

    /// Counts even teeth; after a turn of them packets are sent.
    fn await_lock(&mut self, seen: Tooth) {
        let before = self.firmware.tooth_s;
        let even = (seen.took_s - before).abs() < 0.03 * before;
        self.believe(seen.took_s);
        self.firmware.good_teeth = if even && seen.rpm() >= LOCK_RPM {
            self.firmware.good_teeth + 1
        } else {
            0
        };
        if self.firmware.good_teeth < GOOD_TEETH {
            return;
        }
        self.firmware.good_teeth = 0;
        self.firmware.restart_at = None;
        self.firmware.late_told = false;
        self.firmware.overspeed_told = false;
        self.firmware.phase = Phase::Locked;
        let pace = self.pace(seen, seen.took_s);
        self.firmware.scan.stop();
        self.firmware.scan.follow(pace, 1);
        let detail = format!("locked at {:.1} rpm", seen.rpm());
        self.note(seen.at, "locked", detail);
    }

    /// A tooth while measuring: ends the run of slots before it and begins the next.
    fn next_tooth(&mut self, seen: Tooth, world: &World) {
        let slots = seen.took_s / self.firmware.tooth_s * TOOTH_DEG;
        self.finish_run(seen, slots, world);
        let doubled = self.faults.take(Fault::FalseDoubling) || seen.rpm() < DOUBLING_BELOW_RPM;
        if doubled {
            self.double(seen);
        } else if encoder::arrival(slots) == Arrival::Late {
            self.slow_down(seen);
        } else {
            self.believe(seen.took_s);
            let pace = self.pace(seen, seen.took_s);
            self.firmware.scan.follow(pace, 0);
            self.judge_speed(seen);
        }
    }

    /// Measures what was begun before the tooth came and skips the rest.
    fn finish_run(&mut self, seen: Tooth, slots: f64, world: &World) {
        let Some(pace) = self.firmware.scan.pace else {
            return;
        };
        // Slots are counted from the edge of the tooth; a run after a late one begins later.
        let missed = 24_u16.saturating_sub(pace.count);
        while let Some((slot, due)) = self.firmware.scan.next() {
            if encoder::is_begun(missed + self.firmware.scan.index(), slots) {
                self.measure(slot, due.min(seen.at), pace, world);
            } else {
                self.excuse(due, code::SKIPPED);
            }
        }
    }

    /// The tooth came late: which slot is next is known again at its second edge.
    fn slow_down(&mut self, seen: Tooth) {
        self.believe(seen.took_s);
        let pace = self.pace(seen, seen.took_s);
        let edge_deg = seen.edge_deg + SECOND_EDGE_DEG;
        let resume = self.reaches(edge_deg).map(|at| Resume {
            at,
            pace: Pace {
                edge: at,
                first: pace.first + 5,
                count: pace.count - 5,
                angle_deg: edge_deg,
                ..pace
            },
            doubled: false,
        });
        self.pause(seen, pace, resume);
        if !self.firmware.late_told {
            self.firmware.late_told = true;
            let detail = format!("tooth of {:.1} rpm came late", seen.rpm());
            self.note(seen.at, "tooth-late", detail);
        }
    }

    /// The tooth was taken for two: half its time is believed, and the turn is one tooth ahead.
    fn double(&mut self, seen: Tooth) {
        self.believe(seen.took_s / 2.0);
        let pace = self.pace(seen, seen.took_s / 2.0);
        let edge_deg = seen.edge_deg + DOUBLING_PAUSE_DEG;
        let resume = self.reaches(edge_deg).map(|at| Resume {
            at,
            pace: Pace {
                edge: at,
                first: (pace.first + 24 + 5) % 360,
                count: DOUBLING_SLOTS,
                angle_deg: edge_deg,
                ..pace
            },
            doubled: true,
        });
        self.pause(seen, pace, resume);
        let detail = format!("tooth of {:.1} rpm taken for two", seen.rpm());
        self.note(seen.at, "tooth-doubled", detail);
    }

    fn pause(&mut self, seen: Tooth, pace: Pace, resume: Option<Resume>) {
        self.firmware.scan.follow(pace, 0);
        self.excuse(seen.at, code::WAITING);
        self.firmware.phase = Phase::Slow {
            run: FreeRun {
                code: code::WAITING,
                from: seen.at,
                base: 6 * seen.tooth,
                tick: 1,
            },
            resume,
            give_up_at: seen.at + nanos(WAIT_TEETH * self.firmware.tooth_s),
        };
    }

    fn resume(&mut self, resume: Resume) {
        if self.profile.whole_turns() && !resume.doubled {
            // A frame of 2.1 has a place for every degree: those waited for are filled in.
            while self
                .firmware
                .scan
                .slot()
                .is_some_and(|slot| slot < resume.pace.first)
            {
                self.excuse(resume.at, code::WAITING);
            }
        }
        self.firmware.scan.follow(resume.pace, 0);
        self.firmware.scan.measured = false;
        if resume.doubled {
            self.firmware.phase = Phase::Doubled;
        } else {
            self.firmware.scan.resync = RESYNC_READINGS;
            self.firmware.phase = Phase::Locked;
        }
    }

    /// No tooth, or a wrong one: from now on nothing is known.
    fn lose(&mut self, at: Instant, world: &World) {
        self.measure_until(at, world);
        let slot = self.firmware.scan.slot().unwrap_or(0);
        let base = u8::try_from(slot % 360 / 4).expect("359 / 4 is 89");
        self.firmware.scan.stop();
        self.firmware.good_teeth = 0;
        self.firmware.turn_begun = false;
        self.firmware.phase = Phase::Lost {
            run: FreeRun {
                code: code::LOST,
                from: at,
                base,
                tick: 1,
            },
        };
        let last = self.firmware.last_edge.unwrap_or(at);
        self.firmware.restart_at = Some((last + RESTART_AFTER).max(at));
        self.note(at, "encoder-lost", "sends 0x52 at line rate".to_owned());
    }

    fn give_up_due(&self, at: Instant) -> bool {
        matches!(self.firmware.phase, Phase::Slow { give_up_at, resume: None, .. } if give_up_at <= at)
    }

    /// One packet without measuring.
    fn free_run(&mut self, at: Instant) {
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
    fn measure_until(&mut self, at: Instant, world: &World) {
        let Some(pace) = self.firmware.scan.pace else {
            return;
        };
        while let Some((slot, due)) = self.firmware.scan.next().filter(|&(_, due)| due <= at) {
            self.measure(slot, due, pace, world);
        }
    }

    fn measure(&mut self, slot: u16, due: Instant, pace: Pace, world: &World) {
        let scan = &mut self.firmware.scan;
        if scan.resync > 0 {
            scan.resync -= 1;
            self.excuse(due, code::RESYNCHRONISED);
        } else if pace.is_rushed() && scan.measured {
            self.excuse(due, code::SKIPPED);
        } else {
            let reading = self.eye.measure(world, due, slot, pace.angle_at(due));
            self.store(due, reading);
            self.firmware.scan.measured = true;
        }
    }

    fn excuse(&mut self, at: Instant, code: u8) {
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

    /// Takes a tooth time for true: it gives the speed word and the pace of the next slots.
    fn believe(&mut self, tooth_s: f64) {
        self.firmware.tooth_s = tooth_s;
        if self.faults.has(Fault::FrozenSpeed) {
            return;
        }
        let figure = if self.profile.whole_turns() {
            tooth_s / TOOTH_DEG * 1e8
        } else {
            64.0 * rpm(tooth_s)
        };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a cast of a float saturates, as far as the wire can show"
        )]
        let word = figure.round() as u16;
        self.firmware.word = word;
    }

    fn pace(&self, seen: Tooth, tooth_s: f64) -> Pace {
        let deg_per_s = match self.edge_at {
            Some(next) if next > seen.at => {
                let way = self.encoder.edge_deg() - self.rotor.angle_deg();
                way / (next - seen.at).as_secs_f64()
            }
            _ => self.rotor.speed_rpm() * DEG_PER_S,
        };
        Pace {
            edge: seen.at,
            first: first_slot(seen.tooth),
            count: 24,
            slot_s: tooth_s / TOOTH_DEG,
            angle_deg: seen.edge_deg,
            deg_per_s,
        }
    }

    /// When the head will be at `angle_deg`, which is counted in the turn of the last tooth.
    fn reaches(&self, angle_deg: f64) -> Option<Instant> {
        let turn = if self.encoder.tooth() == 0 {
            360.0
        } else {
            0.0
        };
        self.rotor.reaches(angle_deg - turn)
    }

    fn judge_speed(&mut self, seen: Tooth) {
        if seen.rpm() <= LINE_RPM || self.firmware.overspeed_told {
            return;
        }
        self.firmware.overspeed_told = true;
        let detail = format!("{:.1} rpm; the line takes 349.1", seen.rpm());
        self.event(seen.at, EventKind::Violation, "overspeed", detail);
    }

    pub(super) fn host_bytes(&mut self, now: Instant, bytes: &[u8]) {
        if matches!(self.firmware.phase, Phase::Off | Phase::Console) {
            return;
        }
        for &byte in bytes {
            self.firmware.escapes = if byte == ESC {
                self.firmware.escapes + 1
            } else {
                0
            };
            if self.firmware.escapes == 3 {
                self.open_console(now, "three ESC");
                return;
            }
        }
        if bytes.iter().any(|&byte| byte != ESC) {
            let detail = format!("{} bytes; the sensor takes no request", bytes.len());
            self.event(now, EventKind::Violation, "host-bytes", detail);
            if let Some(event) = self.events.last_mut() {
                event.bytes = bytes.iter().take(64).copied().collect();
            }
        }
    }

    /// The stream ends; what the console answers is not known. Only power ends it.
    pub(super) fn open_console(&mut self, now: Instant, by: &str) {
        if matches!(self.firmware.phase, Phase::Off | Phase::Console) {
            return;
        }
        self.uart.reset(now);
        self.uart.print(now, "\n\r#");
        self.firmware = Firmware {
            phase: Phase::Console,
            ..Firmware::new()
        };
        self.note(now, "console", format!("console opened by {by}"));
    }

    fn note(&mut self, at: Instant, rule: &'static str, detail: String) {
        self.event(at, EventKind::Note, rule, detail);
    }
}

/// A tooth that was seen.
#[derive(Clone, Copy, Debug)]
struct Tooth {
    at: Instant,
    tooth: u8,
    /// Where the head was.
    edge_deg: f64,
    /// Time since the tooth before.
    took_s: f64,
}

impl Tooth {
    fn rpm(self) -> f64 {
        rpm(self.took_s)
    }
}

/// Speed of a head whose teeth take `tooth_s`.
fn rpm(tooth_s: f64) -> f64 {
    60.0 / f64::from(TEETH) / tooth_s
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
