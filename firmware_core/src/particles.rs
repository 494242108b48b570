//! Monte-Carlo localisation on a known map: many guesses are moved by the odometry, weighted by the
//! fit of the scan, and drawn again. For the part of a program that runs on a PC; feature `host`.
//!
//! Facts: `amcl` as seed 003 set it up (differential odometry model, likelihood field, 500 to 2,000
//! particles by the KLD criterion, no recovery); see [`Settings`]. Its odometry noise is far larger
//! than the car's, which makes it robust against slip; this localiser keeps that noise.

mod field;
mod motion;
#[cfg(test)]
mod tests;

use core::f64::consts::PI;

use alloc::collections::{BTreeMap, BTreeSet};
use alloc::vec::Vec;

pub use field::LikelihoodField;
pub use motion::Noise;

use crate::ackermann::{CarPose, Motion, wrapped};
use crate::random::Pcg32;

/// Edges of the boxes in which guesses are counted: metres, metres, radians.
const BOX: [f64; 3] = [0.5, 0.5, PI / 18.0];

/// Maximum distance between a beam's end and an obstacle for a fit, metres.
const FITS_M: f64 = 0.2;
/// Minimum number of beams for a statement about the fit.
const TELLING: usize = 10;

/// Settings of the weights and the number of guesses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Minimum and maximum number of guesses.
    pub count: [usize; 2],
    /// Maximum error of the distribution that the guesses represent; their number follows from it
    /// (KLD).
    pub kld_error: f64,
    /// Quantile of the normal distribution for the share of cases within that error: 2.326 for
    /// 99 %.
    pub kld_quantile: f64,
    /// Noise of the odometry.
    pub noise: Noise,
    /// Number of beams of a scan that are weighted, evenly chosen.
    pub beams: usize,
    /// Weight of a correct measurement, and of a random one; together 1.
    pub hit_and_random: [f64; 2],
    /// Standard deviation of a beam's end around the next obstacle, metres.
    pub hit_sigma_m: f64,
    /// Range of valid measurements, metres.
    pub range_m: [f64; 2],
    /// Minimum distance and turn after which a scan is weighted, metres and radians.
    pub moved: [f64; 2],
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            count: [500, 2_000],
            kld_error: 0.05,
            kld_quantile: 2.326,
            noise: Noise::default(),
            beams: 60,
            hit_and_random: [0.5, 0.5],
            hit_sigma_m: 0.2,
            range_m: [0.15, 6.0],
            moved: [0.05, 0.05],
        }
    }
}

/// A guess.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Particle {
    /// Possible pose of the robot.
    pub pose: CarPose,
    /// Likelihood; the sum over all guesses is 1.
    pub weight: f64,
}

/// A reading of the scanner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Direction in the robot's frame, radians counter-clockwise from ahead.
    pub bearing_rad: f64,
    /// Metres.
    pub range_m: f64,
}

/// Most likely pose of the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Mean of the heaviest cluster of guesses.
    pub pose: CarPose,
    /// Standard deviation of the positions of its guesses, metres.
    pub spread_m: f64,
    /// Share of the total weight in this cluster.
    pub share: f64,
}

/// The guesses.
#[derive(Clone, Debug)]
pub struct Localiser {
    /// Likelihood that a beam adds if it ends in a cell.
    weights: LikelihoodField,
    settings: Settings,
    particles: Vec<Particle>,
    random: Pcg32,
    /// The odometry's pose when a scan was last weighted.
    odometry: Option<CarPose>,
    /// Pose of the scanner on the robot.
    scanner: CarPose,
    fit: f64,
    /// Likelihood of a beam that ends near an obstacle.
    fitting: f64,
}

impl Localiser {
    /// Guesses around `start`, normally distributed by `sigma`: metres, metres, radians. The
    /// scanner sits at `scanner` on the robot.
    pub fn new(
        field: LikelihoodField,
        settings: Settings,
        scanner: CarPose,
        start: CarPose,
        sigma: [f64; 3],
        seed: u64,
    ) -> Self {
        let [hit, random] = settings.hit_and_random;
        let hit_sigma = settings.hit_sigma_m;
        let weight = |off: f64| {
            let fits = libm::exp(-off * off / (2.0 * hit_sigma * hit_sigma));
            let one = hit * fits + random / settings.range_m[1];
            // As amcl does: the beams are not independent, so their cubes are summed.
            one * one * one
        };
        let mut localiser = Self {
            weights: field.mapped(weight),
            settings,
            particles: Vec::new(),
            random: Pcg32::new(seed),
            odometry: None,
            scanner,
            fit: 1.0,
            fitting: weight(FITS_M),
        };
        localiser.place(start, sigma);
        localiser
    }

    /// Replaces all guesses by a given pose of the robot.
    pub fn place(&mut self, start: CarPose, sigma: [f64; 3]) {
        let count = self.settings.count[1].max(1);
        let weight = 1.0 / count as f64;
        let random = &mut self.random;
        let particles = (0..count).map(|_| Particle {
            pose: CarPose {
                x_m: start.x_m + random.normal(sigma[0]),
                y_m: start.y_m + random.normal(sigma[1]),
                heading_rad: wrapped(start.heading_rad + random.normal(sigma[2])),
            },
            weight,
        });
        self.particles = particles.collect();
        self.odometry = None;
    }

    /// All guesses.
    pub fn particles(&self) -> &[Particle] {
        &self.particles
    }

    /// Whether a scan would be weighted: the robot has moved since the last one.
    pub fn is_due(&self, odometry: CarPose) -> bool {
        self.odometry.is_none_or(|before| {
            let motion = before.motion_to(odometry);
            let way = libm::hypot(motion.ahead_m, motion.left_m);
            let [least_way, least_turn] = self.settings.moved;
            way >= least_way || motion.turn_rad.abs() >= least_turn
        })
    }

    /// Takes a scan, and the odometry's pose at its time. Returns whether the scan was weighted,
    /// which requires a motion since the last one.
    pub fn update(&mut self, odometry: CarPose, scan: &[Beam]) -> bool {
        if !self.is_due(odometry) {
            return false;
        }
        if let Some(before) = self.odometry {
            let motion = self.settings.noise.of(before.motion_to(odometry));
            for particle in &mut self.particles {
                particle.pose = motion.moved(particle.pose, &mut self.random);
            }
        }
        self.odometry = Some(odometry);
        self.weigh(scan);
        self.draw_anew();
        true
    }

    /// Handles a contradiction: another source reports a different motion than the odometry. Every
    /// second guess follows the other source.
    pub fn doubt(&mut self, told: Motion, other: Motion) {
        let back = told.inverse();
        for particle in self.particles.iter_mut().step_by(2) {
            particle.pose = particle.pose.then(back).then(other);
        }
    }

    /// Share of the last scan's beams that end near an obstacle of the map, for the best guess; 1
    /// if there were too few beams.
    pub const fn fit(&self) -> f64 {
        self.fit
    }

    /// Spreads a part of the guesses around the estimate, by `sigma`: the robot may be elsewhere.
    pub fn search(&mut self, part: f64, sigma: [f64; 3]) {
        let about = self.estimate().pose;
        let random = &mut self.random;
        for particle in &mut self.particles {
            if random.unit() < part {
                particle.pose = CarPose {
                    x_m: about.x_m + random.normal(sigma[0]),
                    y_m: about.y_m + random.normal(sigma[1]),
                    heading_rad: wrapped(about.heading_rad + random.normal(sigma[2])),
                };
            }
        }
    }

    /// The most likely pose of the robot.
    pub fn estimate(&self) -> Estimate {
        let mut boxes: BTreeMap<[i64; 3], f64> = BTreeMap::new();
        let all = || self.particles.iter().map(|one| (in_box(one.pose), one));
        for (at, particle) in all() {
            *boxes.entry(at).or_default() += particle.weight;
        }
        let heaviest = boxes.iter().max_by(|one, other| one.1.total_cmp(other.1));
        let heap = heaviest.map(|(heap, _)| *heap).unwrap_or_default();
        let is_near = |(at, _): &([i64; 3], &Particle)| {
            (at[0] - heap[0]).abs() <= 1
                && (at[1] - heap[1]).abs() <= 1
                && turned_boxes(at[2], heap[2]) <= 1
        };
        let near: Vec<&Particle> = all().filter(is_near).map(|(_, one)| one).collect();
        let share: f64 = near.iter().map(|one| one.weight).sum();
        let mean = |of: &dyn Fn(&Particle) -> f64| {
            near.iter().map(|one| one.weight * of(one)).sum::<f64>() / share
        };
        let (x_m, y_m) = (mean(&|one| one.pose.x_m), mean(&|one| one.pose.y_m));
        // Headings of a cluster lie within 30 degrees, so their mean is the mean of their offsets.
        let about = near.first().map_or(0.0, |one| one.pose.heading_rad);
        let off = mean(&|one| wrapped(one.pose.heading_rad - about));
        let pose = CarPose {
            x_m,
            y_m,
            heading_rad: wrapped(about + off),
        };
        let square = |one: &Particle| {
            let (x, y) = (one.pose.x_m - x_m, one.pose.y_m - y_m);
            x * x + y * y
        };
        Estimate {
            pose,
            spread_m: libm::sqrt(mean(&square).max(0.0)),
            share,
        }
    }

    fn weigh(&mut self, scan: &[Beam]) {
        let (origin_m, per_m) = self.weights.frame();
        let mut beams = self.usable(scan);
        beams.iter_mut().flatten().for_each(|along| *along *= per_m);
        let (mut whole, mut best) = (0.0, (0.0, CarPose::default()));
        for Particle { pose, weight } in &mut self.particles {
            let (sin, cos) = libm::sincos(pose.heading_rad);
            let x = (pose.x_m - origin_m[0]) * per_m;
            let y = (pose.y_m - origin_m[1]) * per_m;
            let mut likelihood = 1.0;
            for [ahead, left] in &beams {
                let end = [x + ahead * cos - left * sin, y + ahead * sin + left * cos];
                likelihood += self.weights.at(end);
            }
            *weight *= likelihood;
            whole += *weight;
            if likelihood > best.0 {
                best = (likelihood, *pose);
            }
        }
        self.fit = self.fit_at(best.1, &beams);
        let even = 1.0 / self.particles.len() as f64;
        for particle in &mut self.particles {
            particle.weight = match whole > 0.0 && whole.is_finite() {
                true => particle.weight / whole,
                false => even,
            };
        }
    }

    /// Share of `beams`, in cells in the robot's frame, that end near an obstacle for a robot at
    /// `pose`.
    fn fit_at(&self, pose: CarPose, beams: &[[f64; 2]]) -> f64 {
        if beams.len() < TELLING {
            return 1.0;
        }
        let (origin_m, per_m) = self.weights.frame();
        let (sin, cos) = libm::sincos(pose.heading_rad);
        let x = (pose.x_m - origin_m[0]) * per_m;
        let y = (pose.y_m - origin_m[1]) * per_m;
        let ends = beams
            .iter()
            .map(|[ahead, left]| [x + ahead * cos - left * sin, y + ahead * sin + left * cos]);
        let fitting = ends.filter(|end| self.weights.at(*end) >= self.fitting);
        fitting.count() as f64 / beams.len() as f64
    }

    /// Ends of the weighted beams, in the robot's frame.
    fn usable(&self, scan: &[Beam]) -> Vec<[f64; 2]> {
        let [near, far] = self.settings.range_m;
        let step = (scan.len() / self.settings.beams.max(1)).max(1);
        let beams = scan.iter().step_by(step);
        let beams = beams.filter(|beam| beam.range_m >= near && beam.range_m < far);
        let end = |beam: &Beam| {
            let (sin, cos) = libm::sincos(beam.bearing_rad);
            let end = self.scanner.then(Motion {
                ahead_m: beam.range_m * cos,
                left_m: beam.range_m * sin,
                turn_rad: 0.0,
            });
            [end.x_m, end.y_m]
        };
        beams.map(end).collect()
    }

    /// Draws as many new guesses as needed, in proportion to their weights.
    fn draw_anew(&mut self) {
        let mut sums = Vec::with_capacity(self.particles.len());
        let mut sum = 0.0;
        for particle in &self.particles {
            sum += particle.weight;
            sums.push(sum);
        }
        let [least, most] = self.settings.count;
        let mut drawn: Vec<Particle> = Vec::new();
        let mut boxes = BTreeSet::new();
        while drawn.len() < most.max(1) {
            let place = self.random.unit() * sum;
            let index = sums.partition_point(|sum| *sum <= place);
            let particle = self.particles[index.min(self.particles.len() - 1)];
            boxes.insert(in_box(particle.pose));
            drawn.push(particle);
            if drawn.len() >= least.max(self.needed(boxes.len())) {
                break;
            }
        }
        let weight = 1.0 / drawn.len() as f64;
        drawn.iter_mut().for_each(|one| one.weight = weight);
        self.particles = drawn;
    }

    /// Number of guesses needed if they occupy `boxes` boxes (Fox 2001).
    fn needed(&self, boxes: usize) -> usize {
        if boxes < 2 {
            return 0;
        }
        let k = (boxes - 1) as f64;
        let b = 2.0 / (9.0 * k);
        let root = 1.0 - b + libm::sqrt(b) * self.settings.kld_quantile;
        let count = k / (2.0 * self.settings.kld_error) * root * root * root;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "saturates"
        )]
        let count = libm::ceil(count) as usize;
        count
    }
}

fn in_box(pose: CarPose) -> [i64; 3] {
    let along = [pose.x_m, pose.y_m, pose.heading_rad];
    core::array::from_fn(|axis| {
        let boxes = along[axis] / BOX[axis];
        #[expect(clippy::cast_possible_truncation, reason = "saturates")]
        let whole = boxes as i64;
        // Rounded down, as the cast is towards zero.
        whole.saturating_sub(i64::from(boxes < whole as f64))
    })
}

/// Number of heading boxes between two, in the shorter direction.
fn turned_boxes(one: i64, other: i64) -> i64 {
    let off = (one - other).rem_euclid(36);
    off.min(36 - off)
}
