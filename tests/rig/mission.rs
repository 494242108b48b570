//! The demo's mission, over many seeds: the first run that a new user sees.

use hilrig::run::{Outcome, Run};

use super::{failures, shipped};
use crate::thorough::few;

/// Twenty seeds: every waypoint within 200 mm, back at the start, no rule of a device broken; the
/// medians of the pose errors at most 30 mm and 2 degrees RMS, the walls found and right to 0.8.
#[test]
fn the_flat_is_mapped_and_its_waypoints_visited_with_every_seed() {
    let outcomes: Vec<Outcome> = few(4, 1..=20).into_iter().map(with_seed).collect();
    for outcome in &outcomes {
        assert_eq!(
            failures(outcome),
            Vec::<String>::new(),
            "seed {}",
            outcome.seed
        );
        assert_eq!(outcome.violations, 0, "seed {}", outcome.seed);
    }
    let error = |outcome: &Outcome| outcome.pose_error.expect("the program is in this process");
    let position = median(outcomes.iter().map(|outcome| error(outcome).rms_mm));
    let heading = median(outcomes.iter().map(|outcome| error(outcome).rms_deg));
    let walls = outcomes
        .iter()
        .map(|outcome| outcome.wall_overlap.expect("likewise").least());
    let worst_walls = walls.fold(1.0, f64::min);
    assert!(position <= 30.0, "{position} mm");
    assert!(heading <= 2.0, "{heading} degrees");
    assert!(worst_walls >= 0.8, "{worst_walls}");
}

fn with_seed(seed: u64) -> Outcome {
    let (scenario, source) = shipped("rescue-flat");
    Run::new(scenario, &source, Some(seed))
        .expect("can be wired")
        .finish()
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
