//! Whether the robot has found who is there.

use emulators::world::{Point, World};

use super::check::Check;
use crate::robots::Found;

/// Judges the marks of `found` by the plates of `world`: each plate has a mark within `most` mm,
/// each mark a plate, and a kit was dropped once for each.
pub(super) fn check(found: &Found, world: &World, most: f64) -> Check {
    let plates = world.scene().heat_plates();
    let place = |[x, y]: [f64; 2]| Point::new(x, y);
    let marks: Vec<Point> = found.places.iter().copied().map(place).collect();
    let nearest = |from: Point, to: &mut dyn Iterator<Item = Point>| {
        let far = to.map(|other| other.distance(from) * 1000.0);
        far.fold(f64::INFINITY, f64::min)
    };
    let errors: Vec<f64> = plates
        .iter()
        .map(|plate| nearest(plate.middle(), &mut marks.iter().copied()))
        .collect();
    let near = errors.iter().filter(|error| **error <= most).count();
    let wrong = marks.iter().filter(|mark| {
        let mut middles = plates.iter().map(|plate| plate.middle());
        nearest(**mark, &mut middles) > most
    });
    let wrong = wrong.count();
    let worst = errors.iter().copied().fold(0.0, f64::max);
    let all = plates.len();
    let kits = found
        .kits
        .map_or_else(|| "unknown".to_owned(), |kits| kits.to_string());
    let detail = format!(
        "{near} of {all} victims within {most} mm, the worst {worst:.0} mm; {wrong} marks without \
         one; {kits} kits dropped"
    );
    let is_once = marks.len() == all && found.kits.is_none_or(|kits| kits == all);
    Check::new(
        "victims-found",
        near == all && wrong == 0 && is_once,
        detail,
    )
}
