//! Generated buildings and paths through them: the input of a mapper, and the true poses. Corridors
//! on a grid, rooms behind doorways, halls with pillars, niches, glass, furniture; odometry with
//! small errors and occasional slips. On request with troubles: unseen motion, wheels in the air,
//! people, featureless or repeated corridors, a strong bias, short ranges, few beams.

mod plan;
mod rays;
mod trouble;

use emulators::rng::Rng;
use emulators::world::{Pose, wrap_angle};

use crate::mapping::motion::{between, moved};
use plan::{Plan, Style};
use rays::Rays;
use trouble::{People, Trouble};

/// A wall, or a pane of glass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// First end, metres.
    pub from: [f64; 2],
    /// Second end, metres.
    pub to: [f64; 2],
    /// Whether most beams pass through.
    pub is_glass: bool,
}

/// One scan on the path of a robot.
#[derive(Clone, Debug)]
pub struct Sight {
    /// True pose.
    pub truth: Pose,
    /// Motion since the previous scan by odometry with errors: metres and radians.
    pub moved: Pose,
    /// End points of the beams, metres in the robot's frame.
    pub ends: Vec<[f32; 2]>,
}

/// A building and a path through it.
#[derive(Clone, Debug)]
pub struct Building {
    /// All walls.
    pub walls: Vec<Wall>,
    /// The scans in order.
    pub sights: Vec<Sight>,
    /// Length of the path, metres.
    pub way_m: f64,
    /// The troubles, each as a word; empty without.
    pub troubles: Vec<&'static str>,
}

/// The pass through a building.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pass {
    /// The first pass.
    First,
    /// The same path with other noise; the number selects the noise.
    Again(u32),
    /// The path back, with other noise.
    Back,
}

/// The properties of robot, lidar and odometry.
struct Robot {
    beams: usize,
    field: f64,
    farthest_m: f64,
    noise_m: f64,
    lost: f64,
    step_m: f64,
    /// Errors of the odometry: share of the distance, share of the rotation, random and systematic
    /// radians per metre, and the rate of slips.
    scale: f64,
    turn: f64,
    drift: f64,
    bias: f64,
    slips: f64,
}

impl Robot {
    fn drawn(rng: &mut Rng) -> Self {
        let pick = |of: &[f64], rng: &mut Rng| {
            of[usize::try_from(rng.below(of.len() as u64)).unwrap_or(0)]
        };
        let field_deg = pick(&[180.0, 180.0, 240.0, 360.0], rng);
        Self {
            beams: if field_deg > 300.0 { 360 } else { 181 },
            field: field_deg.to_radians(),
            farthest_m: pick(&[8.0, 12.0, 20.0, 30.0, 50.0], rng),
            noise_m: rng.range(0.005, 0.02),
            lost: rng.range(0.0, 0.03),
            step_m: rng.range(0.2, 0.8),
            scale: rng.range(0.01, 0.05),
            turn: rng.range(0.02, 0.1),
            drift: rng.range(0.002, 0.03),
            bias: rng.range(-0.02, 0.02),
            slips: pick(&[0.0, 0.0, 0.005, 0.02], rng),
        }
    }

    /// A robot with a larger variety of lidars, and odometry with a strong bias.
    fn troubled(rng: &mut Rng) -> Self {
        let usual = Self::drawn(rng);
        let beams = [36, 61, 91, 181, 360][usize::try_from(rng.below(5)).unwrap_or(0)];
        let has_bias = rng.chance(0.3);
        let bias = rng.range(0.02, 0.045);
        let sign = if rng.chance(0.5) { 1.0 } else { -1.0 };
        // From 4 m to 80 m, short ranges as frequent as long ones.
        let farthest_m = 4.0 * libm::pow(20.0, rng.uniform());
        Self {
            beams,
            farthest_m,
            bias: if has_bias { sign * bias } else { usual.bias },
            ..usual
        }
    }

    /// The odometry of a motion.
    fn wheels(&self, moved: Pose, rng: &mut Rng) -> Pose {
        let way = libm::hypot(moved.x, moved.y);
        let part = 1.0 + self.scale * rng.gauss();
        let turn = moved.theta * (1.0 + self.turn * rng.gauss())
            + way * (self.bias + self.drift * rng.gauss());
        let slip = rng.range(-SLIP_MOST, SLIP_MOST);
        let slips = rng.chance(self.slips);
        let turn = turn + if slips { slip } else { 0.0 };
        Pose::new(moved.x * part, moved.y * part, wrap_angle(turn))
    }

    fn scan(&self, rays: &Rays, at: Pose, people: &[[f64; 2]], rng: &mut Rng) -> Vec<[f32; 2]> {
        let step = self.field / self.beams as f64;
        let mut ends = Vec::with_capacity(self.beams);
        for beam in 0..self.beams {
            let bearing = (beam as f64 + 0.5) * step - self.field / 2.0;
            let glass = rng.uniform();
            let noise = self.noise_m * rng.bell();
            let is_lost = rng.chance(self.lost);
            let range = rays.cast(at, at.theta + bearing, glass > GLASS_PASSES);
            let range = range.min(trouble::met(people, at, bearing)) + noise;
            if !is_lost && range < self.farthest_m && range > 0.05 {
                #[expect(clippy::cast_possible_truncation, reason = "metres")]
                ends.push([
                    (range * libm::cos(bearing)) as f32,
                    (range * libm::sin(bearing)) as f32,
                ]);
            }
        }
        ends
    }
}

/// Maximum rotation of a slip: 30 degrees.
const SLIP_MOST: f64 = 0.52;
/// Share of beams that pass through glass.
const GLASS_PASSES: f64 = 0.8;

impl Building {
    /// The building with this number, and a path of some hundred metres.
    pub fn generate(seed: u64) -> Self {
        Self::with_way(seed, 0.0)
    }

    /// The same building, and a path of at least this length.
    pub fn with_way(seed: u64, least_m: f64) -> Self {
        Self::passed(seed, least_m, Pass::First)
    }

    /// The same building, and another pass through it.
    pub fn passed(seed: u64, least_m: f64, pass: Pass) -> Self {
        let mut rng = Rng::stream(seed, "building.plan");
        let mut plan = Plan::drawn(&mut rng, least_m, Style::default());
        let robot = Robot::drawn(&mut Rng::stream(seed, "building.robot"));
        let noise = match pass {
            Pass::First => String::new(),
            Pass::Again(number) => format!(".again.{number}"),
            Pass::Back => ".back".to_owned(),
        };
        if pass == Pass::Back {
            plan.route.reverse();
        }
        Self::seen(seed, &noise, plan, &robot, &Trouble::default())
    }

    /// A building with troubles: some of unseen motion, wheels in the air, people, featureless or
    /// repeated corridors, strong bias, short ranges, few beams.
    pub fn troubled(seed: u64) -> Self {
        let mut rng = Rng::stream(seed, "building.trouble");
        let robot = Robot::troubled(&mut rng);
        let style = Style::drawn(seed, &mut rng);
        let mut plan = Rng::stream(seed, "building.trouble.plan");
        let plan = Plan::drawn(&mut plan, 0.0, style);
        let trouble = Trouble::drawn(style, &mut rng);
        Self::seen(seed, ".trouble", plan, &robot, &trouble)
    }

    /// The scans and the odometry of a robot that follows the route of a plan.
    fn seen(seed: u64, noise: &str, plan: Plan, robot: &Robot, trouble: &Trouble) -> Self {
        let rays = Rays::new(&plan.walls);
        let mut wheels = Rng::stream(seed, &format!("building.wheels{noise}"));
        let mut lidar = Rng::stream(seed, &format!("building.lidar{noise}"));
        let mut people = People::new(seed, trouble);
        let mut sights: Vec<Sight> = Vec::new();
        let mut way_m = 0.0;
        for step in walked(&plan.route, robot.step_m, &trouble.events) {
            let truth = step.truth;
            let by = sights.last().map(|last| match step.hidden {
                None => between(last.truth, truth),
                Some([unseen, _]) => between(moved(last.truth, unseen), truth),
            });
            way_m += by.map_or(0.0, |by| libm::hypot(by.x, by.y));
            let by = by.map_or(Pose::default(), |by| robot.wheels(by, &mut wheels));
            sights.push(Sight {
                truth,
                moved: match step.hidden {
                    None => by,
                    Some([_, air]) => moved(by, air),
                },
                ends: robot.scan(&rays, truth, people.around(truth), &mut lidar),
            });
        }
        Self {
            walls: plan.walls,
            sights,
            way_m,
            troubles: trouble.words.clone(),
        }
    }
}

/// Look-ahead distance of the robot, metres, and its maximum rotation per metre.
const AHEAD_M: f64 = 1.0;
const TURN_MOST: f64 = 0.9;
/// Step length, metres.
const STRIDE_M: f64 = 0.1;

/// A pose along a route.
struct Step {
    truth: Pose,
    /// The motion since the previous pose that the odometry misses, and the one that it reports
    /// while the robot stands.
    hidden: Option<[Pose; 2]>,
}

/// Poses along a route, one step apart, and one more after each event.
fn walked(route: &[[f64; 2]], step_m: f64, events: &[trouble::Event]) -> Vec<Step> {
    let [Some(first), Some(second)] = [route.first(), route.get(1)] else {
        return Vec::new();
    };
    let towards = |from: Pose, to: &[f64; 2]| libm::atan2(to[1] - from.y, to[0] - from.x);
    let mut pose = Pose::new(first[0], first[1], 0.0);
    pose.theta = towards(pose, second);
    let step = |truth, hidden| Step { truth, hidden };
    let mut poses = vec![step(pose, None)];
    let (mut since, mut way_m) = (0.0, 0.0);
    let mut events = events.iter().peekable();
    for target in &route[1..] {
        for _ in 0..100_000 {
            let far = libm::hypot(target[0] - pose.x, target[1] - pose.y);
            if far < AHEAD_M {
                break;
            }
            let off = wrap_angle(towards(pose, target) - pose.theta);
            let turn = off.clamp(-TURN_MOST * 0.3, TURN_MOST * 0.3);
            // The robot turns on the spot if the next point is behind it.
            let stride = if off.abs() > 0.8 { 0.0 } else { STRIDE_M };
            pose = moved(pose, Pose::new(stride, 0.0, turn));
            since += stride + 0.5 * turn.abs();
            way_m += stride;
            if since >= step_m {
                since = 0.0;
                poses.push(step(pose, None));
                if let Some(event) = events.next_if(|event| event.at_m <= way_m) {
                    let hidden = event.hidden(pose, *target);
                    pose = moved(pose, hidden[0]);
                    poses.push(step(pose, Some(hidden)));
                }
            }
        }
    }
    poses
}
