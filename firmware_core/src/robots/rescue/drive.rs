use core::time::Duration;

use protocols::Instant;
use protocols::avr::registers;

use crate::base_link::{BaseLink, Completion, Outcome, READ_MAX, Request};
use crate::gyro::{Gyro, Wheels};
use crate::navigation::{HALT, Sought};
use crate::odometry::Odometry;

use super::blind;
use super::config::{Config, Infrared, TICK_MM_S, Turning};

/// Encoders and measured speeds: ten registers in one answer, so that they belong together.
const WHEELS: Request = Request::read(registers::ENCODER_LEFT, 10);
/// Both thermometers, and the floor sensor that lies between them.
const HEAT: Request = Request::read(registers::HEAT_LEFT, 6);
/// One rescue kit.
const KIT: Request = Request::write(registers::KITS, [1]);
/// The infrared sensors, and others that lie between them; in two reads.
const INFRARED: [Request; 2] = [
    Request::read(registers::DIST_BACK_RIGHT, 12),
    Request::read(registers::DIST_FRONT_LEFT, 12),
];
/// Where in each read its sensors are.
const INFRARED_AT: [&[usize]; 2] = [&[0, 2, 4, 6, 8, 10], &[0, 2, 8, 10]];
const BATTERY: Request = Request::read(registers::BATTERY_MV, 3);
/// The sum of the gyroscope.
const YAW: Request = Request::read(registers::YAW, 4);

/// The base measures its speeds every 40 ms.
const WHEELS_PERIOD: Duration = Duration::from_millis(40);
/// The base reads its thermometers every 50 ms.
const HEAT_PERIOD: Duration = Duration::from_millis(100);
/// The base measures with a third of its infrared sensors every 50 ms.
const INFRARED_PERIOD: Duration = Duration::from_millis(100);
const BATTERY_PERIOD: Duration = Duration::from_secs(1);
/// Longest time between two writes of the set-points. The base stops by itself after a second.
const REFRESH: Duration = Duration::from_millis(150);
/// How often a silent base is asked whether it is back.
const PROBE_PERIOD: Duration = Duration::from_millis(100);

/// Bit of the status: the motors are off.
const MOTORS_OFF: u8 = 2;
/// A sum of the gyroscope that is older than this does not belong to the wheels' reading.
const YAW_AGE_MAX: Duration = Duration::from_millis(10);

/// Motor driver active.
const ACTIVE: u8 = 0;

/// Battery as the base reports it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Battery {
    /// Voltage.
    pub millivolts: u16,
    /// Charge; the fielded base reports the least value it has seen.
    pub percent: i8,
}

impl Battery {
    /// Nothing in it, as far as is known.
    const EMPTY: Self = Self {
        millivolts: 0,
        percent: 0,
    };
}

/// What the robot wants of its base and knows of it.
#[derive(Clone, Debug)]
pub(super) struct Drive {
    link: BaseLink,
    pub(super) odometry: Odometry,
    set_point: [i8; 2],
    /// From then on the set-point is nobody's wish any more.
    valid_until: Instant,
    /// The base has acknowledged the set-point.
    is_confirmed: bool,
    written_at: Instant,
    wheels_at: Instant,
    battery_at: Instant,
    /// `None` if there are no thermometers.
    heat_at: Option<Instant>,
    heat: Option<[i16; 2]>,
    /// `None` if the infrared sensors are not read.
    infrared_at: Option<Instant>,
    /// Their readings, mm, and whether both halves were read since somebody asked last.
    infrared: [i16; blind::SENSORS],
    is_infrared_new: bool,
    /// Kits that are still to be dropped.
    kits: u8,
    probe_at: Instant,
    was_silent: bool,
    speed: [i8; 2],
    battery: Option<Battery>,
    /// It was read since somebody asked last.
    is_battery_new: bool,
    gyro: Option<Gyro>,
    /// The sum of the gyroscope, read right before the wheels.
    yaw: Option<(Instant, i32)>,
    counters: [i32; 2],
    defects: super::Defects,
    /// Nothing is said to the base (field defect NV-04).
    pub(super) is_mute: bool,
    /// Set-points that ran out because nobody renewed them.
    pub(super) expired: u32,
    pub(super) silences: u32,
}

impl Drive {
    pub(super) const fn new(config: &Config) -> Self {
        Self {
            link: BaseLink::with_defects(
                config.checksum_order,
                config.reply_timeout,
                config.defects.base,
            ),
            odometry: Odometry::with_defects(config.wheels, config.defects.odometry),
            set_point: HALT,
            valid_until: Instant::ZERO,
            is_confirmed: false,
            written_at: Instant::ZERO,
            wheels_at: Instant::ZERO,
            battery_at: Instant::ZERO,
            heat_at: match config.sought {
                Sought::Floor => None,
                Sought::FloorAndHeat => Some(Instant::ZERO),
            },
            heat: None,
            infrared_at: match config.infrared {
                Infrared::Unread => None,
                Infrared::Read => Some(Instant::ZERO),
            },
            infrared: [i16::MAX; blind::SENSORS],
            is_infrared_new: false,
            kits: 0,
            probe_at: Instant::ZERO,
            was_silent: false,
            speed: HALT,
            battery: if config.defects.own.assumes_empty_battery {
                Some(Battery::EMPTY)
            } else {
                None
            },
            is_battery_new: false,
            gyro: match config.turning {
                Turning::Wheels => None,
                Turning::Gyroscope => Some(Gyro::new()),
            },
            yaw: None,
            counters: [0; 2],
            defects: config.defects,
            is_mute: false,
            expired: 0,
            silences: 0,
        }
    }

    /// Sets the wheels' speeds until `valid_until`, then they stop.
    pub(super) fn command(&mut self, now: Instant, set_point: [i8; 2], valid_until: Instant) {
        self.valid_until = valid_until;
        if set_point != self.set_point {
            self.set_point = set_point;
            self.is_confirmed = false;
            if !self.link.is_silent() && !self.is_mute {
                self.write(now);
            }
        }
    }

    /// Asks for the wheels now rather than when it is due.
    pub(super) fn read_wheels(&mut self, now: Instant) {
        if !self.link.is_silent() && !self.is_mute {
            self.wheels_at = now + WHEELS_PERIOD;
            if self.gyro.is_some() {
                self.link.submit(now, YAW);
            }
            self.link.submit(now, WHEELS);
        }
    }

    pub(super) fn receive(&mut self, now: Instant, bytes: &[u8]) {
        self.link.receive(now, bytes);
        self.take_completions();
    }

    pub(super) fn transmit(&mut self, buf: &mut [u8]) -> usize {
        self.link.transmit(buf)
    }

    pub(super) fn tick(&mut self, now: Instant) {
        if self.is_mute {
            return;
        }
        self.link.tick(now);
        self.take_completions();
        if now >= self.valid_until && self.set_point != HALT {
            self.expired = self.expired.saturating_add(1);
            self.command(now, HALT, now);
        }
        if self.link.is_silent() {
            self.probe(now);
            return;
        }
        if now - self.written_at >= REFRESH {
            self.write(now);
        }
        if now >= self.wheels_at {
            self.read_wheels(now);
        }
        if now >= self.battery_at {
            self.battery_at = now + BATTERY_PERIOD;
            self.link.submit(now, BATTERY);
        }
        if self.heat_at.is_some_and(|at| now >= at) {
            self.heat_at = Some(now + HEAT_PERIOD);
            self.link.submit(now, HEAT);
            if self.kits > 0 {
                self.link.submit(now, KIT);
            }
        }
        if self.infrared_at.is_some_and(|at| now >= at) {
            self.infrared_at = Some(now + INFRARED_PERIOD);
            for request in INFRARED {
                self.link.submit(now, request);
            }
        }
    }

    pub(super) fn next_at(&self) -> Instant {
        if self.is_mute {
            return FAR;
        }
        let link = self.link.next_at().unwrap_or(FAR);
        if self.link.is_silent() {
            return link.min(self.probe_at);
        }
        let expiry = if self.set_point == HALT {
            FAR
        } else {
            self.valid_until
        };
        let refresh = self.written_at + REFRESH;
        link.min(expiry)
            .min(refresh)
            .min(self.wheels_at)
            .min(self.battery_at)
            .min(self.heat_at.unwrap_or(FAR))
            .min(self.infrared_at.unwrap_or(FAR))
    }

    /// The newest reading of the thermometers, left and right, tenths of a degree, once.
    pub(super) const fn take_heat(&mut self) -> Option<[i16; 2]> {
        self.heat.take()
    }

    /// The newest readings of the infrared sensors, mm, once.
    pub(super) fn take_infrared(&mut self) -> Option<[i16; blind::SENSORS]> {
        core::mem::take(&mut self.is_infrared_new).then_some(self.infrared)
    }

    /// A new reading of the battery, once.
    pub(super) fn take_battery(&mut self) -> Option<Battery> {
        let is_new = core::mem::take(&mut self.is_battery_new);
        self.battery.filter(|_| is_new)
    }

    /// Whether the stop button holds the motors, if the base has told since the last call.
    pub(super) fn take_stop(&mut self) -> Option<bool> {
        self.link
            .take_status()
            .map(|status| status & MOTORS_OFF != 0)
    }

    /// A kit is to be dropped; again and again until the base has said that it is.
    pub(super) const fn drop_kit(&mut self) {
        self.kits = self.kits.saturating_add(1);
    }

    pub(super) const fn is_silent(&self) -> bool {
        self.link.is_silent()
    }

    pub(super) const fn link(&self) -> &BaseLink {
        &self.link
    }

    pub(super) const fn set_point(&self) -> [i8; 2] {
        self.set_point
    }

    pub(super) const fn is_confirmed(&self) -> bool {
        self.is_confirmed
    }

    /// Measured speeds, ticks per 40 ms.
    pub(super) const fn speed(&self) -> [i8; 2] {
        self.speed
    }

    /// Measured speeds; 20 ticks per 40 ms are 227 mm/s (field defect MA-10 called them 2).
    pub(super) fn speed_mm_s(&self) -> [i16; 2] {
        self.speed.map(|ticks| {
            #[expect(clippy::cast_possible_truncation, reason = "at most 128 * 11.4")]
            let speed = if self.defects.own.speaks_tenths {
                (f32::from(ticks) * TICK_MM_S / 100.0) as i16
            } else {
                libm::roundf(f32::from(ticks) * TICK_MM_S) as i16
            };
            speed
        })
    }

    pub(super) const fn battery(&self) -> Option<Battery> {
        self.battery
    }

    fn write(&mut self, now: Instant) {
        self.written_at = now;
        let [left, right] = self.set_point.map(i8::cast_unsigned);
        self.link.submit(
            now,
            Request::write(registers::SPEED_LEFT_TO, [left, right, ACTIVE]),
        );
    }

    /// Nothing is commanded to a base that does not answer but to stand still: it may be that only
    /// its answers get lost.
    fn probe(&mut self, now: Instant) {
        if !self.was_silent {
            self.was_silent = true;
            self.silences = self.silences.saturating_add(1);
            self.speed = HALT;
        }
        self.set_point = HALT;
        self.is_confirmed = false;
        if now >= self.probe_at {
            self.probe_at = now + PROBE_PERIOD;
            self.write(now);
            self.link.submit(now, WHEELS);
        }
    }

    fn take_completions(&mut self) {
        while let Some(done) = self.link.take_completion() {
            if self.was_silent && done.outcome != Outcome::Failed {
                // It may have been restarted, and its counters with it.
                self.was_silent = false;
                self.odometry.resume();
            }
            self.apply(&done);
        }
    }

    fn apply(&mut self, done: &Completion) {
        match done.outcome {
            Outcome::Data(data) if done.request == WHEELS => self.wheels_read(done.at, &data),
            Outcome::Data(data) if done.request == HEAT => {
                let value = |at: usize| i16::from_le_bytes([data[at], data[at + 1]]);
                self.heat = Some([value(0), value(4)]);
            }
            Outcome::Data(data) if done.request == YAW => {
                let sum = i32::from_le_bytes([data[0], data[1], data[2], data[3]]);
                self.yaw = Some((done.at, sum));
            }
            Outcome::Data(data) if done.request == INFRARED[0] => self.infrared_read(0, &data),
            Outcome::Data(data) if done.request == INFRARED[1] => self.infrared_read(1, &data),
            Outcome::Written if done.request == KIT => self.kits = self.kits.saturating_sub(1),
            Outcome::Data(data) => {
                self.is_battery_new = true;
                self.battery = Some(Battery {
                    millivolts: u16::from_le_bytes([data[0], data[1]]),
                    percent: data[2].cast_signed(),
                });
            }
            Outcome::Written => {
                let [left, right] = self.set_point.map(i8::cast_unsigned);
                let wanted = Request::write(registers::SPEED_LEFT_TO, [left, right, ACTIVE]);
                self.is_confirmed = done.request == wanted;
            }
            // A lost write must not wait for its refresh; a lost read comes again by itself.
            Outcome::Failed if done.request.is_write() => self.written_at = Instant::ZERO,
            Outcome::Failed => {}
        }
    }

    fn infrared_read(&mut self, half: usize, data: &[u8; READ_MAX]) {
        let first = if half == 0 { 0 } else { INFRARED_AT[0].len() };
        for (reading, &at) in self.infrared[first..].iter_mut().zip(INFRARED_AT[half]) {
            *reading = i16::from_le_bytes([data[at], data[at + 1]]);
        }
        self.is_infrared_new = half == 1;
    }

    fn wheels_read(&mut self, at: Instant, data: &[u8; READ_MAX]) {
        let counter = |from: usize| {
            i32::from_le_bytes([data[from], data[from + 1], data[from + 2], data[from + 3]])
        };
        let counters = [counter(0), counter(4)];
        let turn = self.turned(at, counters);
        self.odometry.update_turning(at, counters, turn);
        self.speed = [data[8].cast_signed(), data[9].cast_signed()];
    }

    /// How far the robot has turned by its gyroscope since the wheels' reading before.
    fn turned(&mut self, at: Instant, counters: [i32; 2]) -> Option<f32> {
        let before = core::mem::replace(&mut self.counters, counters);
        let gyro = self.gyro.as_mut()?;
        let Some((read_at, sum)) = self
            .yaw
            .take()
            .filter(|(read, _)| at - *read <= YAW_AGE_MAX)
        else {
            gyro.forget();
            return None;
        };
        let wheels = match counters == before {
            true => Wheels::AtRest,
            false => Wheels::Turned,
        };
        gyro.turned(read_at, sum, wheels)
    }
}

const FAR: Instant = Instant::from_nanos(u64::MAX);
