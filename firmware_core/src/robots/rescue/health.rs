//! Faults and warnings of the robot, its reaction to them, and their report to the PC.

use protocols::Instant;
use protocols::pcui::diagnosis::{Condition, Conditions, Diagnosis, Readings, Search};
use protocols::pcui::message::Mode;

use super::drive::Battery;
use super::screen::Notice;
use super::{Progress, Rescue};
use crate::pose::Pose;
use crate::slam::Improvement;

/// Charge at which the robot drives home, in percent, and from which a battery counts as a new one.
const LOW_PERCENT: i8 = 10;
const FULL_PERCENT: i8 = 30;
/// Number of low readings in a row, one a second: the start of a motor also lowers the charge for a
/// moment.
const LOW_READINGS: u8 = 5;
/// Speed of the drive home: 136 mm/s.
const SLOW_CRUISE: i8 = 12;
/// A robot so near to the map's edge may be beyond it.
const RIM_MM: f32 = 50.0;

/// State of the watched parts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Health {
    low_readings: u8,
    is_low: bool,
    is_stopped: bool,
    is_off_map: bool,
}

impl Health {
    pub(super) const fn new() -> Self {
        Self {
            low_readings: 0,
            is_low: false,
            is_stopped: false,
            is_off_map: false,
        }
    }

    /// Notes the operator's order to continue: the base does not report the release of its button.
    pub(super) const fn goes_on(&mut self) {
        self.is_stopped = false;
    }

    /// Takes a reading of the battery; returns whether the battery has just become low.
    const fn take_battery(&mut self, battery: Battery) -> bool {
        if battery.percent > LOW_PERCENT {
            self.low_readings = 0;
            self.is_low = self.is_low && battery.percent < FULL_PERCENT;
            return false;
        }
        self.low_readings = self.low_readings.saturating_add(1);
        let was_low = self.is_low;
        self.is_low = was_low || self.low_readings >= LOW_READINGS;
        self.is_low && !was_low
    }
}

impl Rescue {
    /// Continues the setup of the radio, and reports a failure.
    pub(super) fn set_radio_up(&mut self, now: Instant) {
        let Some(setup) = &mut self.radio_setup else {
            return;
        };
        setup.tick(now);
        if setup.is_over() {
            if setup.has_failed() {
                self.screen.notices.push(now, Notice::RadioSilent);
            }
            self.radio_setup = None;
        }
    }

    /// Whether the radio is available for the PC.
    pub(super) const fn uses_radio(&self) -> bool {
        self.switches.pc_link && self.radio_setup.is_none()
    }

    /// Reads the base's new reports: its battery, its stop button.
    pub(super) fn watch_health(&mut self, now: Instant) {
        if let Some(battery) = self.drive.take_battery()
            && self.health.take_battery(battery)
        {
            self.screen.notices.push(now, Notice::GoesHome);
            self.navigator.slow_down(SLOW_CRUISE);
            // A list of waypoints is the PC's task: the PC gets the warning and may send other
            // waypoints.
            if matches!(self.mode, Mode::Exploration | Mode::Explore) {
                if self.mode != Mode::Explore {
                    self.set_mode(now, Mode::Explore);
                }
                self.explore.go_home(self.config.mapping.start.position());
            }
        }
        if let Some(is_stopped) = self.drive.take_stop() {
            if is_stopped && !self.health.is_stopped {
                self.screen.notices.push(now, Notice::StopButton);
                self.set_mode(now, Mode::Stop);
            }
            self.health.is_stopped = is_stopped;
        }
        let place = self.mapper.pose().position();
        let map = self.mapper.grid();
        let within = |mm: f32, cells: usize| {
            (RIM_MM..=cells as f32 * map.resolution_mm() - RIM_MM).contains(&mm)
        };
        let is_off_map = !within(place.x_mm, map.width()) || !within(place.y_mm, map.height());
        if is_off_map && !self.health.is_off_map {
            self.screen.notices.push(now, Notice::OffMap);
        }
        self.health.is_off_map = is_off_map;
    }

    /// Whether the robot is at the edge of its map.
    pub const fn is_off_map(&self) -> bool {
        self.health.is_off_map
    }

    /// The improvements of the last search, with the document's mapper.
    pub fn improvements(&self) -> &[Improvement] {
        self.mapper.improvements()
    }

    /// Mean map value at the start of the last search, 0 to 255, with the document's mapper.
    pub const fn search_start(&self) -> f32 {
        self.mapper.search_start()
    }

    /// Pose by the wheels alone, or with the gyroscope, relative to the origin, and its time;
    /// `None` before the first reading.
    pub fn dead_reckoned(&self) -> Option<(Instant, Pose)> {
        let odometry = &self.drive.odometry;
        Some((odometry.updated_at()?, odometry.pose()))
    }

    /// Whether the lidar's speed is stable.
    pub const fn lidar_speed_is_stable(&self) -> bool {
        self.lidar.speed_is_stable()
    }

    /// Data sent to the PC.
    pub(super) fn diagnosis(&self) -> Diagnosis {
        let battery = self.drive.battery();
        let (lidar, base, pc) = (
            &self.lidar.counters,
            self.drive.link().counters(),
            self.pc.counters(),
        );
        let errors = [
            lidar.bad_packets.saturating_add(lidar.lost_packets),
            base.failures,
            pc.bad_frames.saturating_add(pc.meaningless),
        ];
        Diagnosis {
            battery_mv: battery.map_or(0, |battery| battery.millivolts),
            battery_percent: battery.map_or(-1, |battery| battery.percent),
            conditions: Conditions::NONE
                .with(Condition::BatteryLow, self.health.is_low)
                .with(Condition::BaseSilent, self.drive.is_silent())
                .with(Condition::LidarSilent, !self.lidar.sees())
                .with(Condition::Lost, self.is_lost())
                .with(Condition::OffMap, self.health.is_off_map)
                .with(Condition::Stopped, self.health.is_stopped)
                .with(Condition::LidarWeak, self.lidar.motor_is_too_weak())
                .with(Condition::WheelStalled, self.drive.stall.is_stalled()),
            search: match self.search_progress() {
                None => Search::None,
                Some(Progress::Seeks) => Search::Seeks,
                Some(Progress::GoesHome) => Search::GoesHome,
                Some(Progress::IsHome) => Search::IsHome,
            },
            errors: errors.map(|count| u16::try_from(count).unwrap_or(u16::MAX)),
        }
    }
}

impl Rescue {
    /// Readings of the sensors for the PC.
    pub(super) fn readings(&self) -> Readings {
        Readings {
            infrared_mm: self.drive.infrared(),
            lidar_rpm: self.lidar.speed_rpm(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Config;
    use super::*;

    fn take(health: &mut Health, percent: i8) -> bool {
        health.take_battery(Battery {
            millivolts: 10_000,
            percent,
        })
    }

    /// A robot 20 mm from the edge of a map of 3 m counts as off the map, one in the middle does
    /// not.
    #[test]
    fn leaving_the_map_is_told() {
        let is_told = |x_mm| {
            let mut config = Config::default();
            config.mapping.start = Pose::new(x_mm, 1_500.0, 0.0);
            let mut robot = Rescue::new(config);
            robot.watch_health(Instant::ZERO);
            robot.diagnosis().conditions.has(Condition::OffMap)
        };
        assert_eq!([1_500.0, 2_980.0, 20.0].map(is_told), [false, true, true]);
    }

    /// The left wheel is driven and counts nothing for 200 ms.
    #[test]
    fn a_stalled_wheel_is_told() {
        let mut robot = Rescue::new(Config::default());
        let mut is_told = |millis: u64, counters| {
            let stall = &mut robot.drive.stall;
            stall.take(Instant::from_millis(millis), counters, [10, 10]);
            robot.diagnosis().conditions.has(Condition::WheelStalled)
        };
        let readings = [
            (0, [0, 0]),
            (40, [9, 9]),
            (80, [9, 18]),
            (240, [9, 54]),
            (280, [9, 63]),
        ];
        let told = readings.map(|(millis, counters)| is_told(millis, counters));
        assert_eq!(told, [false, false, false, false, true]);
    }

    /// Five low readings in a row count; a full one resets the count, one of 20 percent does not.
    #[test]
    fn a_low_battery_is_believed_after_five_readings() {
        let mut health = Health::new();
        let readings = [9, 9, 9, 9, 11, 10, 10, 10, 10];
        assert!(readings.iter().all(|&percent| !take(&mut health, percent)));
        assert!(take(&mut health, 10) && !take(&mut health, 3));
        take(&mut health, 20);
        assert!(health.is_low);
        take(&mut health, 90);
        assert!(!health.is_low);
    }
}
