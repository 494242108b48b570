//! Missions with faults, made of a seed or of a string of bytes: world, mission, timing and faults.
//!
//! Each of the four has a stream of chance of its own (`generate.world` and so on), or a lane of
//! its own in the bytes, so that another fault never moves a wall. Whole kinds of faults are off in
//! some missions and on in others, because what one kind hides another brings to light.
//!
//! What goes wrong ends early enough that the mission must succeed afterwards.

mod dice;

use core::fmt::Write as _;
use core::str::FromStr;

use crate::scenario::{Action, FaultSpec, LinkSpec, Scenario, Span, Step, WorldSpec};
pub use dice::Dice;
use dice::Draw;

/// What is made anew; the rest is as in the scenario that it starts from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Vary {
    /// Walls, obstacles and start.
    pub world: bool,
    /// Where to go, and what else the PC does.
    pub mission: bool,
    /// When things begin and how long they take on the way.
    pub timing: bool,
    /// What goes wrong.
    pub faults: bool,
}

impl Vary {
    /// Everything.
    pub const ALL: Self = Self {
        world: true,
        mission: true,
        timing: true,
        faults: true,
    };
}

impl FromStr for Vary {
    type Err = String;

    /// Reads `all`, `none`, or a list such as `world,faults`.
    fn from_str(text: &str) -> Result<Self, String> {
        let mut vary = Self::default();
        for word in text.split(',') {
            match word {
                "all" => vary = Self::ALL,
                "none" => {}
                "world" => vary.world = true,
                "mission" => vary.mission = true,
                "timing" => vary.timing = true,
                "faults" => vary.faults = true,
                _ => {
                    let expected = "expected all, none, or some of world,mission,timing,faults";
                    return Err(format!("\"{word}\": {expected}"));
                }
            }
        }
        Ok(vary)
    }
}

impl core::fmt::Display for Vary {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let parts = [
            ("world", self.world),
            ("mission", self.mission),
            ("timing", self.timing),
            ("faults", self.faults),
        ];
        let named: Vec<_> = parts
            .iter()
            .filter(|part| part.1)
            .map(|part| part.0)
            .collect();
        f.write_str(if named.is_empty() { "none" } else { "" })?;
        f.write_str(&named.join(","))
    }
}

/// Faults live from here, milliseconds: before the robot has its mission.
const ADVERSITY_FROM_MS: u64 = 300;
/// And end here.
const ADVERSITY_UNTIL_MS: u64 = 14_000;
/// From then on the mission has this long, milliseconds: three ways through the room at a third
/// of the robot's speed.
const RECOVERY_MS: u64 = 90_000;
/// Most faults of a mission.
const FAULTS_MAX: u64 = 12;

/// The scenario that `dice` make of `base`.
pub fn scenario(base: &Scenario, vary: Vary, dice: &mut Dice) -> Scenario {
    let mut made = base.clone();
    let plan = Plan::draw(&mut dice.world, &mut dice.mission);
    if vary.world {
        made.world = plan.world();
    }
    if vary.world || vary.mission {
        made.mission.waypoints_m = plan.waypoints.clone();
        made.mission.step = steps(&plan.waypoints, &mut dice.mission);
        made.expect.visit_within_mm = Some(200.0);
        made.expect.return_within_mm = None;
        made.expect.wall_overlap_min = None;
    }
    if vary.timing {
        made.mission.connect = Span::from_millis(dice.timing.between(100, 1500));
        for name in ["lidar", "radio", "pc"] {
            let latency = Span::from_millis(dice.timing.between(0, 12));
            made.link.insert(name.to_owned(), LinkSpec { latency });
        }
    }
    if vary.faults {
        made.fault = faults(&mut dice.faults);
        made.duration = Span::from_millis(ADVERSITY_UNTIL_MS + RECOVERY_MS);
        // What a device hears through a bad line is no fault of who spoke, and where the robot
        // believes to be while it cannot see is not what is judged here.
        made.expect.violations_max = None;
        made.expect.pose_rms_mm_max = None;
        made.expect.heading_rms_deg_max = None;
        made.expect.map_received = None;
    }
    made
}

/// Nine places in a room of 2.4 m, each free, a waypoint or taken by an obstacle.
struct Plan {
    start: [f64; 2],
    heading_deg: u64,
    obstacles: Vec<([f64; 2], u64)>,
    waypoints: Vec<[f64; 2]>,
}

impl Plan {
    fn draw(world: &mut Draw, mission: &mut Draw) -> Self {
        let mut places: Vec<[f64; 2]> = Vec::new();
        for row in [0.8, 1.5, 2.2] {
            places.extend([0.8, 1.5, 2.2].map(|column| [column, row]));
        }
        let start = places.remove(world.index(places.len()));
        let heading_deg = world.below(360);
        let mut obstacles = Vec::new();
        for _ in 0..world.below(3) {
            let place = places.remove(world.index(places.len()));
            let nudge = [world.below(11), world.below(11)];
            let nudge = nudge.map(|cm| (cm as f64 - 5.0) / 100.0);
            let size_mm = world.between(25, 120);
            obstacles.push(([place[0] + nudge[0], place[1] + nudge[1]], size_mm));
        }
        let count = 1 + mission.below(3);
        let waypoints = (0..count).map(|_| places.remove(mission.index(places.len())));
        Self {
            start,
            heading_deg,
            obstacles,
            waypoints: waypoints.collect(),
        }
    }

    /// The world as its text in a scenario says it.
    fn world(&self) -> WorldSpec {
        let mut text = format!(
            "start = {{ x_m = {:.2}, y_m = {:.2}, heading_deg = {} }}\n\
             bounds = {{ min_m = [0, 0], max_m = [3, 3] }}\n[[wall]]\n\
             path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n",
            self.start[0], self.start[1], self.heading_deg
        );
        for ([x, y], size_mm) in &self.obstacles {
            let radius = *size_mm as f64 / 1000.0;
            write!(
                text,
                "[[pillar]]\nat_m = [[{x:.2}, {y:.2}]]\nradius_m = {radius:.3}\n"
            )
            .expect("a string takes everything");
        }
        toml::from_str(&text).expect("a room as people write it")
    }
}

/// What the PC does besides sending the mission: it sends it once more, or hangs up for a while.
fn steps(waypoints: &[[f64; 2]], dice: &mut Draw) -> Vec<Step> {
    let mut steps = Vec::new();
    for _ in 0..dice.below(4) {
        let at = dice.between(2_000, ADVERSITY_UNTIL_MS - 2_000);
        if dice.below(2) == 0 {
            let action = Action::WaypointsM(waypoints.to_vec());
            steps.push((at, action));
        } else {
            steps.push((at, Action::Disconnect));
            steps.push((at + dice.between(100, 1_500), Action::Connect));
        }
    }
    steps.sort_by_key(|&(at, _)| at);
    let step = |(at, action)| Step {
        at: Span::from_millis(at),
        action,
    };
    steps.into_iter().map(step).collect()
}

/// Links, and which way, on which something may go wrong.
const LANES: [(&str, &str); 7] = [
    ("lidar", "to-master"),
    ("base", "to-master"),
    ("base", "to-device"),
    ("radio", "to-master"),
    ("radio", "to-device"),
    ("pc", "to-master"),
    ("pc", "to-device"),
];
const KINDS: [&str; 5] = ["flip", "drop", "insert", "duplicate", "cut"];
/// Chances per byte, from one in ten thousand to one in thirty.
const RATES: [f64; 6] = [0.0001, 0.0003, 0.001, 0.003, 0.01, 0.03];

fn faults(dice: &mut Draw) -> Vec<FaultSpec> {
    let enabled: Vec<&str> = KINDS.into_iter().filter(|_| dice.below(2) == 1).collect();
    let count = dice.below(FAULTS_MAX + 1);
    if enabled.is_empty() {
        return Vec::new();
    }
    let fault = |_| {
        let (link, direction) = LANES[dice.index(LANES.len())];
        let kind = enabled[dice.index(enabled.len())];
        let from = dice.between(ADVERSITY_FROM_MS, ADVERSITY_UNTIL_MS - 100);
        let length_max = if kind == "cut" { 3_000 } else { 12_000 };
        let until = (from + dice.between(10, length_max)).min(ADVERSITY_UNTIL_MS);
        let rate = RATES[dice.index(RATES.len())];
        let rate = if kind == "cut" {
            String::new()
        } else {
            format!("rate = {rate}\n")
        };
        let text = format!(
            "link = \"{link}\"\ndirection = \"{direction}\"\nkind = \"{kind}\"\n{rate}\
             from = \"{from}ms\"\nuntil = \"{until}ms\"\n"
        );
        toml::from_str(&text).expect("a fault as people write it")
    };
    (0..count).map(fault).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn base() -> Scenario {
        let text = "schema = 1\nname = \"base\"\nrobot = \"rescue\"\nduration = \"5s\"\n\
            [world]\nstart = { x_m = 1.5, y_m = 1.5, heading_deg = 90 }\n[[world.wall]]\n\
            path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7]]\n";
        let parsed = Scenario::parse(Path::new("<test>"), text.to_owned());
        parsed.expect("sound").0
    }

    #[test]
    fn a_seed_is_always_the_same_mission_and_its_neighbour_another() {
        let make = |seed| scenario(&base(), Vary::ALL, &mut Dice::of_seed(seed));
        assert_eq!(make(7), make(7));
        assert_ne!(make(7), make(8));
    }

    /// The lanes are interleaved: byte 0 is the world's, byte 3 the faults'.
    #[test]
    fn other_bytes_for_the_faults_leave_world_mission_and_timing_alone() {
        let bytes: Vec<u8> = (0..=255).collect();
        let mut others = bytes.clone();
        others
            .iter_mut()
            .skip(3)
            .step_by(4)
            .for_each(|byte| *byte ^= 0x5A);
        let make = |bytes: &[u8]| scenario(&base(), Vary::ALL, &mut Dice::of_bytes(bytes));
        let (one, mut other) = (make(&bytes), make(&others));
        assert_ne!(one.fault, other.fault);
        other.fault = one.fault.clone();
        assert_eq!(one, other);
    }

    #[test]
    fn any_bytes_are_a_mission() {
        for bytes in [&[][..], &[0], &[255; 9], &[255; 600]] {
            let made = scenario(&base(), Vary::ALL, &mut Dice::of_bytes(bytes));
            assert!(!made.mission.waypoints_m.is_empty());
        }
    }

    #[test]
    fn what_is_not_varied_stays() {
        assert_eq!(
            scenario(&base(), Vary::default(), &mut Dice::of_seed(3)),
            base()
        );
    }

    #[test]
    fn kinds_of_faults_are_off_in_some_missions_and_on_in_others() {
        let kinds = |seed| {
            let made = scenario(&base(), Vary::ALL, &mut Dice::of_seed(seed));
            made.fault
                .iter()
                .filter(|fault| fault.kind.name() == "cut")
                .count()
        };
        let with = (0..100).filter(|&seed| kinds(seed) > 0).count();
        assert!((20..80).contains(&with), "{with} of 100 missions have cuts");
    }
}
