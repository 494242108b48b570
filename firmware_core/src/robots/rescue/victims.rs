//! Victims: where on the walls the thermometers felt somebody.
//!
//! A sensor looks to the side. While it passes something warm, the places on the wall right beside
//! it are averaged, each by the square of how warm it is there: the middle of what it passed.

use crate::pose::{Point, Pose};

use super::Surroundings;

/// Victims that are kept.
pub const VICTIMS_MAX: usize = 16;
/// Warmer than its surroundings by so much, in tenths of a degree: 37 degrees on a third of what
/// the sensor sees, in a hall of 22.
const WARM: i16 = 45;
/// What is kept of the surroundings' temperature at each reading, in 64ths.
const KEEP_64: i32 = 62;
/// Farther than this the place on the wall is not sure, millimetres. What the search takes for felt
/// lies nearer: 0.42 m, and the flank of 60 mm that the map draws before a wall.
const FAR_MM: f32 = 550.0;
/// What is warmer than its surroundings by so much, tenths of a degree, may be the rim of somebody.
const CALM: i16 = 15;
/// Beside the middle of the field of view a wall is looked for so far, radians.
const BESIDE: f32 = 0.1;
/// Nearer to a victim than this it is the same one.
const SAME_MM: f32 = 250.0;

/// Somebody.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Victim {
    /// Where, in the map.
    pub place: Point,
    /// Sum of the weights of the readings that it is the mean of.
    weight: f32,
}

/// All of them.
#[derive(Clone, Debug)]
pub(super) struct Victims {
    list: [Victim; VICTIMS_MAX],
    len: usize,
    /// What passes the sensors now.
    passing: [Victim; 2],
    /// Temperature of the surroundings, 64ths of a tenth of a degree; 0: not known yet.
    ambient_64: [i32; 2],
}

impl Victims {
    const NOBODY: Victim = Victim {
        place: Point::new(0.0, 0.0),
        weight: 0.0,
    };

    pub(super) const fn new() -> Self {
        Self {
            list: [Self::NOBODY; VICTIMS_MAX],
            len: 0,
            passing: [Self::NOBODY; 2],
            ambient_64: [0; 2],
        }
    }

    pub(super) fn all(&self) -> &[Victim] {
        &self.list[..self.len]
    }

    /// Their places in whole millimetres, as the PC is told.
    pub(super) fn told<'a>(&self, places: &'a mut [[i16; 2]; VICTIMS_MAX]) -> &'a [[i16; 2]] {
        for (place, victim) in places.iter_mut().zip(self.all()) {
            let Point { x_mm, y_mm } = victim.place;
            #[expect(clippy::cast_possible_truncation, reason = "saturates")]
            let told = [x_mm, y_mm].map(|mm| libm::roundf(mm) as i16);
            *place = told;
        }
        &places[..self.len]
    }

    /// Takes the thermometers' readings, left and right, tenths of a degree; whether they belong to
    /// somebody who was not known.
    pub(super) fn take(&mut self, readings: [i16; 2], pose: Pose, around: &Surroundings) -> bool {
        let mut is_new = false;
        for (index, reading) in readings.into_iter().enumerate() {
            let excess = self.excess(index, reading);
            let side = if index == 0 { 1.0 } else { -1.0 };
            let wall = wall_beside(around, side * core::f32::consts::FRAC_PI_2);
            match wall {
                Some(wall) if excess >= WARM => {
                    let weight = f32::from(excess) * f32::from(excess);
                    mix(&mut self.passing[index], pose.to_world(wall), weight);
                }
                _ => is_new |= self.passed(index),
            }
        }
        is_new
    }

    /// How much warmer than its surroundings.
    fn excess(&mut self, index: usize, reading: i16) -> i16 {
        let ambient = &mut self.ambient_64[index];
        let reading_64 = i32::from(reading) * 64;
        if *ambient == 0 {
            *ambient = reading_64;
        }
        let excess = i32::from(reading) - *ambient / 64;
        // What is warm is no surroundings, nor is the rim of it, beside which a robot may stand for
        // long; what is colder than they were thought is.
        if excess < i32::from(CALM) {
            *ambient = (*ambient * KEEP_64 + reading_64 * (64 - KEEP_64)) / 64;
        }
        i16::try_from(excess).unwrap_or(0)
    }

    /// Nothing warm passes this side any more: what did is somebody.
    fn passed(&mut self, index: usize) -> bool {
        let found = core::mem::replace(&mut self.passing[index], Self::NOBODY);
        if found.weight <= 0.0 {
            return false;
        }
        let known = &mut self.list[..self.len];
        let same = |known: &&mut Victim| known.place.distance_mm(found.place) < SAME_MM;
        if let Some(known) = known.iter_mut().find(same) {
            mix(known, found.place, found.weight);
            return false;
        }
        let Some(slot) = self.list.get_mut(self.len) else {
            return false;
        };
        *slot = found;
        self.len += 1;
        true
    }
}

fn mix(victim: &mut Victim, place: Point, weight: f32) {
    victim.weight += weight;
    let share = weight / victim.weight;
    victim.place.x_mm += (place.x_mm - victim.place.x_mm) * share;
    victim.place.y_mm += (place.y_mm - victim.place.y_mm) * share;
}

/// The wall at `bearing`, seen from the robot.
fn wall_beside(around: &Surroundings, bearing: f32) -> Option<Point> {
    let (bearing, range_mm) = around.nearest(bearing - BESIDE..=bearing + BESIDE)?;
    let (sin, cos) = crate::pose::sin_cos(bearing);
    (range_mm <= FAR_MM).then(|| Point::new(range_mm * cos, range_mm * sin))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall 270 mm to the left, from x = -1 m to 1 m.
    fn wall() -> Surroundings {
        let along = (-100..=100_i16).map(|n| Point::new(f32::from(n) * 10.0, 270.0));
        Surroundings::of(along)
    }

    /// The robot passes somebody at x = 500 mm, felt from 50 mm on both sides.
    fn pass(victims: &mut Victims) -> u32 {
        let mut found = 0;
        for x in (0..=1000_i16).step_by(20) {
            let left = if (450..=550).contains(&x) { 320 } else { 220 };
            let pose = Pose::new(f32::from(x), 0.0, 0.0);
            found += u32::from(victims.take([left, 221], pose, &wall()));
        }
        found
    }

    #[test]
    fn somebody_is_found_once_and_in_the_middle_of_what_is_warm() {
        let mut victims = Victims::new();
        assert_eq!((pass(&mut victims), pass(&mut victims)), (1, 0));
        let [victim] = victims.all() else {
            panic!("{:?}", victims.all());
        };
        let expected = Point::new(500.0, 270.0);
        assert!(victim.place.distance_mm(expected) < 20.0, "{victim:?}");
    }

    /// A hall that warms up by ten degrees in a thousand readings is nobody.
    #[test]
    fn a_warm_day_is_nobody() {
        let mut victims = Victims::new();
        for n in 0..1000_i16 {
            assert!(!victims.take([220 + n / 10; 2], Pose::default(), &wall()));
        }
        assert_eq!(victims.all(), []);
    }

    #[test]
    fn more_than_the_list_holds_are_not_told() {
        let mut victims = Victims::new();
        let mut found = 0;
        for n in 0..20_i16 {
            let pose = Pose::new(f32::from(n) * 400.0, 0.0, 0.0);
            for left in [220, 330, 220] {
                found += usize::from(victims.take([left, 220], pose, &wall()));
            }
        }
        assert_eq!((found, victims.all().len()), (VICTIMS_MAX, VICTIMS_MAX));
    }
}
