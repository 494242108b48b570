//! Accuracy of a robot's pose on a map that it or another robot left, in invented buildings: the
//! map of one pass, and other passes through the same building on it.
//!
//! ```text
//! cargo bench --bench localise -- FIRST COUNT
//! ```

use std::process::ExitCode;

use emulators::world::Pose;
use hilrig::slam::mapping::building::{Building, Pass, Sight};
use hilrig::slam::mapping::motion::{between, distance, moved};
use hilrig::slam::mapping::{Localiser, Mapper, Settings, Shot, WallPoint};

/// Error of the pose above which a pass is lost, metres.
const LOST_M: f64 = 1.0;

fn main() -> ExitCode {
    let mut numbers = std::env::args()
        .skip(1)
        .filter_map(|word| word.parse().ok());
    let first: u64 = numbers.next().unwrap_or(0);
    let count = numbers.next().unwrap_or(20);
    let (mut lost, mut silent) = (0, 0);
    for seed in first..first + count {
        let building = Building::generate(seed);
        let mut mapper = Mapper::new(Settings {
            start: building.sights[0].truth,
            ..Settings::default()
        });
        for sight in &building.sights {
            mapper.take(&shot(sight));
        }
        mapper.finish();
        let map = Map {
            truth: building.sights.iter().map(|sight| sight.truth).collect(),
            way: mapper.way(),
            walls: mapper.walls(),
        };
        let [median, _, most] = errors(&map.truth, &map.way);
        print!(
            "{seed}: {:.0} m; map {median:.3} m, at most {most:.3}",
            building.way_m
        );
        for pass in [Pass::Again(1), Pass::Back] {
            let ([median, late, most], doubtful) = map.found(&Building::passed(seed, 0.0, pass));
            print!(
                "; {pass:?} {median:.3} m, 95 % {late:.3}, at most {most:.3}, {doubtful} doubtful"
            );
            lost += u64::from(most > LOST_M);
            silent += u64::from(most > LOST_M && doubtful == 0);
        }
        println!();
    }
    println!("{count} buildings, two passes each: {lost} passes lost, {silent} of them silently");
    ExitCode::from(u8::from(silent > 0))
}

/// A map, with the true and the computed poses of its scans.
struct Map {
    truth: Vec<Pose>,
    way: Vec<Pose>,
    walls: Vec<WallPoint>,
}

impl Map {
    /// The pose on the map that corresponds to the true pose `of`, relative to the nearest scan:
    /// the map is slightly bent.
    fn place(&self, of: Pose) -> Pose {
        let off = |pose: &Pose| distance(*pose, of);
        let both = self.truth.iter().zip(&self.way);
        let nearest = both.min_by(|a, b| off(a.0).total_cmp(&off(b.0)));
        nearest.map_or(of, |(truth, way)| moved(*way, between(*truth, of)))
    }

    /// Errors of a pass on the map, and its doubtful scans.
    fn found(&self, building: &Building) -> ([f64; 3], usize) {
        let sights = building.sights.iter();
        let places: Vec<Pose> = sights.map(|sight| self.place(sight.truth)).collect();
        let settings = Settings {
            start: places[0],
            ..Settings::default()
        };
        let mut localiser = Localiser::new(settings, &self.walls);
        let outcomes = building.sights.iter();
        let outcomes: Vec<_> = outcomes.map(|sight| localiser.take(&shot(sight))).collect();
        let doubtful = outcomes.iter().filter(|outcome| outcome.is_doubtful);
        (errors(&places, localiser.way()), doubtful.count())
    }
}

fn shot(sight: &Sight) -> Shot<'_> {
    Shot {
        moved: sight.moved,
        is_measured: true,
        ends: &sight.ends,
    }
}

/// Median, 95th percentile and maximum distance between two tracks, metres.
fn errors(truth: &[Pose], way: &[Pose]) -> [f64; 3] {
    let off = truth.iter().zip(way).map(|(a, b)| distance(*a, *b));
    let mut off: Vec<f64> = off.collect();
    off.sort_by(f64::total_cmp);
    let at = |part: usize| off.get((off.len() * part / 100).min(off.len().max(1) - 1));
    [50, 95, 100].map(|part| at(part).copied().unwrap_or(0.0))
}
