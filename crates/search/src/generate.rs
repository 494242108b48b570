//! Generated missions with faults: a seed or a string of bytes determines world, mission, timing
//! and faults.
//!
//! Each of the four parts has its own random stream (`generate.world` etc.), or its own lane in the
//! bytes: another fault never moves a wall. Each mission uses only some kinds of faults, because
//! one kind may hide the effect of another.
//!
//! The world is the scenario's own world with some objects moved, or a generated floor that suits
//! the robot. In both cases a planner with the true world checks that the robot fits along the
//! mission with a margin. Faults end early enough that the mission must succeed afterwards.

mod changes;
mod consoles;
mod dice;
mod fault_names;
mod fault_targets;
mod faults;
mod ground;
mod limits;
mod mission;
mod odd;
mod operator;
mod profile;
mod rooms;
mod rules;
mod world;

use core::str::FromStr;

pub use dice::Dice;
use engine::scenario::{LinkSpec, Scenario, ScenarioError, Source, Span};
use fault_targets::FaultTargets;
use faults::Adversity;
pub use profile::{MissionJudged, Profile};

/// The parts that are generated; the others are those of the scenario.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Vary {
    /// Walls, obstacles and start.
    pub world: bool,
    /// Waypoints, and further actions of the PC.
    pub mission: bool,
    /// Time of the connection, and latencies of links.
    pub timing: bool,
    /// Faults.
    pub faults: bool,
    /// The order of threads of a foreign program in virtual time.
    pub schedule: bool,
}

impl Vary {
    /// All parts of the scenario.
    pub const ALL: Self = Self {
        world: true,
        mission: true,
        timing: true,
        faults: true,
        schedule: false,
    };
}

impl FromStr for Vary {
    type Err = String;

    /// Reads `all`, `none`, or a list such as `world,faults`.
    fn from_str(text: &str) -> Result<Self, String> {
        let mut vary = Self::default();
        for word in text.split(',') {
            match word {
                "all" => {
                    vary = Self {
                        schedule: vary.schedule,
                        ..Self::ALL
                    };
                }
                "none" => {}
                "world" => vary.world = true,
                "mission" => vary.mission = true,
                "timing" => vary.timing = true,
                "faults" => vary.faults = true,
                "schedule" => vary.schedule = true,
                _ => {
                    let expected =
                        "expected all, none, or some of world,mission,timing,faults,schedule";
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
            ("schedule", self.schedule),
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

/// Version of the generator: a seed of another one is another run.
pub const GENERATOR: u32 = 2;
/// Time for a mission in a generated world, if the profile gives no recovery time, milliseconds.
const RECOVERY_MS: u64 = 120_000;
/// Distance from a waypoint of a generated mission within which it counts as visited, millimetres,
/// unless the scenario allows more.
const VISIT_WITHIN_MM: f64 = 200.0;

/// The reason why no fault of `profile` can be drawn for `base`, if there is one.
///
/// # Errors
/// If the scenario cannot be wired.
pub fn lack_of_faults(
    base: &Scenario,
    source: &Source,
    profile: &Profile,
) -> Result<Option<String>, ScenarioError> {
    Ok(FaultTargets::of(base, source, profile)?.lack(profile))
}

/// The variation of `base` that `dice` determine, with the faults of `profile`. `source` is that of
/// `base`: files that it names are relative to its folder. A scenario that cannot be wired gets no
/// faults; its run reports the reason.
pub fn scenario(
    base: &Scenario,
    source: &Source,
    vary: Vary,
    profile: &Profile,
    dice: &mut Dice,
) -> Scenario {
    let mut made = base.clone();
    let vary = Vary {
        // Generated walls leave room for one robot only.
        world: vary.world && base.team.is_empty(),
        ..vary
    };
    let targets = FaultTargets::of(base, source, profile).unwrap_or_default();
    // Devices without a robot have no mission to finish.
    let recovery = profile.afterwards.recovery.filter(|_| targets.has_body());
    let longest = [Span::default(), Span::from_millis(RECOVERY_MS)];
    let mut recovery = recovery.unwrap_or(longest[usize::from(targets.has_body())]);
    if mission::is_fixed(base) {
        if vary.world {
            world::vary_around(&mut made, dice);
        }
    } else if vary.world || vary.mission {
        let place = vary.world.then(|| world::vary(&mut made, dice)).flatten();
        let waypoints = match &place {
            Some(place) => place.waypoints(&mut dice.mission),
            // Only the scenario knows the valid destinations in its own room.
            None => mission::waypoints(base.mission.waypoints_m.clone(), &mut dice.mission),
        };
        if let Some(place) = &place {
            recovery = recovery.max(place.time_for(&waypoints));
        }
        let until = faults::end_of_trouble(profile, made.duration);
        made.mission.step = mission::steps(&waypoints, until, &mut dice.mission);
        made.mission.waypoints_m = waypoints;
        made.duration = made.duration.max(recovery);
        // A radius that a scenario allows its robot is valid for each goal.
        let own_mm = base.expect.visit_within_mm.unwrap_or(VISIT_WITHIN_MM);
        made.expect.visit_within_mm = Some(own_mm.max(VISIT_WITHIN_MM));
        made.expect.settle = Some(Span::from_millis(dice.mission.between(2_000, 4_000)));
        made.expect.return_within_mm = None;
        made.expect.wall_overlap_min = None;
        made.expect.golden = None;
        rules::keep_fitting(&mut made, place.is_some());
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
        let places = &made.mission.waypoints_m;
        let adversity = Adversity::draw(profile, &targets, places, made.duration, &mut dice.faults);
        let (has_faults, is_operator) = (adversity.has_faults(), adversity.is_operator());
        let walls_min = base.expect.wall_overlap_min;
        adversity.apply(profile, &mut made, recovery, walls_min);
        let is_fixed = mission::is_fixed(base);
        if has_faults {
            let end = made.duration;
            let turns = targets.turn().is_some();
            mission::keep_steering(profile, turns, &mut made.mission, end);
        }
        if has_faults && !is_fixed && mission::takes_orders(base) {
            let end = made.duration;
            mission::keep_busy(profile, &targets, &mut made.mission, end, &mut dice.mission);
        }
        if has_faults && mission::takes_orders(base) {
            odd::orders(profile, &targets.orders, &mut made, &mut dice.mission);
            operator::acts(
                profile,
                &targets.orders,
                is_operator,
                &mut made,
                &mut dice.mission,
            );
        } else if !has_faults && !is_fixed {
            odd::change(profile, &targets.orders, &mut made, &mut dice.mission);
            odd::last_long(profile, &mut made, &mut dice.mission);
        }
    }
    made
}

#[cfg(test)]
mod tests;
