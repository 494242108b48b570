//! An example for each table of a scenario, as the reference shows it.

use crate::scenario::device;

/// Default first lines of an example.
const HEAD: &str = "schema = 1\nname = \"example\"\nrobot = \"rescue\"\nduration = \"20s\"\n\n";
/// Default last lines of an example.
const WORLD: &str = "\n[world]\nstart = { x_m = 1.0, y_m = 1.0, heading_deg = 90 }\n";

/// The example of a table, by its path such as `world.wall`, as the reference shows it.
pub fn example(path: &str) -> Option<&'static str> {
    let found = EXAMPLES.iter().find(|(name, _)| *name == path);
    found.map(|(_, text)| text.trim_start()).or_else(|| {
        let kind = path.strip_prefix("device.NAME.")?;
        let example = device::kind(kind)?.example();
        (!example.is_empty()).then_some(example)
    })
}

/// All examples as whole scenarios, each with the path of its table.
pub fn examples() -> Vec<(String, String)> {
    let kinds = device::kinds().into_iter();
    let kinds = kinds.map(|kind| format!("device.NAME.{}", kind.name()));
    let paths = EXAMPLES.iter().map(|(path, _)| (*path).to_owned());
    let whole = |path: String| {
        let shown = example(&path)?;
        let head = if shown.contains("schema =") { "" } else { HEAD };
        let is_whole = shown.lines().any(|line| line == "[world]");
        let world = if is_whole { "" } else { WORLD };
        Some((path, format!("{head}{shown}{world}")))
    };
    paths.chain(kinds).filter_map(whole).collect()
}

const EXAMPLES: [(&str, &str); 25] = [
    (
        "",
        r#"
schema = 1
name = "four-walls"
description = "there and back"
robot = "rescue"
duration = "60s"
seed = 7

[mission]
waypoints_m = [[1.0, 2.0], [1.0, 1.0]]

[expect]
visit_within_mm = 200

[world]
start = { x_m = 1.0, y_m = 1.0, heading_deg = 90 }

[[world.wall]]
path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]
"#,
    ),
    (
        "mission",
        r#"
[mission]
connect = "1s"
waypoints_m = [[1.0, 2.0], [1.0, 1.0]]
to_the_end = true
any_order = true
"#,
    ),
    (
        "exec.NAME",
        r#"
[exec.planner]
command = 'python3 planner.py "$HILRIG_PORT_ORDERS"'
"#,
    ),
    (
        "cable.NAME",
        r#"
[cable.plan]
baud = 115200
master = "orders"
device = "drives"

[[fault]]
link = "plan"
direction = "to-device"
kind = "drop"
rate = 0.01
"#,
    ),
    (
        "team.NAME",
        r#"
[team.blue]
robot = "yellow"
start = { x_m = 2.0, y_m = 1.0, heading_deg = 90 }

[[team.blue.mission.step]]
at = "2s"
do = { mode = "reactive" }

[[team.blue.fault]]
kind = "drop"
link = "telemetry"
direction = "to-master"
rate = 0.1

[team.blue.expect]
violations_max = 0
"#,
    ),
    (
        "mission.step",
        r#"
[[mission.step]]
at = "2s"
do = { drive = [20, 20] }

[[mission.step]]
at = "4s"
do = { mode = "stop" }

[[mission.step]]
when = { pose = { near_m = [1.5, 1.9], within_m = 0.3 } }
timeout = "20s"
do = "disconnect"
"#,
    ),
    (
        "expect",
        r#"
[expect]
visit_within_mm = 200
return_within_mm = 200
settle = "5s"
pose_rms_mm_max = 30
heading_rms_deg_max = 2
wall_overlap_min = 0.8
violations_max = 0
map_received = true
"#,
    ),
    (
        "program",
        r#"
[program]
start_mode = "exploration"
mapper = "document"
cpu = "ideal"
"#,
    ),
    (
        "link.NAME",
        r#"
[link.base]
latency = "1ms"
"#,
    ),
    (
        "fault",
        r#"
[[fault]]
kind = "flip"
link = "base"
direction = "to-device"
rate = 0.01
from = "10s"
until = "15s"

[[fault]]
kind = "off"
device = "lidar"
from = "5s"
lasting = "2s"
"#,
    ),
    (
        "expect.rule",
        r#"
[[expect.rule]]
name = "slow"
always = { axis = { name = "left wheel", op = "<=", value = 35 } }

[[expect.rule]]
name = "answers"
after = { frame = { link = "base", direction = "to-device" } }
within = "100ms"
eventually = { frame = { link = "base", direction = "to-master" } }

[[expect.rule]]
name = "near-a-wall"
sometimes = { robot = { of = "clearance-m", op = "<", value = 0.1 } }
"#,
    ),
    (
        "fault.when",
        r#"
[[fault]]
kind = "cut"
link = "lidar"
direction = "to-master"
when = { near_m = [1.0, 2.0], within_m = 0.3 }
lasting = "1s"
"#,
    ),
    (
        "budget",
        r#"
[budget]
total = 100
at_once = 3
"#,
    ),
    (
        "phases",
        r#"
[phases]
warm_up = "6s"
adversity = "5s"
recovery = "4s"
judgement = "5s"
"#,
    ),
    (
        "world",
        r#"
[world]
start = { x_m = 1.0, y_m = 1.0, heading_deg = 90 }
bounds = { min_m = [0, 0], max_m = [3, 3] }
"#,
    ),
    (
        "world.body",
        r#"
[world.body]
axle_m = 0.24
full_speed_m_s = 0.3
slip = [0.02, 0.0]
"#,
    ),
    (
        "world.wall",
        r#"
[[world.wall]]
path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7]]
reflectivity = 0.7
"#,
    ),
    (
        "world.polygon",
        r#"
[[world.polygon]]
corners_m = [[1.8, 1.8], [2.2, 1.8], [2.2, 2.2]]
"#,
    ),
    (
        "world.pillar",
        r#"
[[world.pillar]]
at_m = [[2.0, 0.5], [2.0, 2.0]]
radius_m = 0.025
"#,
    ),
    (
        "world.maze",
        r#"
[world]
start = { x_m = 0.375, y_m = 0.375, heading_deg = 0 }
maze = { seed = 3, columns = 4, rows = 3 }
"#,
    ),
    (
        "world.heat",
        r#"
[[world.heat]]
from_m = [2.7, 1.0]
to_m = [2.7, 1.1]
"#,
    ),
    (
        "world.slick",
        r#"
[[world.slick]]
min_m = [0.6, 0.6]
max_m = [1.8, 2.4]
grip = 0.02
"#,
    ),
    (
        "world.line",
        r#"
[[world.line]]
from_m = [0.8, 0.2]
to_m = [0.8, 2.8]
width_m = 0.05
"#,
    ),
    (
        "world.moving",
        r#"
[[world.moving]]
path_m = [[0.6, 2.4], [2.4, 2.4]]
speed_m_s = 0.5
radius_m = 0.15
repeat = "ping-pong"
"#,
    ),
    (
        "world.push",
        r#"
[[world.push]]
at = "3s"
by_m = [0.2, 0.0]
turn_deg = 30
over = "500ms"
"#,
    ),
];
