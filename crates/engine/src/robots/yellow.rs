//! Yellow, a course's robot of 2019: two wheels, six IR sensors, an RPLIDAR, a PC over WiFi.
//!
//! | link | device end | master end |
//! |---|---|---|
//! | `lidar` | RPLIDAR UART | program, 115200 baud |
//! | `lidar-motor` | RPLIDAR motor pin | program, one byte a duty |
//! | `board` | motor board | program, registers as frames |
//! | `telemetry` | PC, behind a WiFi bridge | program, 38400 baud |
//!
//! Half of the robot's software runs on the PC: maps, paths, localisation. That program is the
//! device at the other end of `telemetry`.

mod body;
mod command;
mod instruments;
mod maps;
mod overlays;
mod remote;
mod script;
mod station;

use emulators::world::Chassis;
use firmware_core::Master as _;
use firmware_core::pose::Pose;
use firmware_core::robots::yellow::pc::{PcConfig, PcProgram, Votes};
use firmware_core::robots::yellow::{Config, Yellow};
use protocols::LineConfig;

use super::ignored::OF_RESCUE;
use super::{
    Alone, Dut, PcEnd, ProgramPort, RemoteStation, Robot, WirePlan, Wired, board_settings,
};
use crate::near;
use crate::rig::Rig;
use crate::rig::line::End;
use crate::scenario::device::{Built, MotorSpec, RPLIDAR, RplidarSpec, WHEEL_BOARD};
use crate::scenario::{DeviceSpec, Scenario, ScenarioError, Source};

use instruments::YellowInstruments;
use script::script;
use station::PcStation;

/// Name of the PC, as a device and as an open end.
const PC: &str = "pc";
/// Link to the PC.
const TELEMETRY: &str = "telemetry";
/// The chip's own hardware, as a device, and the link to it.
const BOARD: &str = "board";
const LINKS: [&str; 4] = ["lidar", "lidar-motor", BOARD, TELEMETRY];

/// Bytes that the bridge hands over at once.
const TELEMETRY_PIECE: usize = 16;

/// Situations that a campaign must cause: possible events on each link.
const SITUATIONS: [&str; 7] = [
    "encoder samples disbelieved",
    "lidar resyncs",
    "lidar silences",
    "radio bad frames",
    "manual time-outs",
    "arrivals",
    "escapes",
];

/// The robot.
#[derive(Clone, Copy, Debug)]
pub(super) struct YellowRobot;

impl Robot for YellowRobot {
    fn name(&self) -> &'static str {
        "yellow"
    }

    fn about(&self) -> &'static str {
        "two wheels, six IR sensors, RPLIDAR; a PC maps, localises and navigates over WiFi"
    }

    fn chassis(
        &self,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Option<Box<dyn Chassis>>, ScenarioError> {
        body::chassis(scenario, source).map(Some)
    }

    fn wire(&self, plan: WirePlan<'_>) -> Result<Wired, ScenarioError> {
        wire(plan)
    }

    fn program(
        &self,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Option<Alone>, ScenarioError> {
        alone(scenario, source).map(Some)
    }

    fn board_settings(
        &self,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Vec<(&'static str, String)>, ScenarioError> {
        let (config, _) = configs(scenario, source)?;
        let words = board_settings::words(
            scenario,
            (&config, Config::DEFAULT),
            (Config::tell, Config::set),
            |id| Config::DEFAULT.with_defect(id).is_some(),
        );
        words.ok_or_else(|| board_settings::untold(source))
    }

    fn ignores(&self, _scenario: &Scenario) -> &'static [&'static str] {
        &OF_RESCUE
    }

    fn situations(&self) -> &'static [&'static str] {
        &SITUATIONS
    }

    fn defects(&self) -> Vec<&'static str> {
        Config::defects().chain(PcConfig::defects()).collect()
    }

    fn remote(&self) -> Option<(Box<dyn RemoteStation>, LineConfig)> {
        Some(remote::remote())
    }
}

fn wire(plan: WirePlan<'_>) -> Result<Wired, ScenarioError> {
    let WirePlan {
        scenario,
        source,
        world,
        dut,
        pc,
    } = plan;
    check_names(scenario, source)?;
    let (config, pc_config) = configs(scenario, source)?;
    let lidar_spec = lidar_spec(scenario, source)?;
    let lidar = lidar_spec.build("lidar", scenario.seed, source)?;
    let board = board(scenario, source, &world)?;
    let scanner = lidar_spec.scanner().map(|_| lidar_spec);
    let mut rig = Rig::new(world);
    let lidar_node = rig.add_boxed_device("lidar", lidar.device);
    let board_node = rig.add_boxed_device(BOARD, board.device);
    let mut wired = Wired::new(rig, YellowInstruments::new(scanner));
    let program = match dut {
        Dut::Internal => {
            let program = Box::new(Yellow::new(config));
            Some(wired.rig.add_program("program", program))
        }
        Dut::External => None,
    };
    let ports = [
        (lidar_node, Some(lidar.ports[0]), Yellow::LIDAR),
        (lidar_node, lidar.ports.get(1).copied(), Yellow::LIDAR_MOTOR),
        (board_node, Some(board.ports[0]), Yellow::BOARD),
    ];
    for (name, (node, info, port)) in LINKS.into_iter().zip(ports) {
        let Some(info) = info else {
            continue;
        };
        let device = End {
            node,
            port: info.port,
        };
        let master = match program {
            Some(node) => End { node, port },
            None => wired.open_end(name, info.line, info.connect),
        };
        wired.set_optional(master, info.is_optional);
        wired.set_rate(master, info.rate);
        let rig = &mut wired.rig;
        rig.connect_by(info.kind, name, device, master, info.piece);
    }
    connect_pc(&mut wired, pc, (scenario, source), pc_config, program)?;
    Ok(wired)
}

/// The PC at its link: the program in this process, or a foreign program.
fn connect_pc(
    wired: &mut Wired,
    pc: PcEnd,
    (scenario, source): (&Scenario, &Source),
    config: PcConfig,
    program: Option<usize>,
) -> Result<(), ScenarioError> {
    let script = script(&scenario.mission, source)?;
    let mut pc_program = PcProgram::new(config);
    maps::load(&mut pc_program, scenario, source)?;
    let line = pc_program.line_config(PcProgram::TELEMETRY);
    let port = PcProgram::TELEMETRY;
    let far = match pc {
        PcEnd::Scripted => {
            let station = PcStation::new(pc_program, script);
            let node = wired.rig.add_device(PC, station);
            End { node, port }
        }
        PcEnd::External => {
            let end = wired.open_end(PC, line, "your own PC program");
            if let Some(open) = wired.open_ends.last_mut() {
                TELEMETRY.clone_into(&mut open.link);
            }
            end
        }
    };
    let idle = !scenario.mission.gives_orders();
    wired.set_optional(far, idle);
    let near = match program {
        Some(node) => End {
            node,
            port: Yellow::TELEMETRY,
        },
        None => wired.open_end(TELEMETRY, line, "the robot's WiFi UART"),
    };
    wired.set_optional(near, idle);
    wired.rig.connect(TELEMETRY, far, near, TELEMETRY_PIECE);
    Ok(())
}

/// The program without a rig. On the real robot neither the motor pin nor the board is a UART.
fn alone(scenario: &Scenario, source: &Source) -> Result<Alone, ScenarioError> {
    check_names(scenario, source)?;
    let (config, _) = configs(scenario, source)?;
    let program = Yellow::new(config);
    let port = |name, port, is_optional| ProgramPort {
        name,
        port,
        line: program.line_config(port),
        is_optional,
    };
    let ports = vec![
        port("lidar", Yellow::LIDAR, false),
        port("lidar-motor", Yellow::LIDAR_MOTOR, true),
        port(BOARD, Yellow::BOARD, false),
        port(TELEMETRY, Yellow::TELEMETRY, false),
    ];
    Ok(Alone {
        program: Box::new(program),
        ports,
    })
}

/// The lidar, whose head the robot turns unless the scenario says otherwise.
fn lidar_spec(scenario: &Scenario, source: &Source) -> Result<DeviceSpec, ScenarioError> {
    let plain = || {
        let plain = DeviceSpec::plain(RPLIDAR);
        plain.map_err(|error| source.invalid(None, "device.lidar.rplidar", error.message()))
    };
    let mut spec = match scenario.device.get("lidar") {
        Some(spec) => spec.clone(),
        None => plain()?,
    };
    if let Some(settings) = spec.settings_mut::<RplidarSpec>() {
        settings.motor.get_or_insert(MotorSpec::Pwm);
    }
    Ok(spec)
}

fn board(
    scenario: &Scenario,
    source: &Source,
    world: &emulators::world::World,
) -> Result<Built, ScenarioError> {
    let built = scenario.build_device(BOARD, WHEEL_BOARD, source)?;
    if let Some(spec) = scenario.device.get(BOARD) {
        spec.check(BOARD, source, built.device.as_ref(), world)?;
    }
    Ok(built)
}

fn check_names(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    for (name, spec) in &scenario.device {
        let kind = match name.as_str() {
            "lidar" => "rplidar",
            BOARD => "wheel-board",
            _ if spec.is_own() => continue,
            _ => {
                let message = near::expected(name, &["lidar", BOARD]);
                return Err(source.invalid(source.find(name), format!("device.{name}"), message));
            }
        };
        if spec.kind() != kind {
            let message = format!("is of kind {}, expected {kind}", spec.kind());
            return Err(source.invalid(source.find(name), format!("device.{name}"), message));
        }
    }
    for name in scenario.link.keys() {
        let is_own = scenario.device.contains_key(name);
        if !is_own && !LINKS.contains(&name.as_str()) {
            let message = near::expected(name, &LINKS);
            return Err(source.invalid(source.find(name), format!("link.{name}"), message));
        }
    }
    if scenario.program.start_mode.is_some() {
        let message = "expected none: the robot begins at rest, and its PC orders the mode";
        let span = source.find("start_mode");
        return Err(source.invalid(span, "program.start_mode", message));
    }
    Ok(())
}

/// Fixed settings of robot and PC: the start pose, and the defects of the fielded programs.
fn configs(scenario: &Scenario, source: &Source) -> Result<(Config, PcConfig), ScenarioError> {
    let start = scenario.world.start_pose();
    #[expect(clippy::cast_possible_truncation, reason = "millimetres fit an f32")]
    let [x_mm, y_mm, heading] = [start.x * 1000.0, start.y * 1000.0, start.theta].map(|v| v as f32);
    let start = Pose::new(x_mm, y_mm, heading);
    let mut config = Config {
        start,
        ..Config::default()
    };
    let mut pc_config = PcConfig {
        seed: scenario.seed,
        start: Some(start),
        votes: scenario.program.votes.map(Votes::from).unwrap_or_default(),
        ..PcConfig::default()
    };
    for id in &scenario.program.defects {
        let name = id.get_ref().as_str();
        if let Some(with) = config.with_defect(name) {
            config = with;
        } else if let Some(with) = pc_config.with_defect(name) {
            pc_config = with;
        } else {
            let known: Vec<&str> = Config::defects().chain(PcConfig::defects()).collect();
            return Err(source.unknown("program.defects", id, &known));
        }
    }
    Ok((config, pc_config))
}
