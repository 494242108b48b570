//! The rescue robot: XV-11 lidar, AVR base, HC-06 radio, and a PC at the other end of the air.
//!
//! | link | device end | master end |
//! |---|---|---|
//! | `lidar` | XV-11 UART | program, 115200 baud |
//! | `motor` | XV-11 motor pin | program, one byte a duty |
//! | `base` | AVR base | program, 1 Mbaud |
//! | `radio` | HC-06 UART | program, 460800 baud |
//! | `pc` | HC-06 air end | PC, at any rate |
//! | `display` | touch panel | program, 1 Mbaud; only if the scenario has a device `display` |

mod arena;
mod command;
mod display;
mod instruments;
pub mod pc_program;
mod station;
mod tuning;
mod view;

use core::time::Duration;

use emulators::avr_base::{self, AvrBaseConfig};
use emulators::hc06::Hc06;
use emulators::pc::{self, Pc};
use emulators::xv11;
use firmware_core::navigation::Sought;
use firmware_core::pc_link::Diagnose;
use firmware_core::pose::Pose;
use firmware_core::robots::rescue::{Config, Rescue, Turning};
use firmware_core::slam;
use protocols::avr::ChecksumOrder;
use protocols::pcui::message::{Mode, Order};
use protocols::{LineConfig, Port};

use super::{
    Alone, Arena, Console, Dut, PcEnd, ProgramPort, RemoteStation, Robot, Senses, Silence,
    WirePlan, Wired, board_settings,
};
use crate::near;
use crate::rig::Rig;
use crate::rig::cpu::CpuModel;
use crate::rig::line::End;
use crate::scenario::device::{AVR_BASE, DetailSpec, HC06, XV11};
use crate::scenario::{
    Action, AvrBaseSpec, CpuSpec, DeviceSpec, MapperSpec, Scenario, ScenarioError, SetPoint,
    Source, Step, Xv11Spec,
};

use arena::{ARENA, SITUATIONS};
use instruments::RescueInstruments;

/// The base stops the motors within 1.006 s of silence (field firmware, measured). A period of the
/// regulator, 40 ms, and an update of the checker are added.
const SILENCE: Silence = Silence {
    link: "base",
    silence_max: Duration::from_millis(1060),
};

/// A break, or three ESC, open the lidar's console and end its stream.
const CONSOLES: [Console; 1] = [("lidar", "lidar")];

/// Largest set-point that the fielded base follows, ticks per 40 ms.
const SET_POINT_MAX: i16 = 35;

const LINKS: [&str; 6] = ["lidar", "motor", "base", "radio", "pc", display::NAME];

/// Line of the lidar's motor pin. A duty is a level, not a message, so it arrives at once.
const PIN: LineConfig = LineConfig::new_8n1(10_000_000);

/// Blumenkamp's robot of 2015.
#[derive(Clone, Copy, Debug)]
pub struct RescueRobot;

impl Robot for RescueRobot {
    fn name(&self) -> &'static str {
        "rescue"
    }

    fn about(&self) -> &'static str {
        "XV-11 lidar, AVR base, HC-06 radio; maps and drives to waypoints"
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
        let order = order_of(base(scenario, source)?.profile);
        let config = program(scenario, order, source)?;
        let words = board_settings::words(
            scenario,
            (&config, Config::DEFAULT),
            (Config::tell, Config::set),
            |id| Config::DEFAULT.with_defect(id).is_some(),
        );
        words.ok_or_else(|| board_settings::untold(source))
    }

    /// 300 cells of 10 mm, or more in a build with a large map.
    fn map_m(&self) -> Option<[[f64; 2]; 2]> {
        #[expect(clippy::cast_precision_loss, reason = "some thousand cells")]
        let side = firmware_core::grid::SIDE as f64 / 100.0;
        Some([[0.0, 0.0], [side, side]])
    }

    fn arena(&self) -> Option<Arena> {
        Some(ARENA)
    }

    fn situations(&self) -> &'static [&'static str] {
        &SITUATIONS
    }

    fn defects(&self) -> Vec<&'static str> {
        Config::defects().collect()
    }

    fn senses(
        &self,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Option<Senses>, ScenarioError> {
        view::senses(scenario, source).map(Some)
    }

    fn remote(&self) -> Option<(Box<dyn RemoteStation>, LineConfig)> {
        let line = LineConfig::new_8n1(protocols::pcui::BAUD);
        Some((Box::new(station::alone()), line))
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
    let mut rig = Rig::new(world);
    rig.cpu = match scenario.program.cpu {
        CpuSpec::Stm32f4 => CpuModel::STM32F4,
        CpuSpec::Ideal => CpuModel::IDEAL,
    };
    let order = order_of(base(scenario, source)?.profile);
    let lidar = lidar_spec(scenario, source)?.build("lidar", scenario.seed, source)?;
    let base = scenario.build_device("base", AVR_BASE, source)?;
    let radio = scenario.build_device("radio", HC06, source)?;
    let ports = [
        ("lidar", lidar.ports[0], Rescue::LIDAR),
        ("motor", lidar.ports[1], Rescue::MOTOR),
        ("base", base.ports[0], Rescue::BASE),
        ("radio", radio.ports[0], Rescue::RADIO),
    ];
    let radio_air = radio.ports[1];
    let lidar_node = rig.add_boxed_device("lidar", lidar.device);
    let base_node = rig.add_boxed_device("base", base.device);
    let radio_node = rig.add_boxed_device("radio", radio.device);
    let nodes = [lidar_node, lidar_node, base_node, radio_node];

    let mut wired = Wired::new(rig, RescueInstruments);
    let program = match dut {
        Dut::Internal => {
            let program = Box::new(Rescue::new(program(scenario, order, source)?));
            Some(wired.rig.add_program("program", program))
        }
        Dut::External => None,
    };
    for ((name, info, port), node) in ports.into_iter().zip(nodes) {
        let device = End {
            node,
            port: info.port,
        };
        let master = match program {
            Some(node) => End { node, port },
            None => wired.open_end(name, info.line, info.connect),
        };
        // Without orders the radio is not needed.
        let is_idle = name == "radio" && !scenario.mission.gives_orders();
        wired.set_optional(master, info.is_optional || is_idle);
        wired.set_rate(master, info.rate);
        let rig = &mut wired.rig;
        rig.connect_by(info.kind, name, device, master, info.piece);
    }
    let air = End {
        node: radio_node,
        port: Hc06::AIR,
    };
    let far = match pc {
        PcEnd::Scripted => {
            let node = wired
                .rig
                .add_device("pc", Pc::new(script(scenario, source)?));
            End {
                node,
                port: Pc::AIR,
            }
        }
        PcEnd::External => wired.open_end("pc", radio_air.line, radio_air.connect),
    };
    wired.set_rate(far, radio_air.rate);
    wired.set_optional(far, !scenario.mission.gives_orders());
    wired.rig.connect("pc", air, far, 64);
    display::connect(&mut wired, scenario, source, program)?;
    Ok(wired)
}

/// The program alone. On a real board the motor's drive is not a UART.
fn alone(scenario: &Scenario, source: &Source) -> Result<Alone, ScenarioError> {
    check_names(scenario, source)?;
    let order = order_of(base(scenario, source)?.profile);
    let port = |name, port, is_optional| ProgramPort {
        name,
        port,
        line: line_of(port),
        is_optional,
    };
    Ok(Alone {
        program: Box::new(Rescue::new(program(scenario, order, source)?)),
        ports: vec![
            port("lidar", Rescue::LIDAR, false),
            port("motor", Rescue::MOTOR, true),
            port("base", Rescue::BASE, false),
            port("radio", Rescue::RADIO, false),
        ]
        .into_iter()
        .chain(display::has_one(scenario).then(|| port(display::NAME, Rescue::DISPLAY, true)))
        .collect(),
    })
}

/// The byte order of the base's checksum, which the program must share.
const fn order_of(profile: avr_base::Profile) -> ChecksumOrder {
    match profile {
        avr_base::Profile::Document => ChecksumOrder::LowFirst,
        avr_base::Profile::Rcj2015 | avr_base::Profile::Rcj2014 => ChecksumOrder::HighFirst,
    }
}

const fn line_of(port: Port) -> LineConfig {
    match port {
        Rescue::LIDAR => LineConfig::new_8n1(protocols::xv11::BAUD),
        Rescue::BASE => LineConfig::new_8n1(protocols::avr::BAUD),
        Rescue::RADIO => LineConfig::new_8n1(protocols::pcui::BAUD),
        Rescue::DISPLAY => LineConfig::new_8n1(protocols::panel::BAUD),
        _ => PIN,
    }
}

fn check_names(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    for (name, spec) in &scenario.device {
        let kind = match name.as_str() {
            "lidar" => "xv11",
            "base" => "avr-base",
            "radio" => "hc06",
            display::NAME => "touch-panel",
            _ if spec.is_own() => continue,
            _ => {
                let known = ["lidar", "base", "radio", display::NAME];
                let message = near::expected(name, &known);
                return Err(source.invalid(source.find(name), format!("device.{name}"), message));
            }
        };
        // The base's own firmware or a program may emulate the base.
        let stands_in = name == "base" && ["firmware", "program"].contains(&spec.kind());
        if spec.kind() != kind && !stands_in {
            let message = format!("is of kind {}, expected {kind}", spec.kind());
            return Err(source.invalid(source.find(name), format!("device.{name}"), message));
        }
    }
    for name in scenario.link.keys() {
        let is_own = scenario.device.get(name).is_some_and(DeviceSpec::is_own);
        if !is_own && !LINKS.contains(&name.as_str()) {
            let message = near::expected(name, &LINKS);
            return Err(source.invalid(source.find(name), format!("link.{name}"), message));
        }
    }
    Ok(())
}

/// The lidar, on even surfaces unless the scenario says otherwise: the figures of this robot's
/// missions were measured with even surfaces.
fn lidar_spec(scenario: &Scenario, source: &Source) -> Result<DeviceSpec, ScenarioError> {
    let plain = || {
        let plain = DeviceSpec::plain(XV11);
        plain.map_err(|error| source.invalid(None, "device.lidar.xv11", error.message()))
    };
    let mut spec = match scenario.device.get("lidar") {
        Some(spec) => spec.clone(),
        None => plain()?,
    };
    if let Some(settings) = spec.settings_mut::<Xv11Spec>() {
        settings.detail.get_or_insert(DetailSpec::Even);
    }
    Ok(spec)
}

/// Settings of the base.
fn base(scenario: &Scenario, source: &Source) -> Result<AvrBaseConfig, ScenarioError> {
    let spec = scenario.device.get("base");
    match spec.and_then(DeviceSpec::settings::<AvrBaseSpec>) {
        Some(spec) => spec.config("base", source),
        None => Ok(AvrBaseConfig::default()),
    }
}

/// The program knows packets of 22 bytes; the oldest firmware sends whole turns.
fn check_lidar(scenario: &Scenario, source: &Source) -> Result<(), ScenarioError> {
    let spec = scenario.device.get("lidar");
    let profile = spec
        .and_then(DeviceSpec::settings::<Xv11Spec>)
        .and_then(|spec| spec.profile.as_ref());
    match profile {
        Some(name) if name.get_ref() == xv11::Profile::Fw21.name() => Err(source.invalid(
            Some(name.span()),
            "device.lidar.xv11.profile",
            "the rescue robot's program reads packets of 22 bytes, which fw2.4.13386 and \
             fw2.6.15295 send; fw2.1 sends turns of 1446 bytes",
        )),
        _ => Ok(()),
    }
}

fn program(
    scenario: &Scenario,
    checksum_order: ChecksumOrder,
    source: &Source,
) -> Result<Config, ScenarioError> {
    check_lidar(scenario, source)?;
    let mut mapping = match scenario.program.mapper {
        MapperSpec::Best => slam::Settings::default(),
        MapperSpec::Document => slam::Settings::document(),
    };
    mapping.seed = scenario.seed;
    // The robot knows its start pose; map and world share their frame.
    let start = scenario.world.start_pose();
    #[expect(clippy::cast_possible_truncation, reason = "millimetres fit an f32")]
    let [x_mm, y_mm, heading] = [start.x * 1000.0, start.y * 1000.0, start.theta].map(|v| v as f32);
    mapping.start = Pose::new(x_mm, y_mm, heading);
    let initial_mode = match &scenario.program.start_mode {
        None => Mode::Stop,
        Some(name) => mode(name).map_err(|message| {
            let span = source.find("start_mode");
            source.invalid(span, "program.start_mode", message)
        })?,
    };
    let mut config = Config {
        checksum_order,
        mapping,
        initial_mode,
        display: display::fitted(scenario),
        sought: match base(scenario, source)?.heat {
            avr_base::Heat::None => Sought::Floor,
            avr_base::Heat::Fitted => Sought::FloorAndHeat,
        },
        ..Config::default()
    };
    if base(scenario, source)?.imu == avr_base::Imu::Fitted {
        config.turning = Turning::Gyroscope;
    }
    config.radio_setup = scenario
        .program
        .radio_baud
        .map(|found| Config::radio_setup(found.get()));
    if scenario.program.diagnosis {
        config.pc_link.diagnosis = Diagnose::EachSecond;
    }
    if let Some(spec) = &scenario.program.tuning {
        spec.get_ref().check().map_err(|flaw| {
            source.invalid(
                Some(spec.span()),
                format!("program.tuning.{}", flaw.key),
                flaw.message,
            )
        })?;
        tuning::tune(&mut config, spec.get_ref());
    }
    for id in &scenario.program.defects {
        config = config.with_defect(id.get_ref()).ok_or_else(|| {
            let known: Vec<&str> = Config::defects().collect();
            source.unknown("program.defects", id, &known)
        })?;
    }
    Ok(config)
}

/// Modes that the PC can order, by name; manual driving is a separate order.
const MODES: [(&str, Mode); 4] = [
    ("stop", Mode::Stop),
    ("exploration", Mode::Exploration),
    ("waypoint", Mode::Waypoint),
    ("explore", Mode::Explore),
];

/// The mode called `name`, or the expected names.
fn mode(name: &str) -> Result<Mode, String> {
    let found = MODES.iter().find(|(known, _)| *known == name);
    found.map(|(_, mode)| *mode).ok_or_else(|| {
        let known = MODES.map(|(name, _)| name).join(", ");
        format!("mode \"{name}\": expected one of {known}")
    })
}

fn millimetres(waypoints: &[[f64; 2]]) -> Vec<[i16; 2]> {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "clamped by the cast to the wire's range"
    )]
    let to_mm = |metres: f64| (metres * 1000.0).round() as i16;
    waypoints.iter().map(|place| place.map(to_mm)).collect()
}

fn script(scenario: &Scenario, source: &Source) -> Result<pc::Script, ScenarioError> {
    let mission = &scenario.mission;
    let mut steps = vec![pc::Step {
        when: pc::When::At(mission.connect.0),
        action: pc::Action::Open,
    }];
    if !mission.waypoints_m.is_empty() {
        let action = pc::Action::Waypoints(millimetres(&mission.waypoints_m));
        steps.push(pc::Step {
            when: pc::When::AfterConnected(Duration::from_millis(200)),
            action,
        });
    }
    // Steps with a condition are added when the condition becomes true.
    let mut timed: Vec<&Step> = Vec::new();
    let is_order = |(_, step): &(usize, &Step)| !step.action.is_of_the_rig();
    for (index, step) in mission.step.iter().enumerate().filter(is_order) {
        pc_action(&step.action).map_err(|message| {
            let span = source.find_in_list("mission.step", index, "do");
            source.invalid(span, format!("mission.step[{index}].do"), message)
        })?;
        timed.extend(step.at.map(|_| step));
    }
    timed.sort_by_key(|step| step.at);
    steps.extend(timed.into_iter().filter_map(|step| pc_step(step).ok()));
    pc::Script::new(steps)
        .map_err(|error| source.invalid(source.find("mission"), "mission", error.to_string()))
}

/// Converts a step of the mission to a step of the PC.
fn pc_step(step: &Step) -> Result<pc::Step, String> {
    Ok(pc::Step {
        when: pc::When::At(step.at.unwrap_or_default().0),
        action: pc_action(&step.action)?,
    })
}

/// Converts an action to the PC's action in the units of the wire.
///
/// # Errors
/// The expected modes or axes, if the robot does not have the given ones.
pub fn pc_action(action: &Action) -> Result<pc::Action, String> {
    Ok(match action {
        Action::Connect => pc::Action::Open,
        Action::Disconnect => pc::Action::Close,
        Action::WaypointsM(waypoints) => pc::Action::Waypoints(millimetres(waypoints)),
        Action::Mode(name) => pc::Action::Order(Order {
            mode: mode(name)?,
            set_point: [0, 0],
        }),
        Action::Drive(set_points) => pc::Action::Order(Order {
            mode: Mode::Manual,
            set_point: wheels(set_points)?,
        }),
        Action::Inject(_) | Action::Set(_) => {
            return Err(crate::robots::station::NOT_AN_ORDER.to_owned());
        }
    })
}

/// The wheels' set-points in the format of the wire.
fn wheels(set_points: &[SetPoint]) -> Result<[i8; 2], String> {
    let whole = set_points.iter().map(|one| i8::try_from(one.whole()?).ok());
    let whole: Option<Vec<i8>> = whole.collect();
    whole.and_then(|whole| whole.try_into().ok()).ok_or_else(|| {
        let shown: Vec<String> = set_points.iter().map(|one| one.0.to_string()).collect();
        format!(
            "drive [{}]: expected two set-points, left and right, whole ticks per 40 ms from -128 \
             to 127",
            shown.join(", ")
        )
    })
}
