//! Captures in the formats of other tools, read back by those tools.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use hilrig::capture::Capture;
use hilrig::rig::line::Direction;
use hilrig::slam::carmen;

use crate::record::bytes;
use crate::support::*;
use crate::tools::{has, printed};

/// A run of `duration` in its result folder, and its capture.
fn run(name: &str, duration: &str) -> (PathBuf, Capture) {
    let folder = folder(name);
    let (scenario, _) = in_a_room(duration, "");
    let text = toml::to_string(&scenario).expect("has a TOML form");
    fs::write(folder.join("room.toml"), text).expect("writable");
    let (status, said, _) = hilrig(&folder, &["run", "room.toml", "--out", "out"]);
    assert_eq!(status.code(), Some(0), "{said}");
    let capture = Capture::read(&folder.join("out/capture.pcapng")).expect("written");
    (folder, capture)
}

/// Exports the run's folder as `out`; returns the output of the command.
fn export(folder: &Path, out: &str, more: &[&str]) -> String {
    let arguments = [&["export", "out", "-o", out][..], more].concat();
    let (status, said, error) = hilrig(folder, &arguments);
    assert_eq!(status.code(), Some(0), "{said}{error}");
    said
}

/// Path of a Python tool of others, which `tests/run.sh` installs.
fn tool(name: &str) -> PathBuf {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent();
    target.expect("a folder in it").join("tools/bin").join(name)
}

/// Python's CSV reader gives each direction's bytes.
#[test]
fn a_table_holds_all_bytes() {
    if !has("python3") {
        return;
    }
    let (folder, capture) = run("export-csv", "1s");
    export(&folder, "run.csv", &[]);
    let script = "import csv,sys\n\
                  for r in csv.DictReader(open(sys.argv[1], newline='')):\n    \
                  if r['event'] == 'data': print(r['direction'], r['bytes'])\n";
    let mut python = Command::new("python3");
    let out = printed(python.args(["-c", script]).arg(folder.join("run.csv")));
    let out = String::from_utf8(out).expect("hex");
    let mut found: BTreeMap<&str, String> = BTreeMap::new();
    for line in out.lines() {
        let (direction, hex) = line.split_once(' ').expect("two words");
        found.entry(direction).or_default().push_str(hex);
    }
    for direction in [Direction::ToMaster, Direction::ToDevice] {
        let all = bytes(&capture, direction);
        let hex: String = all.iter().map(|byte| format!("{byte:02X}")).collect();
        assert!(all.len() > 1000 && found[direction.name()] == hex);
    }
}

/// sigrok's decoder finds the drawn bytes in the levels. A resolution of a microsecond is
/// sufficient for the bus with 1 Mbaud at ten samples a bit.
#[test]
fn sigrok_decodes_the_drawn_lines() {
    if !has("sigrok-cli") {
        return;
    }
    let (folder, capture) = run("export-vcd", "300ms");
    export(&folder, "run.vcd", &[]);
    let base = capture.links.iter().position(|link| link.name == "base");
    let mut base_only = capture.clone();
    base_only.records.retain(|record| Some(record.link) == base);
    for direction in [Direction::ToMaster, Direction::ToDevice] {
        let mut sigrok = Command::new("sigrok-cli");
        sigrok.args(["-I", "vcd:downsample=100", "-i"]);
        sigrok.arg(folder.join("run.vcd"));
        let uart = format!("uart:baudrate=1000000:rx=base.{}", direction.name());
        sigrok.args(["-P", &uart, "-B", "uart=rx"]);
        let all = bytes(&base_only, direction);
        assert!(all.len() > 20);
        assert_eq!(printed(&mut sigrok), all, "{}", direction.name());
    }
}

/// An independent reader finds channels, their data, known schemas, and the scenario.
#[test]
fn pythons_mcap_reader_reads_the_run() {
    let python = tool("python");
    if !has(&python.to_string_lossy()) {
        return;
    }
    let (folder, capture) = run("export-mcap", "2s");
    let said = export(&folder, "run.mcap", &[]);
    let script = "import sys, json, base64\n\
        from mcap.reader import make_reader\n\
        r = make_reader(open(sys.argv[1], 'rb'))\n\
        raw = {}\n\
        count = {}\n\
        for schema, channel, m in r.iter_messages():\n    \
            if schema is None: raw[channel.topic] = raw.get(channel.topic, b'') + m.data\n    \
            else:\n        \
                count[schema.name] = count.get(schema.name, 0) + 1\n        \
                last = json.loads(m.data)\n        \
                assert last['timestamp']['sec'] * 10**9 + last['timestamp']['nsec'] == m.log_time\n        \
                if schema.name == 'foxglove.LaserScan':\n            \
                    assert len(last['ranges']) == len(last['intensities']) == 360\n        \
                if schema.name == 'foxglove.Grid':\n            \
                    assert len(base64.b64decode(last['data'])) % last['row_stride'] == 0\n\
        for topic in sorted(raw): print(topic, len(raw[topic]))\n\
        for name in sorted(count): print(name, count[name] > 0)\n\
        for a in r.iter_attachments(): print(a.name, b'robot = \"rescue\"' in a.data)\n";
    let mut python = Command::new(python);
    let out = printed(python.args(["-c", script]).arg(folder.join("run.mcap")));
    let out = String::from_utf8(out).expect("text");
    let mut expected = Vec::new();
    for (index, link) in capture.links.iter().enumerate() {
        for direction in [Direction::ToMaster, Direction::ToDevice] {
            let mut one = capture.clone();
            one.records.retain(|record| record.link == index);
            let len = bytes(&one, direction).len();
            if len > 0 {
                expected.push(format!("/{}/{} {len}", link.name, direction.name()));
            }
        }
    }
    expected.sort();
    for schema in ["Grid", "LaserScan", "PoseInFrame"] {
        expected.push(format!("foxglove.{schema} True"));
    }
    expected.push("scenario.toml True".to_owned());
    assert_eq!(out.lines().collect::<Vec<_>>(), expected, "{said}");
}

/// evo compares the believed path with the true one. The replay gives the believed path of the run.
#[test]
fn evo_reads_the_believed_way() {
    let (folder, _) = run("export-tum", "3s");
    export(&folder, "way.tum", &[]);
    let [replayed, then] =
        ["way.tum", "out/estimate.tum"].map(|name| fs::read_to_string(folder.join(name)));
    assert_eq!(replayed.expect("written"), then.expect("written"));
    let evo = tool("evo_ape");
    if !has(&evo.to_string_lossy()) {
        return;
    }
    let mut evo = Command::new(evo);
    evo.args(["tum", "out/true.tum", "way.tum", "--t_max_diff", "0.2"]);
    // evo keeps its settings in the home folder.
    let said = printed(evo.current_dir(&folder).env("HOME", &folder));
    let said = String::from_utf8(said).expect("text");
    let rmse = said.lines().find(|line| line.trim().starts_with("rmse"));
    let rmse = rmse.and_then(|line| line.split_whitespace().last()?.parse::<f64>().ok());
    assert!(rmse.is_some_and(|rmse| rmse < 0.1), "{said}");
}

/// A reader written from map_server's rules: occupancy is (255 - gray) / 255. Above the first
/// threshold a cell is a wall, below the second free, otherwise unknown. The room of 2.4 m has its
/// corner at 0.3 m; the first rows of the picture are its top.
#[test]
fn a_reader_of_ros_maps_finds_walls_and_unknown_cells() {
    let (folder, _) = run("export-map", "3s");
    export(&folder, "map.yaml", &[]);
    let yaml = fs::read_to_string(folder.join("map.yaml")).expect("written");
    let key = |name: &str| {
        let mut lines = yaml.lines().filter_map(|line| line.split_once(": "));
        let found = lines.find(|(key, _)| *key == name);
        found.expect("a required key").1.to_owned()
    };
    let number = |name: &str| key(name).parse::<f64>().expect("a number");
    let [wall, free, cell_m] = ["occupied_thresh", "free_thresh", "resolution"].map(number);
    assert_eq!((&*key("negate"), &*key("mode")), ("0", "trinary"));
    let image = fs::read(folder.join(key("image"))).expect("beside it");
    let (width, height, grays) = pgm(&image);
    assert_eq!(grays.len(), width * height);
    let counts = |from: f64, to: f64| {
        let grays = grays.iter().map(|&gray| f64::from(255 - gray) / 255.0);
        grays.filter(|&occ| occ > from && occ <= to).count()
    };
    let (walls, unknown) = (counts(wall, 1.0), counts(free, wall));
    let frees = grays.len() - walls - unknown;
    // The room is 2.4 m square; cells behind its walls are unknown.
    let room = (2.4 / cell_m) * (2.4 / cell_m);
    assert!(
        frees as f64 > 0.5 * room && frees as f64 <= 1.1 * room,
        "{frees} of {room}"
    );
    assert!(walls as f64 > 2.0 * 2.4 / cell_m, "{walls}");
    assert!(unknown as f64 > 0.1 * grays.len() as f64, "{unknown}");
}

/// Width, height and grays of a binary PGM.
fn pgm(bytes: &[u8]) -> (usize, usize, &[u8]) {
    let mut rest = bytes.strip_prefix(b"P5").expect("a binary PGM");
    let mut number = || {
        let start = rest.iter().position(u8::is_ascii_digit).expect("a number");
        let len = rest[start..]
            .iter()
            .take_while(|byte| byte.is_ascii_digit())
            .count();
        let text = core::str::from_utf8(&rest[start..start + len]).expect("digits");
        rest = &rest[start + len..];
        text.parse::<usize>().expect("small")
    };
    let (width, height, max) = (number(), number(), number());
    assert_eq!(max, 255);
    (width, height, &rest[1..])
}

/// The reader of public logs reads both messages; a turn has up to 360 points, the front half
/// fewer.
#[test]
fn a_carmen_log_is_read_as_public_ones_are() {
    let (folder, _) = run("export-carmen", "4s");
    let said = export(&folder, "run.log", &[]);
    let turns: usize = said
        .split(' ')
        .next()
        .and_then(|n| n.parse().ok())
        .expect("a count");
    assert!(turns >= 5, "{said}");
    let whole = carmen::read(&fs::read(folder.join("run.log")).expect("written")).expect("a log");
    export(&folder, "front.log", &["--laser", "flaser"]);
    let front = fs::read(folder.join("front.log")).expect("written");
    let front = carmen::read(&front).expect("a log");
    assert_eq!((whole.shots.len(), front.shots.len()), (turns, turns));
    for (whole, front) in whole.shots.iter().zip(&front.shots) {
        assert!(front.points.len() < whole.points.len());
        // No wall is farther than the room's diagonal, and the front is ahead.
        assert!(whole.points.iter().all(|p| p.x_mm.hypot(p.y_mm) < 3400.0));
        assert!(front.points.iter().all(|p| p.x_mm > -100.0));
    }
}

#[test]
fn an_export_of_nothing_says_what_is_missing() {
    let (folder, _) = run("export-errors", "100ms");
    let says = |arguments: &[&str]| {
        let (status, _, error) = hilrig(&folder, &[&["export"], arguments].concat());
        assert_eq!(status.code(), Some(2), "{error}");
        error
    };
    assert_eq!(
        says(&["out", "-o", "x.doc"]),
        "error: --out x.doc: expected a name that ends in csv, vcd, mcap, log, carmen, tum or yaml, \
         or --format\n"
    );
    assert_eq!(
        says(&["out", "-o", "x.log"]),
        "error: out/capture.pcapng: no link carries a lidar's turns\n"
    );
    let error = says(&["out", "-o", "no/where.csv"]);
    assert!(error.contains("cannot write no/where.csv"), "{error}");
}
