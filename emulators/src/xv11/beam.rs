//! One beam: from a position and a direction in the world to the four bytes of a reading.
//!
//! (A) and (B) are the captures named in `optics`.

use core::f64::consts::PI;

use protocols::Instant;
use protocols::xv11::{RawReading, Reading};

use super::optics::{Laws, Optics, RANGE_MAX_MM, RANGE_MIN_MM, is_weak, strength_mean};
use super::surface::Place;
use super::{Detail, Profile};
use crate::lidar::beam::{Beam, normal};
use crate::lidar::{Direction, Mount};
use crate::rng::Rng;
use crate::world::{Hit, Point, Scene, World};

/// Error codes that the optics give; meanings are inferred from where they occur.
mod code {
    pub(super) const DOUBLE_DOT: u8 = 0x02;
    pub(super) const TOO_WIDE: u8 = 0x03;
    pub(super) const BOTH: u8 = 0x06;
    pub(super) const TOO_DIM: u8 = 0x25;
    pub(super) const NO_DOT: u8 = 0x35;
}

/// Distance below which the camera does not see the dot at all. A guess.
const BLIND_MM: f64 = 60.0;
/// Half the width of the dot: the first reading on the hand of (A) is mostly a dim one.
const DOT_RAD: f64 = 0.45 * PI / 180.0;
/// Bend of a surface that calls for a corner check: in the middle of the dot, in its outer part,
/// and between neighbouring beams; parts of the distance. A right angle bends by 1.6 % in the
/// middle of the dot, by 1 % if it is 0.15 degrees off, and by 0.35 % if it is 0.35 degrees off.
const BEND_IN_MIDDLE: f64 = 0.0105;
const BEND_IN_DOT: f64 = 0.0035;
const BEND_AROUND: f64 = 0.02;
/// Share of the turns in which a corner gives two dots in one picture: 8 of 71 if a beam meets it.
/// Straight lines through the walls of (A) put its corners at 56.2, 141.7, 229.5 and 309.1 degrees.
/// The corner 0.2 degrees ahead of a beam gave a double dot in 89 of 117 turns. Those 0.1 ahead,
/// 0.3 behind and half way between two beams gave one in 351. A guess from so few.
const DOUBLE_IN_MIDDLE: f64 = 8.0 / 71.0;
const DOUBLE_AHEAD: f64 = 0.75;
const _: () = assert!(DOUBLE_IN_MIDDLE < DOUBLE_AHEAD, "a draw may rule out both");
/// Angle ahead within which a near object may shadow the dot, degrees, and its maximum distance, as
/// a part of the dot's. With 38 mm between laser and camera and an object at 0.3 m that is 7
/// degrees at most.
const SHADOW_DEGREES: usize = 7;
const SHADOWING: f64 = 0.93;
const DEG_PER_RAD: f64 = 180.0 / PI;
/// Triangulation: distances come in steps of d^2 / K, 1.33 mm at 2.68 m (B).
const QUANTUM_MM: f64 = 5.4e6;
/// Nearer than this the steps are below a tenth of a millimetre.
const UNQUANTISED_MM: f64 = 735.0;
/// Weakest dot that gives a distance, and weakest one that is noticed.
const STRENGTH_MIN: f64 = 2.5;
const STRENGTH_DIM: f64 = 2.0;
/// Strongest return of a white surface, seen in (A).
const STRENGTH_MAX: f64 = 1_200.0;
/// Odds that a wall spoils the dot in both ways: (A) outside of hand and corners.
const FLAW_BOTH: f64 = 3e-5;

/// Correlation of a degree's noise from turn to turn: the von Neumann ratios of (A), over degrees
/// without the hand, are 0.95 of distances and 0.86 of strengths; 1 means none.
const RANGE_KEPT: f64 = 0.10;
const STRENGTH_KEPT: f64 = 0.18;

/// Height of the beam above the floor, metres: it lies on the robot. A guess.
const HEIGHT_M: f64 = 0.10;

/// The optics with their noise and their readings of the last turn.
#[derive(Clone, Debug)]
pub(super) struct Eye {
    pub(super) mount: Mount,
    pub(super) optics: Optics,
    /// Whether the laser is off, so that the sensor measures no distance.
    pub(super) dark: bool,
    /// Reported distance divided by measured distance.
    pub(super) range_factor: f64,
    detail: Detail,
    laws: Laws,
    /// Noise of each degree in the turn before, of range and strength.
    before: Box<[[f64; 2]; 360]>,
    range: Rng,
    strength: Rng,
    beam: Rng,
    /// Last true distance per degree, millimetres; infinite without a dot. Decides where a closer
    /// look is worth its ray casts. The first degrees are repeated behind the last.
    seen_mm: Box<[f64; 360 + SHADOW_DEGREES]>,
    /// The scene, and the part of it that the beam meets.
    views: Option<[Scene; 2]>,
}

impl Eye {
    pub(super) fn new(mount: Mount, optics: Optics, seed: u64, name: &str) -> Self {
        Self {
            mount,
            optics,
            dark: false,
            range_factor: 1.0,
            detail: Detail::default(),
            laws: Laws::EVEN,
            before: Box::new([[0.0; 2]; 360]),
            range: Rng::stream(seed, &format!("{name}.range")),
            strength: Rng::stream(seed, &format!("{name}.strength")),
            beam: Rng::stream(seed, &format!("{name}.beam")),
            seen_mm: Box::new([f64::INFINITY; 360 + SHADOW_DEGREES]),
            views: None,
        }
    }

    /// Applies firmware and detail. With detail the noise of 2.1 differs; without detail all units
    /// have the noise of 2.4.
    #[must_use]
    pub(super) fn of(mut self, profile: Profile, detail: Detail) -> Self {
        self.detail = detail;
        self.laws = Laws::of(profile, detail);
        self
    }

    /// Adds a part of the last turn's noise to the noise of the same degree.
    fn remembering(&mut self, slot: usize, noise: Noise) -> Noise {
        if self.detail == Detail::Even {
            return noise;
        }
        let kept =
            |part: f64, before: f64, fresh: f64| part * before + (1.0 - part * part).sqrt() * fresh;
        let [range, strength] = self.before[slot];
        let range = kept(RANGE_KEPT, range, noise.range);
        let strength = kept(STRENGTH_KEPT, strength, noise.strength);
        self.before[slot] = [range, strength];
        Noise {
            range,
            strength,
            ..noise
        }
    }

    /// The place that a beam meets.
    fn place(&self, beam: Beam, hit: Hit) -> Place {
        if self.detail == Detail::Even {
            return Place::PLAIN;
        }
        Place::at(beam.place(hit.distance))
    }

    /// Measures once: reading `slot` of the turn, head at `angle_deg`, at `at`. The number of draws
    /// does not depend on the result.
    pub(super) fn measure(
        &mut self,
        world: &World,
        at: Instant,
        slot: u16,
        angle_deg: f64,
    ) -> RawReading {
        let raw = self.look(world, at, slot, angle_deg);
        match Reading::from(raw) {
            Reading::Range {
                distance_mm,
                strength,
                weak,
            } if self.range_factor != 1.0 => RawReading::from(Reading::Range {
                distance_mm: whole(f64::from(distance_mm) * self.range_factor),
                strength,
                weak,
            }),
            _ => raw,
        }
    }

    fn look(&mut self, world: &World, at: Instant, slot: u16, angle_deg: f64) -> RawReading {
        let noise = Noise {
            angle: normal(&mut self.beam),
            chance: self.beam.uniform(),
            range: normal(&mut self.range),
            strength: normal(&mut self.strength),
        };
        let noise = self.remembering(usize::from(slot % 360), noise);
        let beam = self.beam_at(world, at, angle_deg, noise.angle);
        self.keep_view(world.scene());
        let seen = self.views.as_ref().map(|[_, seen]| seen);
        let hit = seen
            .and_then(|seen| beam.cast(seen, RANGE_MAX_MM / 1e3))
            .filter(|_| !self.dark);
        let mm = hit.map_or(f64::INFINITY, |hit| hit.distance * 1e3);
        let slot = usize::from(slot % 360);
        let behind = self.seen_mm[(slot + 359) % 360];
        let ahead = self.seen_mm[slot + 1];
        let shadowed = mm.is_finite() && self.may_be_shadowed(slot, mm);
        self.remember(slot, mm);
        let Some(hit) = hit else {
            return no_dot();
        };
        if shadowed && self.is_shadowed(beam, hit) {
            return no_dot();
        }
        let place = self.place(beam, hit);
        let hit = Hit {
            reflectivity: hit.reflectivity * place.reflects,
            ..hit
        };
        let noise = Noise {
            range: place.speckle.sqrt() * noise.range,
            strength: place.speckle * noise.strength,
            ..noise
        };
        if is_rough(behind, mm, ahead)
            && let Some(reading) = self.rough(beam, hit, [behind, ahead], &noise)
        {
            return reading;
        }
        smooth(mm + place.deeper_mm, hit, &noise, self.laws)
    }

    /// Renews the lidar's view of `scene` if the scene has changed.
    fn keep_view(&mut self, scene: &Scene) {
        let is_kept = |[whole, _]: &[Scene; 2]| whole.is_clone_of(scene);
        if !self.views.as_ref().is_some_and(is_kept) {
            self.views = Some([scene.clone(), scene.for_lidar(HEIGHT_M)]);
        }
    }

    fn cast(&self, at: Instant, from: Point, angle: f64, reach: f64) -> Option<Hit> {
        let [_, seen] = self.views.as_ref()?;
        seen.cast_ray(at, from, angle, reach)
    }

    fn beam_at(&self, world: &World, at: Instant, angle_deg: f64, jitter: f64) -> Beam {
        let turned = match self.optics.direction {
            Direction::CounterClockwise => angle_deg,
            Direction::Clockwise => -angle_deg,
        };
        let degrees = self.mount.yaw_deg + self.optics.index0_deg + turned;
        let offset_m = self.optics.beam_offset_mm / 1e3;
        Beam::aim(
            world.pose_at(at),
            at,
            self.mount,
            degrees,
            self.laws.jitter_rad * jitter,
            offset_m,
        )
    }

    /// Looks to the sides of the dot, only where the neighbours make it worth a ray cast. `Some` if
    /// an edge or a corner lies in it.
    fn rough(
        &self,
        beam: Beam,
        hit: Hit,
        neighbours_mm: [f64; 2],
        noise: &Noise,
    ) -> Option<RawReading> {
        let mm = hit.distance * 1e3;
        let sense = match self.optics.direction {
            Direction::CounterClockwise => DOT_RAD,
            Direction::Clockwise => -DOT_RAD,
        };
        let look = |offset: f64| {
            self.cast(beam.at, beam.from, beam.angle + offset, RANGE_MAX_MM / 1e3)
                .map_or(f64::INFINITY, |hit| hit.distance * 1e3)
        };
        let sides = [-sense, sense].into_iter().zip(neighbours_mm);
        let mut jumps = sides
            .filter(|&(_, side_mm)| is_jump(mm, side_mm))
            .peekable();
        if jumps.peek().is_none() {
            // No corner spoils the dot more often, so the draw alone excludes it.
            if noise.chance >= DOUBLE_AHEAD {
                return None;
            }
            let share = corner_share(mm, [look(-sense), look(sense)], neighbours_mm);
            return (noise.chance < share).then(|| invalid(code::DOUBLE_DOT));
        }
        let mut edges = jumps.map(|(offset, side_mm)| (look(offset), side_mm));
        let (other_mm, _) = edges.find(|&(other_mm, side_mm)| {
            // A slanting wall has less than half of a degree's difference within the dot.
            other_mm.is_infinite() || (other_mm - mm).abs() > 0.5 * (side_mm - mm).abs()
        })?;
        Some(edge(mm, other_mm, hit, noise, self.laws))
    }

    /// Whether something near follows within the next degrees, as far as known, that may hide the
    /// dot from the camera.
    fn may_be_shadowed(&self, slot: usize, mm: f64) -> bool {
        // An object at `seen_mm` hides surfaces up to this many degrees from its edge.
        let reach_deg =
            |seen_mm: f64| self.optics.baseline_mm * (mm - seen_mm) / (mm * seen_mm) * DEG_PER_RAD;
        let ahead = &self.seen_mm[slot + 1..=slot + SHADOW_DEGREES];
        let mut degrees = -1.0;
        ahead.iter().any(|&seen_mm| {
            // One degree less: the edge may be that far before the beam that met the object.
            degrees += 1.0;
            seen_mm < SHADOWING * mm && reach_deg(seen_mm) > degrees
        })
    }

    /// Remembers the distance at `slot`.
    fn remember(&mut self, slot: usize, mm: f64) {
        self.seen_mm[slot] = mm;
        if slot < SHADOW_DEGREES {
            self.seen_mm[360 + slot] = mm;
        }
    }

    /// Whether something stands between the dot and the camera.
    fn is_shadowed(&self, beam: Beam, hit: Hit) -> bool {
        let dot = beam.place(hit.distance);
        let side = match self.optics.direction {
            Direction::CounterClockwise => self.optics.baseline_mm / 1e3,
            Direction::Clockwise => -self.optics.baseline_mm / 1e3,
        };
        let camera = beam.aside(side);
        let angle = libm::atan2(dot.y - camera.y, dot.x - camera.x);
        let reach = camera.distance(dot) - 0.01;
        reach > 0.0 && self.cast(beam.at, camera, angle, reach).is_some()
    }
}

/// Whether two neighbouring beams meet different objects.
fn is_jump(mm: f64, side_mm: f64) -> bool {
    (side_mm - mm).abs() > 30.0 + 0.03 * mm
}

/// The draws of one beam: three standard normal numbers and one in [0, 1).
#[derive(Clone, Copy, Debug)]
struct Noise {
    angle: f64,
    chance: f64,
    range: f64,
    strength: f64,
}

/// Whether the neighbours suggest an edge or a corner in the dot.
fn is_rough(behind: f64, mm: f64, ahead: f64) -> bool {
    let bend = (behind - mm) + (ahead - mm);
    bend.is_nan() || bend.abs() > BEND_AROUND * mm
}

/// Share of the turns in which a corner spoils the dot. The distances are those at the dot's two
/// sides, and a degree behind and ahead.
fn corner_share(mm: f64, sides_mm: [f64; 2], neighbours_mm: [f64; 2]) -> f64 {
    const PER_DOT: f64 = DOT_RAD * DEG_PER_RAD;
    let bend = sides_mm.map(|side| side - mm).iter().sum::<f64>().abs() / mm;
    // On the corner's own side the wall is not straight up to the neighbour.
    let [behind, ahead] = [0, 1].map(|side| {
        let at_neighbour = (neighbours_mm[side] - mm) * PER_DOT;
        (sides_mm[side] - mm - at_neighbour).abs()
    });
    if bend > BEND_IN_MIDDLE {
        DOUBLE_IN_MIDDLE
    } else if bend > BEND_IN_DOT && ahead > behind {
        DOUBLE_AHEAD
    } else {
        0.0
    }
}

/// A dot on an edge between two distances: (A) shows double dots, bad shapes, nothing at all, or a
/// dim dot of the near side.
fn edge(mm: f64, other_mm: f64, hit: Hit, noise: &Noise, laws: Laws) -> RawReading {
    let (near, far) = (mm.min(other_mm), mm.max(other_mm));
    match noise.chance {
        ..0.25 => invalid(code::DOUBLE_DOT),
        0.25..0.30 => invalid(code::TOO_WIDE),
        0.30..0.33 => invalid(code::TOO_DIM),
        0.33..0.45 => no_dot(),
        chance => {
            let covered = (chance - 0.45) / 0.55;
            let part = Hit {
                reflectivity: hit.reflectivity * covered.max(0.03),
                ..hit
            };
            // A dot that hardly touches the near side may appear anywhere up to half way.
            let mixed = if covered < 0.1 && far.is_finite() {
                near + (far - near) * (0.5 - 5.0 * covered)
            } else {
                near
            };
            smooth(mixed, part, noise, laws)
        }
    }
}

/// A dot on an even surface.
fn smooth(mm: f64, hit: Hit, noise: &Noise, laws: Laws) -> RawReading {
    if mm < RANGE_MIN_MM {
        return invalid(if mm < BLIND_MM {
            code::NO_DOT
        } else {
            code::TOO_WIDE
        });
    }
    // Facing has no visible influence in (A) up to 60 degrees; grazing light must fade somewhere.
    let facing = (hit.incidence * 2.0).min(1.0);
    let ceiling = STRENGTH_MAX * hit.reflectivity.max(1.0);
    let mean = (strength_mean(mm) * hit.reflectivity * facing).min(ceiling);
    let strength = (mean + (laws.strength)(mean) * noise.strength).max(1.0);
    if mean < STRENGTH_MIN {
        return invalid(if mean < STRENGTH_DIM {
            code::NO_DOT
        } else {
            code::TOO_DIM
        });
    }
    let rest = 1.0 - noise.chance;
    if rest < laws.too_wide + laws.too_dim + FLAW_BOTH {
        return match rest {
            ..FLAW_BOTH => RawReading::from(Reading::Invalid {
                code: code::BOTH,
                strength: 12,
            }),
            rest if rest < laws.too_dim => invalid(code::TOO_DIM),
            _ => invalid(code::TOO_WIDE),
        };
    }
    let noisy = (mm + (laws.range_mm)(mm) * noise.range).max(1.0);
    let quantised = if noisy < UNQUANTISED_MM {
        noisy
    } else {
        QUANTUM_MM / f64::from(rounded(QUANTUM_MM / noisy))
    };
    RawReading::from(Reading::Range {
        distance_mm: whole(quantised),
        strength: whole(strength),
        weak: is_weak(quantised, strength),
    })
}

fn invalid(code: u8) -> RawReading {
    RawReading::from(Reading::Invalid { code, strength: 0 })
}

fn no_dot() -> RawReading {
    invalid(code::NO_DOT)
}

/// Rounded to the wire's 16 bits.
fn whole(value: f64) -> u16 {
    u16::try_from(rounded(value)).unwrap_or(u16::MAX)
}

/// A positive number rounded to a whole one; faster than `round`, which calls into a library.
fn rounded(value: f64) -> u32 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a cast of a float saturates"
    )]
    let rounded = (value + 0.5) as u32;
    rounded
}

#[cfg(test)]
mod tests {
    use super::*;

    const WALL: Hit = Hit {
        distance: 1.0,
        incidence: 1.0,
        reflectivity: 1.0,
    };

    /// Draws without noise.
    fn quiet(chance: f64) -> Noise {
        Noise {
            angle: 0.0,
            chance,
            range: 0.0,
            strength: 0.0,
        }
    }

    fn range(distance_mm: u16, strength: u16) -> Reading {
        Reading::Range {
            distance_mm,
            strength,
            weak: false,
        }
    }

    fn code(code: u8, strength: u16) -> Reading {
        Reading::Invalid { code, strength }
    }

    fn smooth_at(mm: f64, chance: f64) -> Reading {
        Reading::from(smooth(mm, WALL, &quiet(chance), Laws::EVEN))
    }

    /// Finding T4: readings of an edge from 1 m to 3 m. 25 % are double, 5 % too wide, 3 % too dim,
    /// and 12 % are nothing. The others are the near side, but a tenth of them lies between both
    /// sides: half way, a quarter, an eightieth.
    #[test]
    fn the_dot_on_an_edge_is_what_the_draw_says() {
        let of = |chance| Reading::from(edge(1000.0, 3000.0, WALL, &quiet(chance), Laws::EVEN));
        assert_eq!([0.0, 0.249].map(of), [code(0x02, 0); 2]);
        assert_eq!([0.25, 0.299].map(of), [code(0x03, 0); 2]);
        assert_eq!([0.30, 0.329].map(of), [code(0x25, 0); 2]);
        assert_eq!([0.33, 0.449].map(of), [code(0x35, 0); 2]);
        // The dot's covered share is (0.725 - 0.45) / 0.55 = 0.5, so its strength is half of the
        // 100 at 1 m.
        assert_eq!(of(0.725), range(1000, 50));
        assert_eq!(of(0.45 + 0.55 * 0.11), range(1000, 11));
        // With a covered share of 0.05: 1000 + 2000 (0.5 - 0.25) = 1500 mm, strength 44.4 * 0.05 =
        // 2.2: too dim.
        assert_eq!(of(0.45 + 0.55 * 0.05), code(0x25, 0));
    }

    /// Finding T4: 400 mm beside 500 mm, near enough that the mixed dot is bright enough. Covered
    /// by 0.05, it is 400 + 100 * 0.25 = 425 mm; strength 553.6 * 0.05 = 27.7. With nothing behind,
    /// it is the near side. Which side the beam hit does not matter.
    #[test]
    fn a_dot_that_hardly_touches_is_seen_in_between() {
        let chance = 0.45 + 0.55 * 0.05;
        let of = |mm, other| match Reading::from(edge(mm, other, WALL, &quiet(chance), Laws::EVEN))
        {
            Reading::Range {
                distance_mm,
                strength,
                ..
            } => Some((distance_mm, strength)),
            Reading::Invalid { .. } => None,
        };
        assert_eq!(of(400.0, 500.0), Some((425, 28)));
        assert_eq!(of(500.0, 400.0), Some((425, 28)));
        assert_eq!(of(400.0, f64::INFINITY), Some((400, 31)));
    }

    /// Finding T4: the limits are 60 mm and 145 mm, each tried on both sides.
    #[test]
    fn what_is_too_near_is_too_wide_and_then_nothing() {
        assert_eq!(smooth_at(59.9, 0.0), code(0x35, 0));
        assert_eq!(smooth_at(60.0, 0.0), code(0x03, 0));
        assert_eq!(smooth_at(144.9, 0.0), code(0x03, 0));
        assert!(matches!(
            smooth_at(145.0, 0.0),
            Reading::Range {
                distance_mm: 145,
                ..
            }
        ));
    }

    /// Finding T4: of 100,000 readings of a wall 3 are double, the next 27 too dim, the next 73 too
    /// wide.
    #[test]
    fn a_wall_is_spoilt_for_no_reason_as_often_as_captured() {
        assert_eq!(smooth_at(1000.0, 1.0 - 2e-5), code(0x06, 12));
        assert_eq!(smooth_at(1000.0, 1.0 - 4e-5), code(0x25, 0));
        assert_eq!(smooth_at(1000.0, 1.0 - 2.9e-4), code(0x25, 0));
        assert_eq!(smooth_at(1000.0, 1.0 - 3.1e-4), code(0x03, 0));
        assert_eq!(smooth_at(1000.0, 1.0 - 1.02e-3), code(0x03, 0));
        assert_eq!(smooth_at(1000.0, 1.0 - 1.04e-3), range(1000, 100));
    }

    /// Finding T4: at 1 m a white wall gives 100; 2.5 is the least that gives a distance, 2 the
    /// least that is noticed. Grazing light counts from 60 degrees on, and 1200 is the most.
    #[test]
    fn strength_decides_whether_there_is_a_distance() {
        let of = |reflectivity, incidence, mm| {
            let hit = Hit {
                reflectivity,
                incidence,
                ..WALL
            };
            Reading::from(smooth(mm, hit, &quiet(0.0), Laws::EVEN))
        };
        assert_eq!(of(0.0251, 1.0, 1000.0), range(1000, 3));
        assert_eq!(of(0.0249, 1.0, 1000.0), code(0x25, 0));
        assert_eq!(of(0.0201, 1.0, 1000.0), code(0x25, 0));
        assert_eq!(of(0.0199, 1.0, 1000.0), code(0x35, 0));
        assert_eq!(of(1.0, 0.5, 1000.0), range(1000, 100));
        assert_eq!(of(1.0, 0.25, 1000.0), range(1000, 50));
        assert_eq!(of(1.0, 1.0, 200.0), range(200, 1200));
        assert_eq!(of(2.0, 1.0, 200.0), range(200, 2400));
    }

    /// Finding T4: a far distance is 5.4e6 divided by a whole number: 5.4e6 / 3001 = 1799.4, and
    /// 5.4e6 / 1799 = 3001.67. Below 735 mm there are no steps. One sigma of noise is 0.42 mm at
    /// 575 mm, and 9.50 mm at 2300 mm, because 4 to the power of 9/4 is 22.63.
    #[test]
    fn distances_come_in_steps_with_noise() {
        assert!(matches!(
            smooth_at(3001.0, 0.0),
            Reading::Range {
                distance_mm: 3002,
                ..
            }
        ));
        assert!(matches!(
            smooth_at(3000.0, 0.0),
            Reading::Range {
                distance_mm: 3000,
                ..
            }
        ));
        let noisy = |mm, range| {
            let noise = Noise {
                range,
                ..quiet(0.0)
            };
            match Reading::from(smooth(mm, WALL, &noise, Laws::EVEN)) {
                Reading::Range { distance_mm, .. } => distance_mm,
                Reading::Invalid { .. } => 0,
            }
        };
        // 575 + 10 * 0.42 mm; 2300 + 2 * 9.50 = 2319.0 mm, whose step is 5.4e6 / 2329 = 2318.6 mm.
        assert_eq!((noisy(575.0, 10.0), noisy(575.0, -10.0)), (579, 571));
        assert_eq!(noisy(2300.0, 2.0), 2319);
    }

    /// L7: the walls of a right angle at 1 m become 17.5 mm nearer for each degree to either side.
    /// If the corner is `off` degrees beside the beam, the bend is twice 17.5 (0.45 - off) mm: 10.5
    /// mm at 0.15 degrees, 3.5 mm at 0.35.
    #[test]
    fn l7_where_a_corner_lies_in_the_dot_decides_how_often_it_is_double() {
        let share = |off: f64| {
            let at = |degrees: f64| 1000.0 - 17.5 * (degrees - off).abs();
            let mm = at(0.0);
            corner_share(mm, [at(-0.45), at(0.45)], [at(-1.0), at(1.0)])
        };
        assert_eq!([-0.14, 0.0, 0.14].map(share), [8.0 / 71.0; 3]);
        assert_eq!([0.16, 0.24, 0.34].map(share), [0.75; 3]);
        assert_eq!([-0.34, -0.24, -0.16, 0.36, 0.5].map(share), [0.0; 5]);
        // A wall without a corner gives no double dot, however slanting it is.
        assert_eq!(corner_share(1000.0, [980.0, 1020.0], [955.6, 1044.4]), 0.0);
        // 9.6 mm of bend in a wall that falls by 9 mm to the dot's side: behind the dot, then
        // ahead.
        let slanting = |ends_mm| corner_share(1000.0, ends_mm, [980.0, 1020.0]);
        assert_eq!(slanting([981.4, 1009.0]), 0.0);
        assert_eq!(slanting([991.0, 999.4]), 0.75);
    }

    /// Finding T4: a jump is more than 30 mm and 3 %. At 1 m a side 60 mm away is the same object,
    /// one 61 mm away is another.
    #[test]
    fn a_jump_is_more_than_30_mm_and_3_per_cent() {
        assert!(!is_jump(1000.0, 1060.0) && !is_jump(1000.0, 940.0));
        assert!(is_jump(1000.0, 1061.0) && is_jump(1000.0, 939.0));
        assert!(is_jump(1000.0, f64::INFINITY));
    }

    /// Finding T4: a dot is rough if its neighbours bend by more than 2 % of 1 m in sum, in either
    /// direction, or are unknown.
    #[test]
    fn a_closer_look_is_worth_it_from_two_per_cent_on() {
        assert!(!is_rough(990.0, 1000.0, 990.0) && !is_rough(1010.0, 1000.0, 1010.0));
        assert!(is_rough(989.0, 1000.0, 990.0) && is_rough(1010.0, 1000.0, 1011.0));
        // A wall that only slopes is not rough.
        assert!(!is_rough(900.0, 1000.0, 1100.0));
        assert!(is_rough(f64::INFINITY, 1000.0, 1000.0));
        assert!(is_rough(f64::INFINITY, f64::INFINITY, 1000.0));
    }

    /// Readings of the beam at 90 degrees, straight ahead, in a thousand turns before `walls`.
    fn ahead_of(walls: Vec<crate::world::Shape>) -> Vec<Reading> {
        use crate::world::{BodyConfig, Obstacle, Pose};
        let scene = Scene::new(walls, Vec::<Obstacle>::new()).expect("sound");
        let body = BodyConfig {
            radius_m: 0.1,
            ..BodyConfig::default()
        };
        let world = World::new(scene, body, Pose::default(), 1).expect("free");
        let mut eye = Eye::new(Mount::default(), Optics::default(), 1, "lidar");
        let mut turn = |_| {
            let slots = (0..360).map(|slot| {
                let at = Instant::ZERO;
                eye.measure(&world, at, slot, f64::from(slot))
            });
            let turn: Vec<Reading> = slots.map(Reading::from).collect();
            turn[90]
        };
        turn(0);
        (0..1000).map(turn).collect()
    }

    fn wall(from: [f64; 2], to: [f64; 2]) -> crate::world::Shape {
        let [from, to] = [from, to].map(|[x, y]| Point::new(x, y));
        crate::world::Shape::Wall { from, to }
    }

    fn doubled(readings: &[Reading]) -> usize {
        let is = |reading: &&Reading| matches!(reading, Reading::Invalid { code: 0x02, .. });
        readings.iter().filter(is).count()
    }

    /// Finding T4: a quarter of the dots on an edge is double, whichever side the board ends on.
    /// Here the edge is 0.2 degrees away (3.5 mm at 1 m), the end of a board before a wall; at 1
    /// degree no dot is double.
    #[test]
    fn a_dot_on_the_edge_of_a_board_is_double_in_a_quarter_of_the_turns() {
        let far = wall([3.0, -3.0], [3.0, 3.0]);
        let board = |from: f64, to: f64| vec![far.clone(), wall([1.0, from], [1.0, to])];
        for edge in [board(-0.0035, 0.5), board(-0.5, 0.0035)] {
            let share = doubled(&ahead_of(edge));
            assert!((200..300).contains(&share), "{share} of 1000");
        }
        assert_eq!(doubled(&ahead_of(board(-0.0175, 0.5))), 0);
        assert_eq!(doubled(&ahead_of(board(-0.5, 0.0175))), 0);
    }

    /// A wall at ten degrees to the beam: its neighbours are 90 mm nearer and 110 mm farther away,
    /// and yet there is no edge.
    #[test]
    fn a_slanting_wall_has_no_edges() {
        let (sin, cos) = libm::sincos(10.0_f64.to_radians());
        let slanting = wall([1.0 - 0.4 * cos, -0.4 * sin], [1.0 + 2.0 * cos, 2.0 * sin]);
        let readings = ahead_of(vec![slanting]);
        assert_eq!(doubled(&readings), 0);
        let ranges = readings
            .iter()
            .filter(|reading| matches!(reading, Reading::Range { .. }));
        assert!(ranges.count() > 980);
    }

    fn eye(direction: Direction) -> Eye {
        let optics = Optics {
            direction,
            ..Optics::default()
        };
        Eye::new(Mount::default(), optics, 1, "lidar")
    }

    /// Laser and camera are 38 mm apart: an object at 300 mm hides 38 * 700 / 300,000 rad, 5.08
    /// degrees, of a wall at 1 m, so the search covers six degrees ahead and no more. At 93 % of
    /// the distance it is no separate object; a little nearer it hides only the next degree.
    #[test]
    fn a_shadow_is_looked_for_as_far_as_it_can_fall() {
        let may = |seen_mm: f64, ahead: usize| {
            let mut eye = eye(Direction::CounterClockwise);
            eye.remember((100 + ahead) % 360, seen_mm);
            eye.may_be_shadowed(100, 1_000.0)
        };
        let ahead = [0, 1, 2, 5, 6, 7, 8].map(|ahead| may(300.0, ahead));
        assert_eq!(ahead, [false, true, true, true, true, false, false]);
        assert_eq!(
            [may(931.0, 1), may(929.0, 1), may(929.0, 2)],
            [false, true, false]
        );
        // Behind the last degree is the first.
        let mut eye = eye(Direction::CounterClockwise);
        eye.remember(0, 300.0);
        assert!(eye.may_be_shadowed(359, 1_000.0) && !eye.may_be_shadowed(352, 1_000.0));
    }

    /// A dot 1 m ahead, seen from 38 mm to the left of the beam, or to its right if the head turns
    /// in the opposite direction. A post of 5 mm half way to the dot is 19 mm beside the beam.
    #[test]
    fn what_stands_between_dot_and_camera_hides_the_dot() {
        let is_hidden = |direction, post: [f64; 2]| {
            let circle = crate::world::Shape::Circle {
                center: Point::new(post[0], post[1]),
                radius_m: 0.005,
            };
            let shapes = vec![wall([1.0, -1.0], [1.0, 1.0]), circle];
            let scene = Scene::new(shapes, vec![]).expect("sound");
            let mut eye = eye(direction);
            eye.keep_view(&scene);
            let beam = Beam {
                at: Instant::ZERO,
                from: Point::default(),
                angle: 0.0,
                ahead: Point::new(1.0, 0.0),
            };
            eye.is_shadowed(beam, WALL)
        };
        let (left, right) = (Direction::CounterClockwise, Direction::Clockwise);
        assert!(is_hidden(left, [0.5, 0.019]) && !is_hidden(left, [0.5, -0.019]));
        assert!(is_hidden(right, [0.5, -0.019]) && !is_hidden(right, [0.5, 0.019]));
        assert!(!is_hidden(left, [0.5, 0.026]) && !is_hidden(left, [0.5, 0.012]));
        assert!(is_hidden(left, [0.25, 0.0285]) && !is_hidden(left, [1.05, 0.0]));
    }

    /// A sensor that reports 1.1 times its measurement: all other values stay.
    #[test]
    fn only_distances_are_told_wrong() {
        use crate::world::{BodyConfig, Pose};
        let scene = Scene::new(vec![wall([1.0, -1.0], [1.0, 1.0])], vec![]).expect("sound");
        let body = BodyConfig {
            radius_m: 0.1,
            ..BodyConfig::default()
        };
        let world = World::new(scene, body, Pose::default(), 1).expect("free");
        let [mut right, mut wrong] = [(); 2].map(|()| eye(Direction::CounterClockwise));
        wrong.range_factor = 1.1;
        let mut ranges = 0;
        for slot in 0..360 {
            let [right, wrong] = [&mut right, &mut wrong].map(|eye| {
                let raw = eye.measure(&world, Instant::ZERO, slot, f64::from(slot));
                Reading::from(raw)
            });
            match right {
                Reading::Range {
                    distance_mm,
                    strength,
                    weak,
                } => {
                    let told = libm::round(f64::from(distance_mm) * 1.1);
                    ranges += 1;
                    let Reading::Range {
                        distance_mm: found, ..
                    } = wrong
                    else {
                        panic!("{wrong:?}");
                    };
                    assert!((f64::from(found) - told).abs() < 0.5);
                    let same = Reading::Range {
                        distance_mm: found,
                        strength,
                        weak,
                    };
                    assert_eq!(wrong, same);
                }
                Reading::Invalid { .. } => assert_eq!(wrong, right),
            }
        }
        assert!(ranges > 80, "{ranges}");
    }

    /// In a unit without detail the noise of each turn is new. In a unit with detail a part of the
    /// last turn's noise of the same degree stays, and the deviation stays the same.
    #[test]
    fn the_noise_of_the_last_turn_stays_in_a_unit_with_detail() {
        let noise = |range, strength| Noise {
            range,
            strength,
            ..quiet(0.0)
        };
        let eye = || Eye::new(Mount::default(), Optics::default(), 1, "lidar");
        let mut even = eye();
        for _ in 0..2 {
            let found = even.remembering(7, noise(1.0, -2.0));
            assert_eq!((found.range, found.strength), (1.0, -2.0));
        }
        let mut captured = eye().of(Profile::Fw24, Detail::Captured);
        captured.remembering(7, noise(1.0, -2.0));
        let found = captured.remembering(7, noise(0.0, 0.0));
        let kept = |part: f64, fresh: f64| part * (1.0 - part * part).sqrt() * fresh;
        assert!((found.range - kept(RANGE_KEPT, 1.0)).abs() < 1e-12);
        assert!((found.strength - kept(STRENGTH_KEPT, -2.0)).abs() < 1e-12);
        let other = captured.remembering(8, noise(0.0, 0.0));
        assert_eq!((other.range, other.strength), (0.0, 0.0));
    }
}
