//! Whether the robot has found the victims of the world.

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
    let missed = plates
        .iter()
        .zip(&errors)
        .filter(|(_, error)| **error > most);
    let missed: Vec<String> = missed
        .map(|(plate, _)| {
            let Point { x, y } = plate.middle();
            format!("({x:.2}, {y:.2})")
        })
        .collect();
    let near = errors.len() - missed.len();
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
    let mut detail = format!(
        "{near} of {all} victims within {most} mm, the worst {worst:.0} mm; {wrong} marks without \
         one; {kits} kits dropped"
    );
    if !missed.is_empty() {
        detail += &format!("; missed at {} m", missed.join(", "));
    }
    let is_once = marks.len() == all && found.kits.is_none_or(|kits| kits == all);
    Check::new(
        "victims-found",
        near == all && wrong == 0 && is_once,
        detail,
    )
}

#[cfg(test)]
mod tests {
    use emulators::world::scene::HeatPlate;
    use emulators::world::{BodyConfig, Obstacle, Pose, Scene, Shape};

    use super::*;
    use crate::robots::checker::Status;

    /// Plates around (1, 0) and (3, 0).
    fn world() -> World {
        let plate = |x: f64| {
            let [from, to] = [Point::new(x, -0.5), Point::new(x, 0.5)];
            HeatPlate::new(from, to, 37.0).expect("sound")
        };
        let scene = Scene::new(Vec::<Shape>::new(), Vec::<Obstacle>::new()).expect("empty");
        let scene = scene.with_heat_plates(vec![plate(1.0), plate(3.0)]);
        World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free")
    }

    fn judged(places: &[[f64; 2]], kits: Option<usize>) -> (bool, String) {
        let places = places.to_vec();
        let check = check(&Found { places, kits }, &world(), 250.0);
        (check.status == Status::Pass, check.detail)
    }

    /// Marks 125 mm and 250 mm beside the middles of their plates, 250 mm being allowed.
    #[test]
    fn each_victim_has_a_mark_and_a_kit() {
        let marks = [[3.0, 0.25], [1.125, 0.0]];
        let said = "2 of 2 victims within 250 mm, the worst 250 mm; 0 marks without one; 2 kits \
                    dropped";
        assert_eq!(judged(&marks, Some(2)), (true, said.to_owned()));
        assert!(judged(&marks, None).0);
        assert!(judged(&marks, None).1.ends_with("unknown kits dropped"));
        assert!(!judged(&marks, Some(1)).0 && !judged(&marks, Some(3)).0);
    }

    #[test]
    fn a_victim_without_a_mark_a_mark_without_one_and_two_marks_are_wrong() {
        let (passes, said) = judged(&[[1.0, 0.0]], Some(2));
        assert!(!passes && said.starts_with("1 of 2 victims"), "{said}");
        assert!(
            said.contains("the worst 2000 mm; 0 marks without"),
            "{said}"
        );
        let (passes, said) = judged(&[[1.0, 0.0], [3.0, 0.0], [3.0, 1.0]], None);
        assert!(!passes && said.contains("; 1 marks without one"), "{said}");
        let (passes, said) = judged(&[[1.0, 0.0], [3.0, 0.0], [3.0, 0.0]], None);
        assert!(!passes && said.contains("; 0 marks without one"), "{said}");
        let (passes, said) = judged(&[], None);
        assert!(!passes && said.starts_with("0 of 2 victims"), "{said}");
        let ends = "kits dropped; missed at (1.00, 0.00), (3.00, 0.00) m";
        assert!(said.ends_with(ends), "{said}");
    }
}
