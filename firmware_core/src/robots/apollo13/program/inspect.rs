//! State that an observer may read.

use protocols::Instant;

use super::{Apollo13, Mode};
use crate::Inspect;
use crate::map_view::MapView;
use crate::pose::{Point, Pose};

impl Inspect for Apollo13 {
    fn estimate(&self) -> Option<(Instant, Pose)> {
        let pose = self.pose();
        #[expect(clippy::cast_possible_truncation, reason = "an observer needs 24 bits")]
        let [x_mm, y_mm, heading] =
            [pose.x_m * 1_000.0, pose.y_m * 1_000.0, pose.heading_rad].map(|value| value as f32);
        Some((self.now, Pose::new(x_mm, y_mm, heading)))
    }

    fn map(&self) -> Option<MapView<'_>> {
        match &self.survey {
            Some(survey) => Some(survey.view()),
            None => self.floor.view(),
        }
    }

    fn scan(&self) -> &[Point] {
        &self.scan
    }

    fn mode(&self) -> &'static str {
        let mode = self.arbiter.mode();
        let is_by_itself = matches!(mode, Mode::Autonomous | Mode::Gates | Mode::Mapping);
        if let Some(lacks) = self.lacks().filter(|_| is_by_itself) {
            return lacks;
        }
        match mode {
            Mode::Remote => "remote",
            Mode::Autonomous | Mode::Gates if self.is_lost() => "lost",
            Mode::Autonomous => "autonomous",
            Mode::Gates => "gates",
            Mode::Mapping => match &self.survey {
                Some(survey) if survey.is_complete() => "mapped",
                _ => "mapping",
            },
            Mode::Contradiction => "contradiction",
            Mode::Killed => "killed",
        }
    }

    fn counters(&self, report: &mut dyn FnMut(&'static str, u64)) {
        let counters = &self.counters;
        report("board frames", counters.frames);
        report("board bad frames", counters.bad_frames);
        report("odometer lines", counters.lines);
        report("odometer bad lines", counters.bad_lines);
        report("camera silences", self.camera.silences());
        report("odometer openings", self.watch.openings());
        report("scans", counters.scans);
        report("messages without meaning", counters.bad_messages);
        report("remote packets", counters.packets);
        report("remote bad packets", counters.bad_packets);
        report("odometer doubted", counters.doubts);
        report("slips felt", self.raw_lines.slips());
        report("pose lost", counters.lost);
        report("plans", self.pilot.plans());
        report("obstacles too near", counters.too_near);
        report("gates passed", self.gates.passed().len() as u64);
        report("gates blocked", self.gates.blocked() as u64);
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::super::{Config, Counters, MISFITS_MAX};
    use super::*;
    use crate::ackermann::CarPose;

    #[test]
    fn its_mode_is_told_by_name() {
        let hear = |car: &mut Apollo13, address: &str, value| {
            assert!(car.arbiter.hear(Instant::ZERO, address, value));
            car.mode()
        };
        let mut car = Apollo13::new(Config::default());
        assert_eq!(car.mode(), "remote");
        assert_eq!(hear(&mut car, "/modes/autonomous", 1.0), "autonomous");
        car.misfits = MISFITS_MAX;
        assert_eq!(car.mode(), "lost");
        assert_eq!(hear(&mut car, "/modes/follow_aruco", 1.0), "contradiction");
        assert_eq!(hear(&mut car, "/modes/autonomous", 0.0), "lost");
        car.misfits = MISFITS_MAX - 1;
        assert_eq!(car.mode(), "gates");
        assert_eq!(hear(&mut car, "/modes/follow_aruco", 0.0), "remote");
        assert_eq!(hear(&mut car, "/modes/mapping", 1.0), "mapping");
        assert_eq!(hear(&mut car, "/1/kill", 1.0), "killed");
    }

    /// The pose is 1.5 m, -0.25 m and one radian, at the time of the last poll.
    #[test]
    fn its_place_is_told_in_millimetres() {
        let mut car = Apollo13::new(Config {
            start: CarPose {
                x_m: 1.5,
                y_m: -0.25,
                heading_rad: 1.0,
            },
            ..Config::default()
        });
        car.now = Instant::from_millis(70);
        car.scan.push(Point::new(3.0, 4.0));
        let (at, pose) = car.estimate().expect("a place");
        assert_eq!(at, Instant::from_millis(70));
        assert!(pose.position().distance_mm(Point::new(1_500.0, -250.0)) < 0.01);
        assert!((pose.heading - 1.0).abs() < 1e-6);
        assert_eq!(car.scan(), [Point::new(3.0, 4.0)]);
        assert!(car.map().is_none());
    }

    #[test]
    fn what_happened_is_counted_by_name() {
        let mut car = Apollo13::new(Config::default());
        car.counters = Counters {
            frames: 1,
            bad_frames: 2,
            lines: 3,
            bad_lines: 4,
            scans: 5,
            bad_messages: 6,
            packets: 7,
            bad_packets: 8,
            too_near: 9,
            doubts: 10,
            lost: 11,
        };
        let mut told = Vec::new();
        car.counters(&mut |name, count| told.push((name, count)));
        let expected = [
            ("board frames", 1),
            ("board bad frames", 2),
            ("odometer lines", 3),
            ("odometer bad lines", 4),
            ("camera silences", 0),
            ("odometer openings", 0),
            ("scans", 5),
            ("messages without meaning", 6),
            ("remote packets", 7),
            ("remote bad packets", 8),
            ("odometer doubted", 10),
            ("slips felt", 0),
            ("pose lost", 11),
            ("plans", 0),
            ("obstacles too near", 9),
            ("gates passed", 0),
            ("gates blocked", 0),
        ];
        assert_eq!(told, expected);
    }
}
