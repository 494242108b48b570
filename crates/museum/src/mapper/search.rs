//! Random candidates of the search, and their number.

use core::time::Duration;

use firmware_core::Work;
use firmware_core::pose::{Point, Pose, PoseChange};
use firmware_core::scan::Scan;
use firmware_core::slam::{Budget, Mapper, Outcome, Settings};

use super::{mapper, room, scan_of, settings};
use crate::{Observation, Variant};
use engine::rig::cpu::CpuModel;

/// Number of searches that an exhibit sums up.
const SEARCHES: u64 = 20;

/// Outcomes of searches with different random numbers, and the error of each found pose. The robot
/// knows its room, and its believed pose is off by `off`.
fn searches(settings: Settings, off: PoseChange) -> Vec<(Outcome, PoseChange)> {
    let walls = room([900.0, 700.0]);
    let one = |seed| {
        let mut mapper = mapper(Settings { seed, ..settings });
        (0..30).for_each(|_| mapper.draw(&walls, [0, 0]));
        mapper.set_pose(settings.start.then(off));
        let outcome = mapper.locate(&walls);
        (outcome, settings.start.change_to(outcome.pose))
    };
    (1..=SEARCHES).map(one).collect()
}

fn off(forward_mm: f32, left_mm: f32, turn_deg: f32) -> PoseChange {
    PoseChange {
        forward_mm,
        left_mm,
        turn: turn_deg.to_radians(),
    }
}

/// 100 mm are halved to 50, 25, 12, 6, 3, 1 and 0.
pub(super) fn sl_01(variant: Variant) -> Observation {
    let found = searches(settings(variant, "SL-01"), off(70.0, -60.0, 6.0));
    let tries: u32 = found.iter().map(|(outcome, _)| outcome.tries).sum();
    let on_map: u32 = found.iter().map(|(outcome, _)| outcome.on_map).sum();
    let mut seen = Observation::default();
    seen.figure("candidates of 20 searches", tries);
    seen.figure("of these beside the map", tries - on_map);
    seen.judged(on_map < tries)
}

/// 10 degrees are halved to 5, 2, 1 and 0. Within its spreads, a search turns by at most 18
/// degrees.
pub(super) fn sl_02(variant: Variant) -> Observation {
    let found = searches(settings(variant, "SL-02"), off(70.0, -60.0, 60.0));
    let turned = |pose: &PoseChange| (pose.turn.to_degrees() - 60.0).abs();
    let most = found
        .iter()
        .map(|(_, pose)| turned(pose))
        .fold(0.0, f32::max);
    let mut seen = Observation::default();
    seen.figure("largest turn in 20 searches, deg", format!("{most:.0}"));
    seen.judged(most > 20.0)
}

/// Time per scan in the seed report: 14 ms, plus 0.15 ms for each try with 36 points.
fn scan_time(tries: u32) -> Duration {
    CpuModel::STM32F4.cost(Work {
        scans: 1,
        tries,
        points: tries * 36,
    })
}

/// 970 minus 17 times 60 is -50.
pub(super) fn sl_03(variant: Variant) -> Observation {
    let mut settings = settings(variant, "SL-03");
    settings.budget.start = 970;
    let mut mapper = mapper(settings);
    (0..17).for_each(|_| mapper.search_time(Duration::from_millis(400)));
    let tries = mapper.tries();
    let mut seen = Observation::default();
    seen.figure("tries after 17 overruns", tries);
    let seconds = scan_time(tries).as_secs_f64();
    seen.figure("time of the next scan, s", format!("{seconds:.1}"));
    seen.judged(tries == 65_486)
}

/// The fielded limit of 160 ms, at which 973 tries are in balance.
pub(crate) const FIELDED: Budget = Budget {
    start: 973,
    target: Duration::from_millis(160),
    ..Budget::DOCUMENT
};

/// Time of the first scan after `blackout`, and time until scans take less than 200 ms again; a
/// scan begins with a turn of the lidar.
pub(crate) fn after_blackout(settings: Settings, blackout: Duration) -> [Duration; 2] {
    let turn = Duration::from_millis(200);
    let mut mapper: Box<Mapper> = mapper(settings);
    for _ in 0..blackout.as_millis() / turn.as_millis() {
        mapper.search_time(scan_time(0));
    }
    let first = scan_time(mapper.tries());
    let mut until = Duration::ZERO;
    loop {
        let took = scan_time(mapper.tries());
        if took < turn {
            return [first, until];
        }
        mapper.search_time(took);
        let turns = took.as_nanos().div_ceil(turn.as_nanos());
        until += turn * u32::try_from(turns).expect("less than a minute");
    }
}

pub(super) fn sl_04(variant: Variant) -> Observation {
    let settings = Settings {
        budget: FIELDED,
        ..settings(variant, "SL-04")
    };
    let names = [
        (
            60,
            "first scan after 60 s without beams, s",
            "until scans are in time again, s",
        ),
        (300, "first scan after 300 s, s", "until then, s"),
    ];
    let mut seen = Observation::default();
    let mut longest = Duration::ZERO;
    for (blackout, first_name, until_name) in names {
        let [first, until] = after_blackout(settings, Duration::from_secs(blackout));
        seen.figure(first_name, format!("{:.2}", first.as_secs_f64()));
        seen.figure(until_name, format!("{:.0}", until.as_secs_f64()));
        longest = longest.max(first);
    }
    seen.judged(longest > Duration::from_secs(4))
}

/// The map shows a wall of 204 of 255, 20 mm from its edge, and beside it a wall of 255. The scan
/// is the first wall and one point in front of the second. At the correct pose, the mean is about
/// 200. 40 mm nearer to the edge, all points but one lie outside the map, and that one is on 255.
pub(super) fn sl_10(variant: Variant) -> Observation {
    let mut settings = settings(variant, "SL-10");
    // The strongest update, so that one scan draws the map; a hole of two cells.
    (settings.weight, settings.hole_mm) = (256, 20.0);
    settings.start = Pose::new(205.0, 1505.0, core::f32::consts::PI);
    let wall = |ahead: f32, rows: core::ops::RangeInclusive<i16>| {
        let point = move |row| Point::new(ahead, f32::from(10_i16 * row));
        rows.map(point)
    };
    let mut mapper = mapper(settings);
    // The weight falls by a tenth for each tick of difference between the wheels: 153 of 256.
    mapper.draw(&scan_of(&wall(180.0, -17..=17).collect::<Vec<_>>()), [4, 0]);
    mapper.draw(
        &scan_of(&wall(180.0, -40..=-22).collect::<Vec<_>>()),
        [0, 0],
    );
    let whole: Vec<Point> = wall(180.0, -17..=17)
        .chain(wall(140.0, -31..=-31))
        .collect();
    let outcome = mapper.locate(&scan_of(&whole));
    let moved = settings.start.change_to(outcome.pose).forward_mm;
    let mut seen = Observation::default();
    seen.figure("score of the place found", outcome.score);
    seen.figure("moved towards the map's edge, mm", format!("{moved:.0}"));
    seen.judged(outcome.score == 261_120 && moved > 20.0)
}

/// A wall of 255 in the map, hit by the only point: 255 * 1024 is 261120, which is 1024 less than
/// four times 65536 and overflows 16 bits.
pub(super) fn sl_11(variant: Variant) -> Observation {
    let mut settings = settings(variant, "SL-11");
    (settings.weight, settings.hole_mm) = (256, 20.0);
    let ahead: Scan = scan_of(&[Point::new(305.0, 5.0)]);
    let mut mapper = mapper(settings);
    mapper.draw(&ahead, [0, 0]);
    let score = mapper.locate(&ahead).score;
    let mut seen = Observation::default();
    seen.figure("score of a full match", score);
    seen.judged(score == -1024)
}

/// Many tries, so that only the narrowing of the search matters.
pub(super) fn h_sl_1(variant: Variant) -> Observation {
    let mut settings = settings(variant, "H-SL-1");
    settings.budget.start = 4000;
    let found = searches(settings, off(60.0, -50.0, 6.0));
    let sum: f32 = found.iter().map(|(_, pose)| pose.distance_mm()).sum();
    let mean = sum / found.len() as f32;
    let mut seen = Observation::default();
    seen.figure("mean error of 20 searches, mm", format!("{mean:.1}"));
    seen.judged(mean > 8.0)
}
