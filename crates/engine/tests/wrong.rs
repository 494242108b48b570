//! Wrong scenarios: each key misspelt, each value of a wrong type, each name with an additional
//! letter. The mutation says what the message must contain: file, line, key, and the right word.

#![cfg(feature = "robots")]

use std::collections::BTreeSet;
use std::path::Path;

use hilrig_engine::robots::{self, Dut, PcEnd};
use hilrig_engine::scenario::Scenario;

/// A scenario with most tables of a robot of one's own.
const SOUND: &str = r#"schema = 1
name = "wrong"
description = "text"
robot = "custom"
duration = "20s"

[mission]
waypoints_m = [[2.2, 1.0]]

[[mission.step]]
at = "3s"
do = { set = { device = "wheels", name = "left-cm-s", value = 3 } }

[expect]
visit_within_mm = 150
violations_max = 0

[[expect.rule]]
name = "slow"
always = { robot = { of = "speed-m-s", op = "<", value = 1 } }

[chassis.differential]

[device.lidar.xv11]
profile = "fw2.6.15295"
supply = { fixed-v = 3.3 }
mount = { x_m = 0.05, heading_deg = 30 }

[device.wheels.registers]
baud = 115200
watchdog = "500ms"

[[device.wheels.registers.register]]
address = 1
name = "left-cm-s"
width = "i8"
access = "write"
limits = [-30, 30]
safe = 0
drives = { actuator = "left", speed_m_s = 0.01 }

[[device.wheels.registers.register]]
address = 4
name = "encoder-left"
width = "i32"
source = { encoder = "left" }

[device.meter]
description = "modbus-meter"

[[fault]]
kind = "flip"
link = "wheels"
direction = "to-device"
rate = 0.01
from = "2s"
until = "4s"

[link.wheels]
latency = "1ms"

[world.body]
axle_m = 0.26

[world]
start = { x_m = 1.0, y_m = 1.0, heading_deg = 0 }

[[world.wall]]
path_m = [[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [0.0, 2.0], [0.0, 0.0]]
"#;

/// A key of the text and its value.
#[derive(Clone, Debug)]
struct Entry {
    line: usize,
    key: core::ops::Range<usize>,
    value: core::ops::Range<usize>,
}

/// All keys with their values, also those within others.
fn entries() -> Vec<Entry> {
    let starts = SOUND.match_indices(" = ").map(|(at, _)| at);
    starts
        .map(|at| {
            let is_of_key = |c: char| c.is_ascii_alphanumeric() || "_-".contains(c);
            let begin = SOUND[..at]
                .rfind(|c| !is_of_key(c))
                .map_or(0, |end| end + 1);
            let value = at + 3;
            Entry {
                line: 1 + SOUND[..at].matches('\n').count(),
                key: begin..at,
                value: value..value + value_len(&SOUND[value..]),
            }
        })
        .collect()
}

/// Length of the value at the beginning of `text`.
fn value_len(text: &str) -> usize {
    let (mut depth, mut is_quoted) = (0, false);
    for (at, c) in text.char_indices() {
        match c {
            '"' => is_quoted = !is_quoted,
            '[' | '{' if !is_quoted => depth += 1,
            ']' | '}' if !is_quoted && depth > 0 => depth -= 1,
            ',' | '\n' | '}' if !is_quoted && depth == 0 => return text[..at].trim_end().len(),
            _ => {}
        }
    }
    text.len()
}

/// The error of a scenario, also one that shows only when the robot is wired.
fn error(text: &str) -> Option<String> {
    let read = Scenario::parse(Path::new("s.toml"), text.to_owned());
    let wired = read.and_then(|(scenario, source)| {
        robots::wire(&scenario, &source, Dut::External, PcEnd::Scripted).map(drop)
    });
    wired.err().map(|error| error.to_string())
}

fn with(text: &str, part: &core::ops::Range<usize>, new: &str) -> String {
    format!("{}{new}{}", &text[..part.start], &text[part.end..])
}

/// Words of this program, which no file has.
fn has_type_name(said: &str) -> bool {
    let words: BTreeSet<&str> = said
        .split(|c: char| !c.is_ascii_alphanumeric() && !"_-".contains(c))
        .collect();
    let types = [
        "u8", "u16", "u32", "u64", "i8", "i16", "i32", "i64", "f64", "usize", "struct", "enum",
        "variant", "untagged", "serde", "Spec", "visitor", "tuple", "sequence",
    ];
    // Widths of registers are names of the file.
    let is_file_s = said.contains("u8, i8, u16, i16, u32, i32");
    !is_file_s && types.iter().any(|word| words.contains(word))
        || said.contains("invalid type")
        || said.contains("expected a map")
}

/// The place of an entry as a message names it, and its key.
fn is_placed(said: &str, entry: &Entry, key: &str) -> bool {
    let place = format!("s.toml:{}: ", entry.line);
    said.lines().any(|line| {
        let rest = line.strip_prefix(&place);
        let path = rest.and_then(|rest| rest.split(": ").next());
        path.is_some_and(|path| path.split(['.', '[', ']']).any(|part| part == key))
    })
}

#[test]
fn the_scenario_itself_is_sound() {
    assert_eq!(error(SOUND), None);
}

#[test]
fn a_misspelt_key_is_named_with_the_right_one() {
    let mut count = 0;
    for entry in entries() {
        let key = &SOUND[entry.key.clone()];
        // A word of two letters has no misspelt form that is near.
        let Some(at) = (1..key.len())
            .rev()
            .find(|&at| key.as_bytes()[at] != key.as_bytes()[at - 1])
        else {
            continue;
        };
        if key.len() < 3 {
            continue;
        }
        let misspelt = format!(
            "{}{}{}{}",
            &key[..at - 1],
            &key[at..=at],
            &key[at - 1..at],
            &key[at + 1..]
        );
        let said = error(&with(SOUND, &entry.key, &misspelt)).expect(&misspelt);
        let meant = format!("did you mean \"{key}\"?");
        assert!(
            is_placed(&said, &entry, &misspelt) && said.contains(&meant),
            "{misspelt}: {said}"
        );
        assert_eq!(said.lines().count(), 1, "{misspelt}: {said}");
        assert!(!has_type_name(&said), "{said}");
        count += 1;
    }
    assert!(count > 40, "{count}");
}

#[test]
fn a_value_of_a_wrong_type_is_named_with_its_key() {
    let mut count = 0;
    for entry in entries() {
        let (key, value) = (&SOUND[entry.key.clone()], &SOUND[entry.value.clone()]);
        // A value of any type is set; its device judges it while the run goes on.
        if key == "value" && value == "3" {
            continue;
        }
        let wrong = match value.as_bytes()[0] {
            b'"' | b'{' => "3",
            b'[' => "true",
            _ => "\"x\"",
        };
        let said =
            error(&with(SOUND, &entry.value, wrong)).unwrap_or_else(|| panic!("{key} = {wrong}"));
        assert!(is_placed(&said, &entry, key), "{key} = {wrong}: {said}");
        assert!(said.contains("expected"), "{key} = {wrong}: {said}");
        assert_eq!(said.lines().count(), 1, "{key} = {wrong}: {said}");
        assert!(!has_type_name(&said), "{key} = {wrong}: {said}");
        count += 1;
    }
    assert!(count > 40, "{count}");
}

/// Names of links, devices, kinds, robots, profiles: a letter too many.
#[test]
fn a_misspelt_name_is_shown_with_the_right_one() {
    let free = [
        "name",
        "description",
        "duration",
        "at",
        "from",
        "until",
        "watchdog",
        "latency",
    ];
    let mut count = 0;
    for entry in entries() {
        let (key, value) = (&SOUND[entry.key.clone()], &SOUND[entry.value.clone()]);
        let is_name_of_value = key == "name" && entry.line == 12;
        let is_description = key == "description" && entry.line > 3;
        let is_free = free.contains(&key) && !is_name_of_value && !is_description;
        if !value.starts_with('"') || is_free || key == "op" {
            continue;
        }
        let wrong = format!("{}x\"", &value[..value.len() - 1]);
        let said = error(&with(SOUND, &entry.value, &wrong)).expect(&wrong);
        let meant = format!("did you mean {value}?");
        assert!(
            said.contains(&meant) && said.contains("xpected one of"),
            "{key} = {wrong}: {said}"
        );
        assert!(said.contains("s.toml:"), "{said}");
        count += 1;
    }
    assert!(count >= 12, "{count}");
}

#[test]
fn figures_and_times_out_of_range_are_shown_with_the_range() {
    let rows = [
        ("schema = 1", "schema = 2", "schema: is 2, expected 1"),
        (
            "\"20s\"",
            "\"20 y\"",
            "duration: \"20 y\" is no time, expected",
        ),
        ("150", "-1", "visit_within_mm: is -1, expected at least 0"),
        (
            "violations_max = 0",
            "violations_max = 0.5",
            "violations_max: is 0.5, expected a whole",
        ),
        (
            "baud = 115200",
            "baud = 1",
            "baud: is 1, expected 300 to 4000000",
        ),
        (
            "baud = 115200",
            "baud = 99999999999",
            "is 99999999999, expected a whole number from 0 to",
        ),
        (
            "address = 1\n",
            "address = 300\n",
            "address: is 300, expected a whole number from 0 to 255",
        ),
        (
            "x_m = 0.05",
            "x_m = 500",
            "mount.x_m: is 500, expected -10 to 10",
        ),
        (
            "rate = 0.01",
            "rate = 10",
            "fault[0].rate: is 10, expected a chance per byte from 0 to 1",
        ),
        (
            "[2.2, 1.0]",
            "[2.2]",
            "waypoints_m[0]: is a list of 1, expected a list of 2 values",
        ),
        (
            "[2.2, 1.0]",
            "[2.2, 1, 3]",
            "waypoints_m[0]: is a list of 3, expected a list of 2 values",
        ),
        (
            "[-30, 30]",
            "[-30, 30, 1]",
            "limits: is a list of 3, expected a list of 2 values",
        ),
        (
            "x_m = 1.0, y",
            "x_m = 1e9, y",
            "world.start.x_m: is 1e9, expected -10000 to 10000",
        ),
        (
            "[-30, 30]",
            "[30, -30]",
            "s.toml:38: device.wheels.registers.register[0].limits: limits are 30",
        ),
        (
            "address = 4",
            "address = 1",
            "register[1].address: address 1 belongs to",
        ),
        ("axle_m = 0.26", "axle_m = 9", "world.body"),
    ];
    for (sound, wrong, expected) in rows {
        assert!(SOUND.contains(sound), "{sound}");
        let said = error(&SOUND.replacen(sound, wrong, 1)).expect(wrong);
        assert!(
            said.contains(expected) && said.starts_with("s.toml:"),
            "{wrong}: {said}"
        );
        assert_eq!(said.lines().count(), 1, "{wrong}: {said}");
    }
}

#[test]
fn a_missing_key_is_named_with_its_type() {
    let rows = [
        (
            "duration = \"20s\"\n",
            "s.toml: duration: is missing, expected a time with its unit",
        ),
        (
            "address = 1\n",
            "register[0].address: is missing, expected a whole number from 0 to 255",
        ),
        (
            "kind = \"flip\"\n",
            "fault[0].kind: is missing, expected one of flip, drop",
        ),
        (
            "baud = 115200\n",
            "device.wheels.registers.baud: is missing, expected a whole number",
        ),
        (
            "path_m = [[0.0, 0.0]",
            "world.wall[0].path_m: is missing, expected a list",
        ),
    ];
    for (key, expected) in rows {
        let line = SOUND
            .lines()
            .find(|line| format!("{line}\n").starts_with(key))
            .expect(key);
        let said = error(&SOUND.replacen(&format!("{line}\n"), "", 1)).expect(key);
        assert!(said.contains(expected), "{key}: {said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
}

/// Every third key misspelt at once: all of them are shown, at most ten, in order of lines.
#[test]
fn all_errors_of_a_file_are_shown_at_once() {
    let keys = [
        "waypoints_m",
        "visit_within_mm",
        "profile",
        "watchdog",
        "rate",
    ];
    let mut text = SOUND.to_owned();
    for key in keys {
        text = text.replacen(&format!("\n{key} ="), &format!("\n{key}x ="), 1);
    }
    text = text.replace("heading_deg = 0 }", "heading_deg = \"north\" }");
    let said = error(&text).expect("wrong");
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines.len(), keys.len() + 1, "{said}");
    for (key, line) in keys.iter().zip(&lines) {
        assert!(
            line.contains(&format!("did you mean \"{key}\"?")),
            "{key}: {said}"
        );
    }
    assert!(
        lines[5].contains("heading_deg: is \"north\", expected a number"),
        "{said}"
    );
    let many = text.replace("_m = ", "_n = ").replace("name = ", "nane = ");
    assert_eq!(error(&many).expect("wrong").lines().count(), 10);
    // Names that the robot does not have: found when it is wired.
    let names = SOUND.replace("link = \"wheels\"", "link = \"weels\"");
    let names = names.replace(
        "do = { set = { device = \"wheels\"",
        "do = { set = { device = \"lidr\"",
    );
    let said = error(&names).expect("wrong");
    assert_eq!(said.matches("did you mean").count(), 2, "{said}");
}

/// A mistake in each part of a robot is shown in the same round, at its own line: figures of the
/// body, walls, devices, faults.
#[test]
fn mistakes_of_all_parts_are_shown_at_once() {
    let text = SOUND
        .replace("axle_m = 0.26", "axle_m = 47")
        .replace("path_m = [[0.0, 0.0], [3.0, 0.0],", "path_m = [[0.0, 0.0]]\n\n[[world.wall]]\npath_m = [[1, 1]]\n\n[[world.wall]]\npath_m = [[0.0, 0.0], [3.0, 0.0],")
        .replace("actuator = \"left\"", "actuator = \"lefft\"")
        .replace("rate = 0.01", "rate = 2");
    let said = error(&text).expect("wrong");
    let line = |part: &str| {
        1 + text[..text.find(part).expect("there")]
            .matches('\n')
            .count()
    };
    let rows = [
        ("lefft", "there is no actuator \"lefft\""),
        ("rate = 2", "fault[0].rate: is 2, expected a chance"),
        ("axle_m", "world.body.axle_m: is 47, expected 0.01 to 4"),
        ("path_m = [[0.0, 0.0]]\n", "wall[0]: path_m has 1 points"),
        ("path_m = [[1, 1]]", "wall[1]: path_m has 1 points"),
    ];
    assert_eq!(said.lines().count(), rows.len(), "{said}");
    for ((part, told), shown) in rows.into_iter().zip(said.lines()) {
        let lines = line(part) - 1..=line(part);
        let mut places = lines.map(|line| format!("s.toml:{line}: "));
        assert!(
            places.any(|place| shown.starts_with(&place)),
            "{part}: {said}"
        );
        assert!(shown.contains(told), "{told}: {said}");
    }
}

/// An error hides no other one: two tables lack the same key, a list has a wrong value beside a
/// missing one, a renamed key has a wrong value as well.
#[test]
fn an_error_hides_no_other_one() {
    let second_wall = "\n[[world.wall]]\nheight_m = 1.0\n\n[[world.wall]]\nheight_m = 1.0\n";
    let second_fault = "\n[[fault]]\nlink = \"wheels\"\nrate = 0.5\n\n[[fault]]\nkind = \"drop\"\n\
                        link = \"wheels\"\nrate = \"x\"\n";
    let rows: [(String, &[&str]); 6] = [
        (
            SOUND
                .replace("schema = 1", "schema = 2")
                .replace(", heading_deg = 0 }", " }"),
            &[
                "s.toml:1: schema: is 2, expected 1",
                "world.start.heading_deg: is missing",
            ],
        ),
        (
            SOUND.to_owned() + second_wall,
            &["wall[1].path_m: is missing", "wall[2].path_m: is missing"],
        ),
        (
            SOUND
                .replace("address = 1\n", "")
                .replace("address = 4\n", ""),
            &[
                "register[0].address: is missing",
                "register[1].address: is missing",
            ],
        ),
        (
            SOUND.to_owned() + second_fault,
            &[
                "fault[1].kind: is missing, expected one of flip",
                "fault[2].rate: is \"x\", expected a number",
            ],
        ),
        (
            SOUND.replace("rate = 0.01", "rates = [0.1]"),
            &["fault[0].rates: is an unknown key, did you mean \"rate\"?"],
        ),
        (
            SOUND
                .replace("kind = \"flip\"", "kind = \"flipp\"")
                .replace("name = \"slow\"\n", ""),
            &[
                "expect.rule[0].name: is missing, expected a text",
                "fault[0].kind: is \"flipp\", did you mean \"flip\"?",
            ],
        ),
    ];
    for (text, expected) in rows {
        let said = error(&text).expect("wrong");
        assert_eq!(said.lines().count(), expected.len(), "{said}");
        for words in expected {
            assert!(said.contains(words), "{words}: {said}");
        }
    }
}

/// A value behind those that are read is an error, whatever its type.
#[test]
fn no_value_of_a_list_is_ignored() {
    for (sound, wrong) in [
        ("[[2.2, 1.0]]", "[[2.2, 1.0, \"x\"]]"),
        ("limits = [-30, 30]", "limits = [-30, 30, true]"),
    ] {
        let said = error(&SOUND.replace(sound, wrong)).expect(wrong);
        assert!(
            said.contains("is a list of 3, expected a list of 2 values"),
            "{wrong}: {said}"
        );
    }
}

/// A file that is no TOML: each message is one short line.
#[test]
fn a_file_that_is_no_toml_is_named_in_short_lines() {
    let long = "x".repeat(1 << 20);
    let deep = format!("{}b = 1\n", "a.".repeat(200));
    for text in [
        "a = 1\na = 2\n",
        "name = \"open\n",
        "\u{1b}[31mred = 1\n",
        &long,
        &deep,
        "]]]]\n",
    ] {
        let said = error(text).expect("wrong");
        for line in said.lines() {
            assert!(line.starts_with("s.toml"), "{line}");
            assert!(line.len() < 400, "{}", line.len());
            assert!(!line.contains('\u{1b}'), "{line:?}");
        }
    }
}

/// One value drives each actuator: the second one, in the order of the file, is refused at its line
/// and key. The kinds: registers, text variables, outputs of a program, and two devices.
#[test]
fn a_second_value_of_an_actuator_is_refused() {
    let head = "schema = 1\nname = \"two\"\nrobot = \"custom\"\nduration = \"1s\"\n\
        chassis.differential = {}\nworld.start = { x_m = 1.0, y_m = 1.0, heading_deg = 0 }\n\
        world.wall = [{ path_m = [[0, 0], [3, 0], [3, 2]] }]\n";
    let value = |name: &str, more: &str, actuator: &str| {
        format!(
            "{{ name = \"{name}\", {more} access = \"write\", \
             drives = {{ actuator = \"{actuator}\", speed_m_s = 0.01 }} }},\n"
        )
    };
    let registers = |name: &str, [left, right]: [&str; 2]| {
        let one = "address = 1, width = \"i8\",";
        let two = "address = 2, width = \"i8\",";
        let values = value("one", one, left) + &value("two", two, right);
        format!("[device.{name}.registers]\nbaud = 9600\nregister = [\n{values}]\n")
    };
    let text = |[left, right]: [&str; 2]| {
        let value = |name, actuator| {
            let access = "access = \"write\", ";
            value(name, "", actuator).replace(access, "")
        };
        let values = value("one", left) + &value("two", right);
        let command = "command = [{ request = \"set {one} {two}\", reply = \"ok\" }]\n";
        format!("[device.drive.text]\nbaud = 9600\n{command}variable = [\n{values}]\n")
    };
    let program = |[left, right]: [&str; 2]| {
        format!(
            "[device.drive.program]\nexec = \"true\"\nrate = 9600\n\
             drives.z = {{ actuator = \"{left}\", speed_m_s = 0.01 }}\n\
             drives.a = {{ actuator = \"{right}\", speed_m_s = 0.01 }}\n"
        )
    };
    let error = |devices: &str| {
        let parsed = Scenario::parse(Path::new("two.toml"), format!("{head}{devices}"));
        let (scenario, source) = parsed.expect("it is read");
        let wired = robots::wire(&scenario, &source, Dut::External, PcEnd::External);
        wired.err().map(|error| error.to_string())
    };
    let (own, twice) = (["left", "right"], ["left"; 2]);
    for sound in [registers("wheels", own), text(own), program(own)] {
        assert_eq!(error(&sound), None, "{sound}");
    }
    let two = registers("b", own) + &registers("a", ["right", "right"]);
    let refused = [
        (
            registers("wheels", twice),
            12,
            "device.wheels.registers.register[1].drives.actuator",
            "device.wheels.registers.register[0].drives.actuator",
        ),
        (
            text(twice),
            13,
            "device.drive.text.variable[1].drives.actuator",
            "device.drive.text.variable[0].drives.actuator",
        ),
        (
            program(twice),
            12,
            "device.drive.program.drives.a.actuator",
            "device.drive.program.drives.z.actuator",
        ),
        (
            two,
            17,
            "device.a.registers.register[0].drives.actuator",
            "device.b.registers.register[1].drives.actuator",
        ),
    ];
    for (devices, line, key, first) in refused {
        let said = error(&devices).expect(key);
        assert!(
            said.contains(&format!("two.toml:{line}: {key}: ")),
            "{said}"
        );
        assert!(
            said.contains(&format!("which {first} drives already")),
            "{said}"
        );
    }
}

/// Without a map of its own a robot has none to compare, and without a body no path.
#[test]
fn golden_results_need_a_robot_that_has_them() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("wrong-golden");
    std::fs::create_dir_all(&folder).expect("a fresh folder");
    let [map, path] = ["map.pgm", "true.tum"].map(|name| folder.join(name));
    std::fs::write(&map, b"P5\n2 2\n255\n\xFF\x00\x00\xFF").expect("a fresh file");
    std::fs::write(&path, "0 1 1 0 0 0 0 1\n1 2 1 0 0 0 0 1\n").expect("a fresh file");
    let golden = |key: &str, file: &Path, more: &str| {
        format!(
            "[expect.golden]\n{key} = {:?}\n{more}\n\n[[expect.rule]]",
            file.display()
        )
    };
    let of_map = golden("map", &map, "map_walls_min = 0.9");
    let of_path = golden("path", &path, "path_within_mm = 100");
    let with = |text: &str, golden: &str| text.replacen("[[expect.rule]]", golden, 1);
    let said = error(&with(SOUND, &of_map)).expect("refused");
    let told = "s.toml:18: expect.golden.map: expected none: the rig cannot see the map";
    assert!(said.starts_with(told), "{said}");
    assert_eq!(error(&with(SOUND, &of_path)), None);
    let bare = "schema = 1\nname = \"bare\"\nrobot = \"none\"\nduration = \"2s\"\n\
                [[expect.rule]]\nname = \"none\"\n\
                never = { bytes = { link = \"meter\", direction = \"to-device\", hex = \"00\" } }\n\
                [device.meter]\ndescription = \"modbus-meter\"\n";
    assert_eq!(error(bare), None);
    let said = error(&with(bare, &of_path)).expect("refused");
    let told = "s.toml:5: expect.golden.path: expected none: the scenario has no robot";
    assert!(said.starts_with(told), "{said}");
    let said = error(&with(bare, &of_map)).expect("refused");
    assert!(
        said.starts_with("s.toml:5: expect.golden.map: expected none"),
        "{said}"
    );
}

/// The map of yellow's PC: each mistake is shown with the key, the file, and what was expected. A
/// picture that lacks a threshold of free cells has that of ROS.
#[test]
fn a_map_that_yellow_cannot_know_is_refused() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("wrong-map");
    std::fs::create_dir_all(&folder).expect("a folder");
    let yaml = |resolution: &str, image: &str| {
        format!(
            "image: {image}\nresolution: {resolution}\norigin: [-0.2, 0.0, 0.0]\nnegate: 0\n\
             occupied_thresh: 0.65\n"
        )
    };
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).expect(name);
    write("map.pgm", b"P5\n2 2\n255\n\xFE\x00\x00\xCD");
    write("free.pgm", b"P5\n2 1\n255\n\xFE\xCD");
    write("map.yaml", yaml("0.1", "map.pgm").as_bytes());
    write("coarse.yaml", yaml("0.25", "map.pgm").as_bytes());
    write("free.yaml", yaml("0.1", "free.pgm").as_bytes());
    write("lost.yaml", yaml("0.1", "lost.pgm").as_bytes());
    write("wrong.yaml", b"image: map.pgm\n");
    let error = |lines: &str| {
        let text = format!(
            "schema = 1\nname = \"known\"\nrobot = \"yellow\"\nduration = \"1s\"\n[program]\n\
             {lines}\n[world]\nstart = {{ x_m = 1, y_m = 1, heading_deg = 0 }}\n"
        );
        let read = Scenario::parse(&folder.join("s.toml"), text);
        let wired = read.and_then(|(scenario, source)| {
            robots::wire(&scenario, &source, Dut::Internal, PcEnd::Scripted).map(drop)
        });
        wired.err().map(|error| error.to_string())
    };
    assert_eq!(error("map = \"map.yaml\""), None);
    for (name, parts) in [
        ("none.yaml", ["cannot read ", "No such file"]),
        ("coarse.yaml", ["has cells of 0.25 m", "expected 0.1 m"]),
        (
            "free.yaml",
            [
                "has no walls or no free cells",
                "expected map.yaml of a run",
            ],
        ),
        ("lost.yaml", ["lost.pgm", "cannot read"]),
        (
            "wrong.yaml",
            ["wrong.yaml: key `resolution` is missing", ""],
        ),
    ] {
        let said = error(&format!("map = \"{name}\"")).expect(name);
        assert!(said.contains("s.toml:6: program.map: "), "{said}");
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
    }
    let said = error("votes = \"most\"").expect("refused");
    let expected = "s.toml:6: program.votes: is \"most\", expected one of best, added, multiplied";
    assert!(said.ends_with(expected), "{said}");
}
