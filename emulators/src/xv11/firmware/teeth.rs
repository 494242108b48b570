//! Effect of an encoder tooth: it ends a run of slots and begins the next, or shows that the head
//! is not where the firmware expected it.

use core::time::Duration;

use protocols::Instant;

use super::output::code;
use super::{FreeRun, Phase, Resume, WAIT_TEETH};
use crate::lidar::rotor::{DEG_PER_S, nanos};
use crate::world::World;
use crate::xv11::encoder::{self, Arrival, SECOND_EDGE_DEG, TEETH, TOOTH_DEG, first_slot};
use crate::xv11::scan::Pace;
use crate::xv11::{Fault, Xv11};

/// Readings spoilt after a late tooth.
const RESYNC_READINGS: u8 = 3;
/// The first tooth slower than this is taken for two: 175.6 rpm was, 183.3 rpm was not.
const DOUBLING_BELOW_RPM: f64 = 180.0;
/// Angle by which the head turns before measuring continues after a doubled tooth.
const DOUBLING_PAUSE_DEG: f64 = 2.35;
/// Number of slots measured after that pause until the mistake shows.
const DOUBLING_SLOTS: u16 = 44;
/// Without a tooth for this long the processor restarts: 311 packets and 7 bytes of the capture
/// after about five packets in the ring.
const RESTART_AFTER: Duration = Duration::from_millis(603);
/// Even teeth in a row before packets are sent: one turn, to find its beginning. A guess.
const GOOD_TEETH: u8 = TEETH;
/// Slowest speed at which that counts. A guess, just above the speed at which doubling begins.
const LOCK_RPM: f64 = 185.0;
/// Speed above which the line cannot take 1980 bytes a turn: 115200 / 10 / 1980 turns a second.
const LINE_RPM: f64 = 349.09;

impl Xv11 {
    /// Handles a tooth that passes the sensor at `at`, detected or not.
    pub(super) fn tooth_passes(&mut self, at: Instant, world: &World) {
        self.rotor.advance(at);
        let normal = self.encoder.draw();
        self.rotor.wander(normal);
        let tooth = self.encoder.tooth();
        let edge_deg = self.rotor.angle_deg();
        let ahead_deg = self.encoder.ahead_deg();
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
            ahead_deg,
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
        self.log.note(seen.at, "locked", detail);
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

    /// Measures the slots begun before the tooth came and skips the rest.
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

    /// Handles a late tooth: the next slot is known again at the tooth's second edge.
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
                angle_deg: edge_deg + seen.ahead_deg,
                ..pace
            },
            doubled: false,
        });
        self.pause(seen, pace, resume);
        if !self.firmware.late_told {
            self.firmware.late_told = true;
            let detail = format!("tooth of {:.1} rpm was late", seen.rpm());
            self.log.note(seen.at, "tooth-late", detail);
        }
    }

    /// Handles a tooth taken for two: the firmware assumes half its time, and the turn is one tooth
    /// ahead.
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
                angle_deg: edge_deg + seen.ahead_deg,
                ..pace
            },
            doubled: true,
        });
        self.pause(seen, pace, resume);
        let detail = format!("tooth of {:.1} rpm taken for two", seen.rpm());
        self.log.note(seen.at, "tooth-doubled", detail);
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

    pub(super) fn resume(&mut self, resume: Resume) {
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

    /// Loses synchronisation, after a missing or a wrong tooth.
    pub(super) fn lose(&mut self, at: Instant, world: &World) {
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
        self.log
            .note(at, "encoder-lost", "sends 0x52 at line rate".to_owned());
    }

    /// Accepts a tooth time: it gives the speed word and the pace of the next slots.
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
                let turned = self.encoder.edge_deg() - self.rotor.angle_deg();
                let way = turned + self.encoder.ahead_deg() - seen.ahead_deg;
                way / (next - seen.at).as_secs_f64()
            }
            _ => self.rotor.speed_rpm() * DEG_PER_S,
        };
        Pace {
            edge: seen.at,
            first: first_slot(seen.tooth),
            count: 24,
            slot_s: tooth_s / TOOTH_DEG,
            angle_deg: seen.edge_deg + seen.ahead_deg,
            deg_per_s,
        }
    }

    /// Time at which the head reaches `angle_deg`, counted in the turn of the last tooth.
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
        let detail = format!(
            "{:.1} rpm; the line can carry packets up to 349.1 rpm",
            seen.rpm()
        );
        self.log.violation(seen.at, "overspeed", detail, &[]);
    }
}

/// A tooth that was seen.
#[derive(Clone, Copy, Debug)]
struct Tooth {
    at: Instant,
    tooth: u8,
    /// Angle of the motor's shaft, as the rotor counts it.
    edge_deg: f64,
    /// Angle by which belt and gear have the head ahead of the shaft.
    ahead_deg: f64,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::{BodyConfig, Pose, Scene, Shape};
    use crate::xv11::{Config, Detail, MotorSupply};

    /// A sensor that has been turning for five seconds, and a tooth of it.
    fn turning(tooth: u8, took_s: f64) -> (Xv11, Tooth) {
        let scene = Scene::new::<Shape>([], vec![]).expect("empty");
        let body = BodyConfig::default();
        let mut world = World::new(scene, body, Pose::default(), 1).expect("free");
        let config = Config {
            supply: MotorSupply::Fixed { volts: 3.3 },
            ..Config::default()
        };
        let mut lidar = Xv11::new("lidar", 1, config);
        let mut now = Instant::ZERO;
        while now < Instant::from_secs(5) {
            now = crate::device::Device::poll_at(&lidar).expect("it turns");
            crate::device::Device::poll(&mut lidar, now, &mut world);
        }
        let seen = Tooth {
            at: now,
            tooth,
            edge_deg: lidar.rotor.angle_deg(),
            ahead_deg: 0.0,
            took_s,
        };
        (lidar, seen)
    }

    fn resumed(lidar: &Xv11) -> Pace {
        match lidar.firmware.phase {
            Phase::Slow {
                resume: Some(resume),
                ..
            } => resume.pace,
            _ => panic!("it waits for nothing"),
        }
    }

    /// 24 slots a tooth; measuring continues in the fifth of the tooth after the next, also across
    /// the end of the turn. Half of 1/75 s is 600 rpm.
    #[test]
    fn a_doubled_tooth_leaves_the_turn_one_tooth_ahead() {
        let first = [0, 7, 13, 14].map(|tooth| {
            let (mut lidar, seen) = turning(tooth, 1.0 / 75.0);
            lidar.double(seen);
            assert_eq!(
                (lidar.firmware.word, resumed(&lidar).count),
                (600 * 64, DOUBLING_SLOTS)
            );
            let from = first_slot(tooth);
            (resumed(&lidar).first, from)
        });
        for (first, from) in first {
            assert_eq!(first, (from + 29) % 360);
        }
    }

    /// The scan keeps its angle while the speed wanders. Over 1,000 teeth, the head is at the angle
    /// of each tooth's edge, within five deviations of the edge's jitter of 0.0022 degrees. The
    /// motor's shaft is not, because belt and gear advance the head.
    #[test]
    fn f8_teeth_stay_in_place_while_the_speed_wanders() {
        let scene = Scene::new::<Shape>([], vec![]).expect("empty");
        let body = BodyConfig::default();
        let mut world = World::new(scene, body, Pose::default(), 1).expect("free");
        let config = Config {
            supply: MotorSupply::Fixed { volts: 3.3 },
            detail: Detail::Captured,
            ..Config::default()
        };
        let mut lidar = Xv11::new("lidar", 1, config);
        let mut edges = vec![Vec::new(); usize::from(TEETH)];
        let (mut teeth, mut last, mut now) = (0, None, Instant::ZERO);
        // 1,000 teeth take 14 s.
        while teeth < 1_000 && now < Instant::from_secs(30) {
            let ahead_deg = lidar.encoder.ahead_deg();
            now = crate::device::Device::poll_at(&lidar).expect("it turns");
            crate::device::Device::poll(&mut lidar, now, &mut world);
            crate::device::Device::transmit(&mut lidar, Xv11::UART, &mut [0; 1024]);
            let pace = lidar.firmware.scan.pace;
            if let Some(pace) = pace.filter(|pace| last.replace(pace.edge) != Some(pace.edge)) {
                let head_deg = pace.angle_deg - f64::from(pace.first);
                edges[usize::from(pace.first / 24)].push((head_deg, head_deg - ahead_deg));
                teeth += 1;
            }
        }
        let spread = |of: fn(&(f64, f64)) -> f64| {
            let widths = edges.iter().map(|edges| {
                let (low, high) = edges
                    .iter()
                    .map(of)
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), deg| {
                        (low.min(deg), high.max(deg))
                    });
                high - low
            });
            widths.fold(0.0, f64::max)
        };
        let [head, shaft] = [|edge: &(f64, f64)| edge.0, |edge: &(f64, f64)| edge.1].map(spread);
        let limit = 2.0 * 5.0 * 0.0022;
        assert_eq!(teeth, 1_000);
        assert!(head < limit && shaft > limit, "{head} {shaft}");
    }

    /// Five of the 24 slots are over when its second edge comes, 19 are left; 1/75 s is 300 rpm.
    #[test]
    fn a_late_tooth_costs_five_slots() {
        let (mut lidar, seen) = turning(3, 1.0 / 75.0);
        lidar.slow_down(seen);
        let pace = resumed(&lidar);
        assert_eq!((pace.first, pace.count), (first_slot(3) + 5, 19));
        assert_eq!(lidar.firmware.word, 300 * 64);
        assert!((pace.angle_deg - seen.edge_deg - SECOND_EDGE_DEG).abs() < 1e-12);
    }

    /// Fifteen teeth a turn.
    #[test]
    fn a_tooth_tells_the_speed() {
        assert!((rpm(1.0 / 75.0) - 300.0).abs() < 1e-9 && (rpm(0.02) - 200.0).abs() < 1e-9);
    }

    /// A tooth is uneven if it differs by 3 % from the tooth before. A tooth of 100 / 8192 s is
    /// 327.7 rpm, and 3 / 8192 s are exactly 3 % of it. A tooth slower than 185 rpm, longer than 4
    /// / 185 s, does not count.
    #[test]
    fn a_tooth_counts_if_it_is_even_and_not_slow() {
        let part = |of_8192: f64| of_8192 / 8192.0;
        let slow_s = 4.0 / LOCK_RPM;
        for (before_s, took_s, counts) in [
            (part(100.0), part(100.0), true),
            (part(100.0), part(102.9), true),
            (part(100.0), part(97.1), true),
            (part(100.0), part(103.0), false),
            (part(100.0), part(97.0), false),
            (slow_s, 0.999 * slow_s, true),
            (slow_s, 1.001 * slow_s, false),
        ] {
            let (mut lidar, seen) = turning(3, took_s);
            (lidar.firmware.tooth_s, lidar.firmware.good_teeth) = (before_s, 4);
            lidar.await_lock(seen);
            let expected = if counts { 5 } else { 0 };
            assert_eq!(lidar.firmware.good_teeth, expected, "{before_s} {took_s}");
        }
    }

    /// The fifteenth even tooth in a row locks, none before it, and counting begins again.
    #[test]
    fn a_turn_of_even_teeth_locks() {
        let (mut lidar, seen) = turning(3, 1.0 / 75.0);
        lidar.firmware.phase = Phase::Spin {
            print_at: None,
            dots: 0,
            give_up_at: Instant::from_secs(99),
        };
        (lidar.firmware.tooth_s, lidar.firmware.good_teeth) = (seen.took_s, 0);
        for _ in 0..14 {
            lidar.await_lock(seen);
            assert!(matches!(lidar.firmware.phase, Phase::Spin { .. }));
        }
        lidar.await_lock(seen);
        assert!(matches!(lidar.firmware.phase, Phase::Locked));
        assert_eq!(lidar.firmware.good_teeth, 0);
    }

    /// While the next tooth is not known, the head turns by six degrees a second for each rpm; else
    /// by the rest of the way to that tooth. 1 / 75 s are 24 slots of 0.5556 ms.
    #[test]
    fn a_pace_has_the_speed_of_the_head() {
        let (mut lidar, seen) = turning(3, 1.0 / 75.0);
        lidar.edge_at = None;
        let pace = lidar.pace(seen, seen.took_s);
        let deg_per_s = lidar.rotor.speed_rpm() * 6.0;
        assert!((pace.deg_per_s - deg_per_s).abs() < 1e-9 && deg_per_s > 1_000.0);
        assert!((pace.slot_s - 1.0 / 75.0 / 24.0).abs() < 1e-12);
        assert_eq!((pace.first, pace.count, pace.edge), (75, 24, seen.at));
        let missing = lidar.encoder.edge_deg() + lidar.encoder.ahead_deg();
        let missing = missing - lidar.rotor.angle_deg();
        lidar.edge_at = Some(seen.at + Duration::from_millis(10));
        let ahead = Tooth {
            ahead_deg: 0.5,
            edge_deg: 7.0,
            ..seen
        };
        let pace = lidar.pace(ahead, seen.took_s);
        assert!((pace.deg_per_s - (missing - 0.5) * 100.0).abs() < 1e-6);
        assert_eq!(pace.angle_deg, 7.5);
    }

    /// A wait sends code 0x22 from the tooth's packet on: 24 degrees are six packets. It ends after
    /// one and a half teeth. A loss continues with the packet of the next slot and restarts 603 ms
    /// behind the last tooth.
    #[test]
    fn a_wait_and_a_loss_begin_at_their_packets() {
        let (mut lidar, seen) = turning(3, 1.0 / 75.0);
        lidar.slow_down(seen);
        let Phase::Slow {
            run, give_up_at, ..
        } = lidar.firmware.phase
        else {
            panic!("it waits");
        };
        assert_eq!((run.code, run.from, run.base), (code::WAITING, seen.at, 18));
        let waits = (give_up_at - seen.at).as_nanos();
        assert!(waits.abs_diff(20_000_000) <= 1, "{waits}");

        let scene = Scene::new::<Shape>([], vec![]).expect("empty");
        let world = World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free");
        let (mut lidar, seen) = turning(3, 1.0 / 75.0);
        let pace = Pace {
            first: 250,
            edge: seen.at,
            ..lidar.pace(seen, seen.took_s)
        };
        lidar.firmware.scan.follow(pace, 7);
        lidar.firmware.last_edge = Some(seen.at);
        lidar.firmware.good_teeth = 4;
        lidar.lose(seen.at, &world);
        let Phase::Lost { run } = lidar.firmware.phase else {
            panic!("it is lost");
        };
        // Slot 257 lies in packet 64.
        assert_eq!((run.code, run.from, run.base), (code::LOST, seen.at, 64));
        assert_eq!(lidar.firmware.good_teeth, 0);
        let restart_at = lidar.firmware.restart_at.expect("it restarts");
        assert_eq!((restart_at - seen.at).as_micros(), 603_000);
    }

    /// Five degrees behind the last tooth seen, at the end of a turn as within it: at some 280 rpm
    /// they take 3 ms. Behind the last tooth of a turn the head's angle has begun anew.
    #[test]
    fn a_place_behind_a_tooth_is_reached_soon_in_each_part_of_a_turn() {
        let scene = Scene::new::<Shape>([], vec![]).expect("empty");
        let body = BodyConfig::default();
        let mut world = World::new(scene, body, Pose::default(), 1).expect("free");
        let (mut lidar, _) = turning(3, 1.0 / 75.0);
        let mut seen = [false; 2];
        for _ in 0..2_000 {
            let now = crate::device::Device::poll_at(&lidar).expect("it turns");
            let before = lidar.encoder.tooth();
            crate::device::Device::poll(&mut lidar, now, &mut world);
            if lidar.encoder.tooth() == before {
                continue;
            }
            let is_last = lidar.encoder.tooth() == 0;
            let turn_deg = if is_last { 360.0 } else { 0.0 };
            let at = lidar.reaches(lidar.rotor.angle_deg() + turn_deg + 5.0);
            let after_s = (at.expect("it turns") - now).as_secs_f64();
            let expected_s = 5.0 / (lidar.rotor.speed_rpm() * 6.0);
            assert!(
                (after_s / expected_s - 1.0).abs() < 0.05,
                "{after_s} {expected_s}"
            );
            seen[usize::from(is_last)] = true;
        }
        assert_eq!(seen, [true; 2]);
    }
}
