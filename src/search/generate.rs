//! Missions with faults, made of a seed or of a string of bytes: world, mission, timing and faults.
//!
//! Each of the four has a stream of chance of its own (`generate.world` and so on), or a lane of
//! its own in the bytes, so that another fault never moves a wall. Whole kinds of faults are off in
//! some missions and on in others, because what one kind hides another brings to light.
//!
//! What goes wrong ends early enough that the mission must succeed afterwards.

mod dice;
mod fault_targets;
mod faults;
mod mission;
mod world;

use core::str::FromStr;

use crate::robots::{self, Robot};
use crate::scenario::{LinkSpec, Scenario, Span};
pub(crate) use dice::Dice;
use fault_targets::FaultTargets;
use faults::Adversity;
use world::Room;

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
/// And end here, but for those that wait for something.
const ADVERSITY_UNTIL_MS: u64 = 14_000;
/// From then on the mission has this long at least, milliseconds: for three ways through the room
/// at a third of the robot's speed, and half as long before it is given once more.
const RECOVERY_MS: u64 = 120_000;

/// The scenario that `dice` make of `base`.
pub(crate) fn scenario(base: &Scenario, vary: Vary, dice: &mut Dice) -> Scenario {
    let mut made = base.clone();
    let arena = robots::find(&base.robot).and_then(Robot::arena);
    let room = arena.map(|arena| Room::draw(arena, &mut dice.world));
    let room = room.filter(|_| vary.world);
    let targets = FaultTargets::of(base);
    if let Some(room) = &room {
        made.world = room.world();
    }
    if vary.world || vary.mission {
        let places = match room {
            Some(room) => room.free,
            // Where the scenario's own room has places to go to, only the scenario knows.
            None => base.mission.waypoints_m.clone(),
        };
        let waypoints = mission::waypoints(places, &mut dice.mission);
        made.mission.step = mission::steps(&waypoints, &mut dice.mission);
        made.mission.waypoints_m = waypoints;
        made.expect.visit_within_mm = Some(200.0);
        made.expect.settle = Some(Span::from_millis(dice.mission.between(2_000, 4_000)));
        made.expect.return_within_mm = None;
        made.expect.wall_overlap_min = None;
    }
    if vary.timing {
        made.mission.connect = Span::from_millis(dice.timing.between(100, 1500));
        for name in targets
            .links()
            .filter(|&name| Some(name) != targets.hasty())
        {
            let latency = Span::from_millis(dice.timing.between(0, 12));
            made.link.insert(
                name.to_owned(),
                LinkSpec {
                    latency,
                    ..LinkSpec::default()
                },
            );
        }
    }
    if vary.faults {
        let adversity = Adversity::draw(&targets, &made.mission.waypoints_m, &mut dice.faults);
        adversity.apply(&mut made);
    }
    made
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;

    use super::*;
    use crate::scenario::FaultKind;

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
        (other.budget, other.phases) = (one.budget, one.phases);
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

    fn kinds(seed: u64) -> BTreeSet<&'static str> {
        let made = scenario(&base(), Vary::ALL, &mut Dice::of_seed(seed));
        made.fault.iter().map(|fault| fault.kind.name()).collect()
    }

    #[test]
    fn kinds_of_faults_are_off_in_some_missions_and_on_in_others() {
        let with = (0..200).filter(|&seed| kinds(seed).contains("cut")).count();
        assert!(
            (10..190).contains(&with),
            "{with} of 200 missions have cuts"
        );
    }

    /// The rescue robot has links, and devices that know every fault of a device.
    #[test]
    fn every_kind_of_fault_comes_up() {
        let seen: BTreeSet<&str> = (0..400).flat_map(kinds).collect();
        let all: BTreeSet<&str> = FaultKind::ALL.iter().map(|kind| kind.name()).collect();
        assert_eq!(seen, all);
    }

    /// Links and devices are those of the robot as the scenario fits it out.
    #[test]
    fn a_display_is_disturbed_if_there_is_one() {
        let mut fitted = base();
        let display = toml::from_str("[touch-panel]").expect("a display");
        fitted.device.insert("display".to_owned(), display);
        let places = |base: &Scenario| -> BTreeSet<String> {
            let made = |seed| scenario(base, Vary::ALL, &mut Dice::of_seed(seed));
            let faults = (0..50).flat_map(|seed| made(seed).fault);
            faults.filter_map(|fault| fault.link).collect()
        };
        let [without, with] = [places(&base()), places(&fitted)];
        assert_eq!(Vec::from_iter(without), ["base", "lidar", "pc", "radio"]);
        assert_eq!(
            Vec::from_iter(with),
            ["base", "display", "lidar", "pc", "radio"]
        );
    }

    /// What was made is sound, and means the same when it is read from its file.
    #[test]
    fn a_mission_survives_its_file() {
        for seed in 0..100 {
            let made = scenario(&base(), Vary::ALL, &mut Dice::of_seed(seed));
            let text = made.to_toml();
            let (read, source) = Scenario::parse(Path::new("<made>"), text).expect("sound");
            assert_eq!(read.to_toml(), made.to_toml(), "seed {seed}");
            let run = crate::run::Run::new(read, &source, None);
            assert!(
                run.is_ok(),
                "seed {seed}: {}",
                run.err().expect("it is none")
            );
        }
    }
}
