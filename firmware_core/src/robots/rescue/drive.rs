use core::time::Duration;

use protocols::Instant;
use protocols::avr::registers;

use crate::base_link::{BaseLink, Completion, Outcome, READ_MAX, Request};
use crate::gyro::{Gyro, Wheels};
use crate::navigation::{HALT, Sought};
use crate::odometry::Odometry;

use super::blind;
use super::config::{Config, Infrared, TICK_MM_S, Turning};
use super::kits::Kits;
use super::stall::Stall;

/// Encoders and measured speeds: ten registers in one answer, so that they are from the same time.
const WHEELS: Request = Request::read(registers::ENCODER_LEFT, 10);
/// Both thermometers, and the floor sensor between them.
const HEAT: Request = Request::read(registers::HEAT_LEFT, 6);
/// Number of dropped rescue kits.
const KITS: Request = Request::read(registers::KITS, 1);
/// The infrared sensors, and others between them; in two reads.
const INFRARED: [Request; 2] = [
    Request::read(registers::DIST_BACK_RIGHT, 12),
    Request::read(registers::DIST_FRONT_LEFT, 12),
];
/// Offsets of the sensors in each read.
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
/// Interval of the requests that test whether a silent base is back.
const PROBE_PERIOD: Duration = Duration::from_millis(100);

/// Bit of the status: the motors are off.
const MOTORS_OFF: u8 = 2;
/// Maximum age of the gyroscope's sum at the wheels' reading.
const YAW_AGE_MAX: Duration = Duration::from_millis(10);

/// Motor driver active.
const ACTIVE: u8 = 0;

/// Battery as the base reports it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Battery {
    /// Voltage.
    pub millivolts: u16,
    /// Charge; the fielded base reports the lowest value so far.
    pub percent: i8,
}

impl Battery {
    /// An empty battery, as assumed before the first report.
    const EMPTY: Self = Self {
        millivolts: 0,
        percent: 0,
    };
}

/// Orders for the base, and its last readings.
#[derive(Clone, Debug)]
pub(super) struct Drive {
    link: BaseLink,
    pub(super) odometry: Odometry,
    set_point: [i8; 2],
    /// The set-point expires at this time.
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
    /// Readings of the sensors, mm, and whether both halves were read since the last query.
    infrared: [i16; blind::SENSORS],
    is_infrared_new: bool,
    kits: Kits,
    probe_at: Instant,
    was_silent: bool,
    speed: [i8; 2],
    battery: Option<Battery>,
    /// The battery was read since the last query.
    is_battery_new: bool,
    gyro: Option<Gyro>,
    /// The sum of the gyroscope, read right before the wheels.
    yaw: Option<(Instant, i32)>,
    counters: [i32; 2],
    pub(super) stall: Stall,
    defects: super::Defects,
    /// The program sends the base nothing (field defect NV-04).
    pub(super) is_mute: bool,
    /// Set-points that expired because they were not renewed.
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
            kits: Kits::NONE,
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
            stall: Stall::NEW,
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

    /// Requests the wheels now, before the request is due.
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

    pub(super) const fn has_output(&self) -> bool {
        self.link.has_output()
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
        self.stall.tick(now);
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
            if self.kits.is_waiting() {
                self.link.submit(now, KITS);
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

    /// The newest reading of the thermometers, left and right, tenths of a degree; returned once.
    pub(super) const fn take_heat(&mut self) -> Option<[i16; 2]> {
        self.heat.take()
    }

    /// The last readings of the infrared sensors, mm; [`i16::MAX`] before the first.
    pub(super) const fn infrared(&self) -> [i16; blind::SENSORS] {
        self.infrared
    }

    /// The newest readings of the infrared sensors, mm; returned once.
    pub(super) fn take_infrared(&mut self) -> Option<[i16; blind::SENSORS]> {
        core::mem::take(&mut self.is_infrared_new).then_some(self.infrared)
    }

    /// A new reading of the battery; returned once.
    pub(super) fn take_battery(&mut self) -> Option<Battery> {
        let is_new = core::mem::take(&mut self.is_battery_new);
        self.battery.filter(|_| is_new)
    }

    /// State of the stop button, if the base has reported it since the last call.
    pub(super) fn take_stop(&mut self) -> Option<bool> {
        self.link
            .take_status()
            .map(|status| status & MOTORS_OFF != 0)
    }

    /// Orders one more kit; the order is repeated until the base has dropped it.
    pub(super) fn drop_kit(&mut self) {
        self.kits.add();
    }

    pub(super) const fn is_silent(&self) -> bool {
        self.link.is_silent()
    }

    /// Whether a driven wheel does not count: the robot must rest.
    pub(super) const fn is_stalled(&self) -> bool {
        self.stall.is_stalled()
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

    /// Sends a silent base only the order to stop, because perhaps only its answers are lost.
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
                // The base may have been restarted, and its counters with it.
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
            Outcome::Data(data) if done.request == KITS => {
                if let Some(target) = self.kits.counted(data[0]) {
                    self.link
                        .submit(done.at, Request::write(registers::KITS, [target]));
                }
            }
            Outcome::Written if done.request.register() == registers::KITS => {}
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
            // A lost write must not wait for its refresh; a lost read is repeated anyway.
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
        let driven = if self.is_confirmed {
            self.set_point
        } else {
            HALT
        };
        self.stall.take(at, counters, driven);
        let turn = self.turned(at, counters);
        self.odometry.update_turning(at, counters, turn);
        self.speed = [data[8].cast_signed(), data[9].cast_signed()];
    }

    /// Turn of the robot by its gyroscope since the previous wheels' reading.
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

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec;
    use std::vec::Vec;

    use protocols::Decode as _;
    use protocols::avr::{self, Frame};

    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    fn fitted() -> Config {
        Config {
            sought: Sought::FloorAndHeat,
            infrared: Infrared::Read,
            ..Config::default()
        }
    }

    /// Answer of a base with registers that all hold their own number.
    fn answer(frame: &Frame) -> Option<Frame> {
        let order = Config::default().checksum_order;
        let registers: Vec<u8> = (frame.register()..)
            .take(usize::from(frame.count()))
            .collect();
        Some(match frame.is_write() {
            true => Frame::read(frame.register(), 0, order),
            false => Frame::write(frame.register(), &registers, order),
        })
    }

    /// Requests from `from` up to `to` ms, each answered at once: time, register, whether it was a
    /// write.
    fn run(
        drive: &mut Drive,
        [from, to]: [u64; 2],
        answer: impl Fn(&Frame) -> Option<Frame>,
    ) -> Vec<(u64, u8, bool)> {
        let mut decoder = avr::Decoder::new(Config::default().checksum_order);
        let mut asked = Vec::new();
        for millis in from..to {
            drive.tick(at(millis));
            let mut buf = [0; 64];
            while let len @ 1.. = drive.transmit(&mut buf) {
                let frames: Vec<Frame> = decoder.push(&buf[..len]).flatten().collect();
                for frame in frames {
                    asked.push((millis, frame.register(), frame.is_write()));
                    if let Some(answer) = answer(&frame) {
                        drive.receive(at(millis), answer.as_bytes());
                    }
                }
            }
        }
        asked
    }

    fn times(asked: &[(u64, u8, bool)], register: u8) -> Vec<u64> {
        let of = asked.iter().filter(|it| it.1 == register);
        of.map(|it| it.0).collect()
    }

    /// Wheels each 40 ms, set-points each 150, the battery each second; heat and infrared sensors
    /// each 100 ms if they are fitted. The first requests go out at once, except for a set-point
    /// that the program has not given yet.
    #[test]
    fn each_register_is_asked_for_in_its_period() {
        let mut drive = Drive::new(&fitted());
        let asked = run(&mut drive, [0, 1_200], answer);
        let every = |period: u64| (0..1_200).step_by(usize::try_from(period).unwrap());
        let is_every = |register, period| times(&asked, register).into_iter().eq(every(period));
        assert!(is_every(registers::ENCODER_LEFT, 40) && is_every(registers::BATTERY_MV, 1_000));
        assert!(is_every(registers::HEAT_LEFT, 100));
        assert!(is_every(registers::DIST_BACK_RIGHT, 100));
        assert!(is_every(registers::DIST_FRONT_LEFT, 100));
        let written = times(&asked, registers::SPEED_LEFT_TO);
        assert!(written.into_iter().eq(every(150).skip(1)));
        assert!(times(&asked, registers::YAW).is_empty());
        let asked = run(&mut Drive::new(&Config::default()), [0, 1_000], answer);
        let bare = [
            registers::HEAT_LEFT,
            registers::DIST_BACK_RIGHT,
            registers::DIST_FRONT_LEFT,
        ];
        assert!(
            bare.into_iter()
                .all(|register| times(&asked, register).is_empty())
        );
    }

    /// A set-point is written at once, and once more when it expires.
    #[test]
    fn a_set_point_holds_until_its_time() {
        let mut drive = Drive::new(&Config::default());
        run(&mut drive, [0, 10], answer);
        drive.command(at(10), [7, -3], at(60));
        assert!(!drive.is_confirmed() && drive.next_at() <= at(60));
        let asked = run(&mut drive, [10, 60], answer);
        assert_eq!(times(&asked, registers::SPEED_LEFT_TO), [10]);
        assert_eq!(
            (drive.set_point(), drive.is_confirmed(), drive.expired),
            ([7, -3], true, 0)
        );
        drive.command(at(60), [7, -3], at(61));
        assert!(drive.is_confirmed());
        let asked = run(&mut drive, [60, 80], answer);
        assert_eq!(times(&asked, registers::SPEED_LEFT_TO), [61]);
        assert_eq!((drive.set_point(), drive.expired), (HALT, 1));
    }

    /// Words, low byte first: heat in registers 13 and 17, infrared in 1, 3, 5, 7, 9, 11, 21, 23,
    /// 29 and 31. Battery: a word in 33 and 34, and the percentage in 35.
    #[test]
    fn what_was_read_is_told_once() {
        let mut drive = Drive::new(&fitted());
        assert_eq!((drive.take_heat(), drive.take_battery()), (None, None));
        run(&mut drive, [0, 30], answer);
        let word = |register: i16| register + 256 * (register + 1);
        assert_eq!(drive.take_heat(), Some([13, 17].map(word)));
        let infrared = [1, 3, 5, 7, 9, 11, 21, 23, 29, 31].map(word);
        assert_eq!(drive.take_infrared(), Some(infrared));
        let battery = drive.take_battery().expect("it was read");
        assert_eq!((battery.millivolts, battery.percent), (33 + 256 * 34, 35));
        assert_eq!((drive.take_heat(), drive.take_infrared()), (None, None));
        assert_eq!(
            (drive.take_battery(), drive.battery()),
            (None, Some(battery))
        );
        // The speeds are in registers 44 and 45; a tick is 11.345 mm/s.
        assert_eq!((drive.speed(), drive.speed_mm_s()), ([44, 45], [499, 511]));
    }

    /// A reading is complete only with its second half.
    #[test]
    fn half_of_the_infrared_sensors_is_no_reading() {
        let mut drive = Drive::new(&fitted());
        drive.infrared_read(0, &[5; READ_MAX]);
        assert_eq!(drive.take_infrared(), None);
        drive.infrared_read(1, &[6; READ_MAX]);
        let mut expected = [0x0505; blind::SENSORS];
        expected[6..].fill(0x0606);
        assert_eq!(drive.take_infrared(), Some(expected));
        drive.infrared_read(1, &[6; READ_MAX]);
        drive.infrared_read(0, &[5; READ_MAX]);
        assert_eq!(drive.take_infrared(), None);
    }

    /// A base that does not answer is asked again. One with an unchanged count gets the order
    /// again, and one that has counted gets nothing more. The test's registers answer with their
    /// own number, so register 53 reports 53 dropped kits.
    #[test]
    fn a_kit_is_dropped_when_the_base_has_counted_it() {
        let mut drive = Drive::new(&fitted());
        run(&mut drive, [0, 10], answer);
        drive.drop_kit();
        let is_kits = |frame: &Frame| frame.register() == registers::KITS;
        let deaf = |frame: &Frame| (!is_kits(frame)).then(|| answer(frame))?;
        let asked = run(&mut drive, [10, 250], deaf);
        let writes = |asked: &[(u64, u8, bool)]| {
            let kits = asked.iter().filter(|it| it.1 == registers::KITS);
            kits.filter(|it| it.2).count()
        };
        assert!(times(&asked, registers::KITS).len() >= 2 && writes(&asked) == 0);
        let asked = run(&mut drive, [250, 550], answer);
        assert!(writes(&asked) >= 2 && drive.kits.is_waiting());
        let counted = |frame: &Frame| match is_kits(frame) && !frame.is_write() {
            true => {
                let order = Config::default().checksum_order;
                Some(Frame::write(registers::KITS, &[54], order))
            }
            false => answer(frame),
        };
        let asked = run(&mut drive, [550, 800], counted);
        assert!(writes(&asked) == 0 && !drive.kits.is_waiting());
        let asked = run(&mut drive, [800, 1_000], counted);
        assert!(times(&asked, registers::KITS).is_empty());
    }

    /// The base reports the stop button by bit 1 of an unsolicited status.
    #[test]
    fn the_stop_button_is_told_by_the_status() {
        let mut drive = Drive::new(&Config::default());
        let mut told = |status: u8| {
            let order = Config::default().checksum_order;
            let frame = Frame::write(registers::SYSTEM_STATUS, &[status], order);
            drive.receive(at(5), frame.as_bytes());
            (drive.take_stop(), drive.take_stop())
        };
        let found = [0, 1, 2, 3, 0xFD].map(&mut told);
        let expected = [false, false, true, true, false].map(|stops| (Some(stops), None));
        assert_eq!(found, expected);
    }

    /// A silent base gets the order to stop, and is asked ten times a second; with its first answer
    /// all continues.
    #[test]
    fn a_silent_base_is_asked_whether_it_is_back() {
        let mut drive = Drive::new(&Config::default());
        run(&mut drive, [0, 10], answer);
        drive.command(at(10), [7, 7], at(9_000));
        run(&mut drive, [10, 1_000], |_| None);
        assert!(drive.is_silent() && drive.set_point() == HALT && !drive.is_confirmed());
        assert_eq!((drive.silences, drive.speed()), (1, HALT));
        let asked = run(&mut drive, [1_000, 2_000], |_| None);
        let written = times(&asked, registers::SPEED_LEFT_TO);
        assert!(written.len() >= 10 && times(&asked, registers::BATTERY_MV).is_empty());
        drive.command(at(2_000), [9, 9], at(9_000));
        assert!(drive.next_at() <= at(2_100));
        run(&mut drive, [2_000, 2_300], answer);
        assert!(!drive.is_silent() && drive.silences == 1 && !drive.was_silent);
        drive.command(at(2_300), [9, 9], at(9_000));
        let asked = run(&mut drive, [2_300, 2_302], answer);
        assert_eq!(times(&asked, registers::SPEED_LEFT_TO), [2_300]);
    }

    /// NV-04: the program sends nothing.
    #[test]
    fn a_mute_drive_asks_nothing() {
        let mut drive = Drive::new(&fitted());
        drive.is_mute = true;
        drive.command(at(0), [7, 7], at(900));
        drive.read_wheels(at(0));
        assert_eq!(run(&mut drive, [0, 500], answer), vec![]);
        assert_eq!(drive.next_at(), FAR);
    }

    /// The gyroscope's sum counts if it was read at most 10 ms before the wheels; 9000 hundredths
    /// are a quarter turn. An older sum gives no turn, nor does the next one, because it has no
    /// predecessor. While a wheel moves, 8 hundredths in 40 ms are a turn; at rest they would be a
    /// drift.
    #[test]
    fn a_turn_is_of_the_gyroscope_that_was_just_read() {
        let mut drive = Drive::new(&Config::default());
        assert_eq!(drive.turned(at(0), [0, 0]), None);
        drive.gyro = Some(Gyro::new());
        let mut turned = |read: u64, sum, wheels: u64, counters| {
            drive.yaw = Some((at(read), sum));
            drive.turned(at(wheels), counters)
        };
        let rest = (0..15).map(|n| turned(40 * n, 0, 40 * n, [0, 0]));
        assert_eq!(rest.last(), Some(Some(0.0)));
        let quarter = turned(600, 9_000, 610, [9, 0]).expect("it was just read");
        assert!((quarter - core::f32::consts::FRAC_PI_2).abs() < 1e-5);
        assert_eq!(turned(640, 9_000, 645, [9, 0]), Some(0.0));
        let slow = turned(680, 9_008, 680, [9, 1]).expect("it was just read");
        assert!((slow - 0.08_f32.to_radians()).abs() < 2e-5, "{slow}");
        assert_eq!(turned(720, 9_008, 731, [9, 1]), None);
        assert_eq!(turned(760, 9_008, 760, [9, 1]), None);
        assert_eq!(turned(800, 9_008, 800, [9, 1]), Some(0.0));
    }

    /// A tick is 11.345 mm/s: 20 are 227 mm/s. The fielded program reported a hundredth of that.
    #[test]
    fn speeds_are_told_in_mm_per_second() {
        let told = |defects| {
            let mut drive = Drive::new(&Config {
                defects,
                ..fitted()
            });
            drive.speed = [20, -127];
            drive.speed_mm_s()
        };
        let mut defects = fitted().defects;
        assert_eq!(told(defects), [227, -1_441]);
        defects.own.speaks_tenths = true;
        assert_eq!(told(defects), [2, -14]);
    }
}
