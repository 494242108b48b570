//! Wires the robot of a scenario into its world, and reports all mistakes of its parts at once.

use emulators::world::{BodyConfig, Pose as WorldPose, Scene, Shape, World};

use super::{Dut, PcEnd, Robot, WirePlan, Wired, add_devices, bounds, devices, links, of};
use crate::scenario::world::BodySpec;
use crate::scenario::{NO_ROBOT, Scenario, ScenarioError, Source};

/// Wires the scenario's robot into its world.
///
/// # Errors
/// If the scenario is invalid for the robot, or has further robots.
pub fn wire(
    scenario: &Scenario,
    source: &Source,
    dut: Dut,
    pc: PcEnd,
) -> Result<Wired, ScenarioError> {
    if !scenario.team.is_empty() {
        let message = "expected none here: several robots run with \"hilrig run\" and \"debug\", \
                       and without a program of your own also with \"ui\", \"campaign\", \"fuzz\" \
                       and \"shrink\"";
        return Err(source.invalid(source.find("team"), "team", message));
    }
    wire_first(scenario, source, dut, pc)
}

/// As [`wire`], also if the scenario has further robots: those are wired later, by
/// [`Run::with_team`](crate::run::Run::with_team).
///
/// # Errors
/// If the scenario is invalid for the robot.
pub fn wire_first(
    scenario: &Scenario,
    source: &Source,
    dut: Dut,
    pc: PcEnd,
) -> Result<Wired, ScenarioError> {
    let robot = of(scenario, source)?;
    if scenario.world.is_nowhere() && scenario.robot != NO_ROBOT {
        let message = "is missing, expected a table with the robot's start and the obstacles; \
                       robot = \"none\" needs no world";
        return Err(source.invalid(None, "world", message));
    }
    let checked = bounds::check_waypoints(robot, scenario, source);
    let mut wrong: Vec<ScenarioError> = checked.err().into_iter().collect();
    let plan = |world| WirePlan {
        scenario,
        source,
        world,
        dut,
        pc,
    };
    let chassis = robot.chassis(scenario, source);
    let world = match chassis {
        Ok(chassis) => scenario.world.build(scenario.seed, chassis, source),
        Err(error) => {
            wrong.extend(scenario.world.check(source).err());
            Err(error)
        }
    };
    match world {
        Ok(world) if wrong.is_empty() => return wire_into(plan(world)),
        Ok(world) => wrong.extend(wire_without_start(plan(world)).err()),
        Err(error) => {
            wrong.push(error);
            // Check all other parts too, in an empty world.
            if let Some(world) = stand_in(robot, scenario, source) {
                wrong.extend(wire_without_start(plan(world)).err());
            }
        }
    }
    Err(ScenarioError::all(wrong))
}

/// An empty world with the robot on its chassis, or on one with the default figures.
pub(super) fn stand_in(robot: &dyn Robot, scenario: &Scenario, source: &Source) -> Option<World> {
    let mut plain = scenario.clone();
    plain.world.body = BodySpec::default();
    let chassis = robot.chassis(scenario, source);
    let chassis = chassis.or_else(|_| robot.chassis(&plain, source)).ok()?;
    let scene = Scene::new([] as [Shape; 0], Vec::new()).ok()?;
    let start = WorldPose::default();
    let world = match chassis {
        Some(chassis) => World::with_chassis(scene, chassis, start),
        None => World::new(scene, BodyConfig::default(), start, scenario.seed),
    };
    world.ok()
}

/// As [`wire`], into another world than that of the scenario.
///
/// # Errors
/// If the scenario is invalid for the robot.
pub fn wire_into(plan: WirePlan<'_>) -> Result<Wired, ScenarioError> {
    let wired = wire_without_start(plan)?;
    // Their start takes real time, which must not pass in the run.
    wired.rig.start_nodes();
    Ok(wired)
}

/// As [`wire_into`], but programs that play devices start only if a fault of the scenario names
/// them.
///
/// # Errors
/// If the scenario is invalid for the robot.
pub fn wire_without_start(plan: WirePlan<'_>) -> Result<Wired, ScenarioError> {
    let (scenario, source) = (plan.scenario, plan.source);
    let wired = of(scenario, source)?.wire(plan);
    let mut wired = wired.map_err(|error| {
        // Faults on links that exist are judged with their links; their own keys are judged now.
        let faults = links::check_faults(scenario, source).err();
        ScenarioError::all([error].into_iter().chain(faults).collect())
    })?;
    let known: Vec<String> = wired.rig.device_names().map(str::to_owned).collect();
    let is_new = |name: &str| !known.iter().any(|known| known == name);
    add_devices(&mut wired, scenario, source, |name, spec| {
        spec.is_own() && is_new(name)
    })?;
    links::add_cables(&mut wired, scenario, source)?;
    let checks = [
        devices::check_drives(scenario, source),
        links::plan(&mut wired.rig, scenario, source),
        bounds::check_safety_links(&wired.rig, scenario, source),
        bounds::check_conditions(&wired, scenario, source),
    ];
    ScenarioError::none_of(checks.into_iter().filter_map(Result::err).collect())?;
    Ok(wired)
}

/// An empty world, for devices without a robot.
pub fn nowhere() -> World {
    let scene = Scene::new([] as [Shape; 0], Vec::new()).expect("an empty scene is valid");
    World::new(scene, BodyConfig::default(), WorldPose::default(), 0)
        .expect("an empty place is free")
}
