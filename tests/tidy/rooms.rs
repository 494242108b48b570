//! Rules about modules: the order of the engine's modules, no cycles between files, and no robot
//! names in general code. Cargo checks the order of the crates.

use std::collections::{BTreeMap, BTreeSet};

use crate::files::{File, all};

type Findings = Vec<String>;

/// The folder of the crate whose modules have an order.
const ENGINE: &str = "crates/engine/src";
/// Its modules from the top.
const ROOMS: [&str; 5] = ["run", "robots", "scenario", "codec", "rig"];
/// Modules that all of them may use, and that use none of them.
const BOTTOM: [&str; 6] = ["hex", "near", "picture", "registry", "workers", "TOOL"];
/// Roots of crates: a path that begins with `crate` begins there.
const ROOTS: [&str; 12] = [
    "src",
    "protocols/src",
    "emulators/src",
    "firmware_core/src",
    ENGINE,
    "crates/show/src",
    "crates/capture/src",
    "crates/realtime/src",
    "crates/slam/src",
    "crates/search/src",
    "crates/museum/src",
    "crates/ui/src",
];
/// Crates that serve any robot.
const ANY_ROBOT: [&str; 6] = [
    ENGINE,
    "crates/show/src",
    "crates/capture/src",
    "crates/realtime/src",
    "crates/search/src",
    "crates/ui/src",
];

/// Files above the robots that name a robot nevertheless, with the reason.
const NAMED: [(&str, &str); 9] = [
    (
        "crates/search/src/generate/fault_names.rs",
        "knows the faults of the built-in devices, for names misspelt in a profile",
    ),
    (
        "crates/search/src/fuzz/session",
        "benches of those very programs",
    ),
    (
        "crates/capture/src/export/scans.rs",
        "exports what that lidar sends",
    ),
    (
        "crates/engine/src/scenario.rs",
        "passes on the settings of the kinds that are built in",
    ),
    (
        "crates/engine/src/scenario/device.rs",
        "the table of the kinds that are built in",
    ),
    (
        "crates/engine/src/scenario/device/rplidar",
        "a kind's own files",
    ),
    (
        "crates/engine/src/scenario/device/xv11.rs",
        "a kind's own file",
    ),
    (
        "crates/engine/src/scenario/device/xv11_scans.rs",
        "a kind's own file",
    ),
    (
        "crates/engine/src/scenario/schema/examples.rs",
        "examples for people",
    ),
];

/// A file of a crate as its module: folder of the crate, then the names.
fn module(path: &str) -> Option<(&'static str, Vec<&str>)> {
    let fits = |root: &&&str| {
        path.strip_prefix(**root)
            .is_some_and(|rest| rest.starts_with('/'))
    };
    let root = ROOTS.iter().find(fits)?;
    let names: Vec<_> = path[root.len() + 1..]
        .strip_suffix(".rs")?
        .split('/')
        .collect();
    match names[..] {
        ["lib" | "main"] => Some((root, Vec::new())),
        _ => Some((root, names)),
    }
}

/// The paths that a file's product mentions, from the root of its crate; comments do not count.
fn mentions(file: &File) -> Vec<(usize, Vec<String>)> {
    let Some((_, module)) = module(&file.path) else {
        return Vec::new();
    };
    let lines = file.product_lines();
    let code = lines.filter(|(_, line)| !line.trim_start().starts_with("//"));
    let mut text = String::new();
    let mut starts = Vec::new();
    for (number, line) in code {
        starts.push((text.len(), number));
        text += line;
        text.push('\n');
    }
    let number = |at: usize| starts[starts.partition_point(|(start, _)| *start <= at) - 1].1;
    let mut found = Vec::new();
    for (at, _) in text
        .match_indices("crate::")
        .chain(text.match_indices("super::"))
    {
        let before = text[..at].chars().next_back();
        // `crate` is only the end of a longer name, or this is the second "super" of a path.
        if before.is_some_and(|c| c.is_alphanumeric() || "_:".contains(c)) {
            continue;
        }
        for path in tree(&text[at..]) {
            let mut whole = match path[0] {
                "crate" => Vec::new(),
                _ => module.clone(),
            };
            for name in path {
                match name {
                    "crate" => {}
                    "super" => drop(whole.pop()),
                    name => whole.push(name),
                }
            }
            let whole = whole.into_iter().map(str::to_owned).collect();
            found.push((number(at), whole));
        }
    }
    found
}

/// The paths that `text` begins with: one, or those of the braces that it ends in.
fn tree(text: &str) -> Vec<Vec<&str>> {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let mut path = Vec::new();
    let mut rest = text;
    loop {
        let end = rest.find(|c| !is_name(c)).unwrap_or(rest.len());
        if end > 0 {
            path.push(&rest[..end]);
        }
        match rest[end..].strip_prefix("::") {
            Some(more) => rest = more,
            None => break,
        }
    }
    let Some(inner) = rest.strip_prefix('{') else {
        return vec![path];
    };
    let mut paths = Vec::new();
    let (mut depth, mut start) = (0, 0);
    for (at, c) in inner.char_indices() {
        match c {
            '{' => depth += 1,
            ',' | '}' if depth == 0 => {
                let item = inner[start..at].trim_start();
                if !item.is_empty() {
                    paths.extend(
                        tree(item)
                            .into_iter()
                            .map(|more| [&path[..], &more].concat()),
                    );
                }
                start = at + 1;
                if c == '}' {
                    break;
                }
            }
            '}' => depth -= 1,
            _ => {}
        }
    }
    paths
}

/// Depth of a room, counted from the top; modules of the bottom are below all rooms.
fn depth(room: &str) -> Option<usize> {
    let room_at = ROOMS.iter().position(|known| *known == room);
    room_at.or_else(|| BOTTOM.contains(&room).then_some(ROOMS.len()))
}

/// Mentions of a room that is not below the file's own room.
fn climbs(file: &File) -> Findings {
    let Some((ENGINE, names)) = module(&file.path) else {
        return Vec::new();
    };
    let Some((room, here)) = names.first().and_then(|room| Some((*room, depth(room)?))) else {
        return Vec::new();
    };
    let climbs = |other: &String| {
        let known = depth(other);
        other != room && known.is_some_and(|there| there <= here)
    };
    let found = mentions(file).into_iter();
    let found = found.filter(|(_, path)| path.first().is_some_and(climbs));
    found
        .map(|(line, path)| format!("{}:{line}: {room} mentions {}", file.path, path.join("::")))
        .collect()
}

fn product(files: Vec<File>) -> Vec<File> {
    let is_product = |file: &File| !file.is_test() && module(&file.path).is_some();
    files.into_iter().filter(is_product).collect()
}

#[test]
fn rooms_stand_on_those_below_them() {
    let sample = |path: &str, text| climbs(&File::sample(&format!("{ENGINE}/{path}"), text)).len();
    assert_eq!(
        sample("run/a.rs", "use crate::rig::Rig;\nuse crate::run::b;"),
        0
    );
    assert_eq!(sample("rig/a.rs", "use crate::run::Run;"), 1);
    assert_eq!(
        sample(
            "rig/a.rs",
            "// crate::run\n#[cfg(test)]\nuse crate::run::a;"
        ),
        0
    );
    assert_eq!(
        sample(
            "rig.rs",
            "use crate::{\n    hex::{a, b},\n    run::view,\n};"
        ),
        1
    );
    assert_eq!(
        sample("rig/a.rs", "fn a() { super::super::run::main() }"),
        1
    );
    assert_eq!(sample("picture.rs", "use crate::rig::Rig;"), 1);
    let findings: Findings = product(all(&[".rs"])).iter().flat_map(climbs).collect();
    assert!(findings.is_empty(), "\n{}", findings.join("\n"));
}

type Graph = BTreeMap<String, BTreeSet<String>>;

/// The files that each file mentions, without `.rs`. A parent and the files in its folder may
/// mention each other, because the parent's file is the entry of its folder.
fn graph(files: &[File]) -> Graph {
    let name = |file: &File| file.path.trim_end_matches(".rs").to_owned();
    let known: BTreeSet<String> = files.iter().map(name).collect();
    let mut graph = Graph::new();
    for file in files {
        let Some((root, _)) = module(&file.path) else {
            continue;
        };
        let from = name(file);
        for (_, mut path) in mentions(file) {
            let target = loop {
                let target = format!("{root}/{}", path.join("/"));
                if known.contains(&target) || path.pop().is_none() {
                    break target;
                }
            };
            let is_in = |inner: &str, outer: &str| {
                inner
                    .strip_prefix(outer)
                    .is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
            };
            if known.contains(&target) && !is_in(&target, &from) && !is_in(&from, &target) {
                graph.entry(from.clone()).or_default().insert(target);
            }
        }
    }
    graph
}

/// All files that can be reached from `from`.
fn reach<'a>(graph: &'a Graph, from: &str) -> BTreeSet<&'a str> {
    let mut seen = BTreeSet::new();
    let mut next: Vec<&str> = graph
        .get(from)
        .into_iter()
        .flatten()
        .map(String::as_str)
        .collect();
    while let Some(one) = next.pop() {
        if seen.insert(one) {
            next.extend(graph.get(one).into_iter().flatten().map(String::as_str));
        }
    }
    seen
}

/// Mentions that close a cycle, as `a -> b`.
fn circles(graph: &Graph) -> Findings {
    let mentions = graph
        .iter()
        .flat_map(|(from, to)| to.iter().map(move |to| (from, to)));
    let closes = mentions.filter(|(from, to)| reach(graph, to).contains(from.as_str()));
    closes.map(|(from, to)| format!("{from} -> {to}")).collect()
}

#[test]
fn files_do_not_mention_each_other_in_a_circle() {
    let sample = |texts: [&str; 3]| {
        let paths = ["src/run/a.rs", "src/run/b.rs", "src/run.rs"];
        let files = paths
            .iter()
            .zip(texts)
            .map(|(path, text)| File::sample(path, text));
        circles(&graph(&files.collect::<Vec<_>>())).len()
    };
    assert_eq!(
        sample(["use super::b::B;", "use super::Run;", "use a::A;"]),
        0
    );
    assert_eq!(
        sample(["use super::b::B;", "fn b() { crate::run::a::a() }", ""]),
        2
    );
    let graph = graph(&product(all(&[".rs"])));
    assert!(graph.len() > 200, "{} files mention others", graph.len());
    let circles = circles(&graph);
    assert!(circles.is_empty(), "\n{}", circles.join("\n"));
}

/// Names of a robot, or of a device of a single robot, in code for any robot.
fn names_a_robot(file: &File) -> Findings {
    let is_judged = |root: &str, names: &[&str]| {
        ANY_ROBOT.contains(&root) && (root != ENGINE || !["robots", "codec"].contains(&names[0]))
    };
    if !module(&file.path).is_some_and(|(root, names)| !names.is_empty() && is_judged(root, &names))
    {
        return Vec::new();
    }
    let names = |line: &str| {
        let line = line.trim_start().to_lowercase();
        !line.starts_with("//")
            && ["rescue", "yellow", "apollo", "xv11", "rplidar"]
                .iter()
                .any(|name| line.contains(name))
    };
    let lines = file.product_lines().filter(|(_, line)| names(line));
    lines
        .map(|(number, line)| format!("{}:{number}: {}", file.path, line.trim()))
        .collect()
}

#[test]
fn what_does_for_any_robot_names_none() {
    let sample = |path, text| names_a_robot(&File::sample(path, text)).len();
    assert_eq!(
        sample(
            "crates/show/src/a.rs",
            "use engine::robots::Axis;\n// as the rescue robot"
        ),
        0
    );
    assert_eq!(
        sample("crates/show/src/a.rs", "match name { \"Rescue\" => 1 }"),
        1
    );
    assert_eq!(
        sample("crates/engine/src/rig.rs", "use emulators::xv11::Xv11;"),
        1
    );
    assert_eq!(
        sample("crates/engine/src/robots/rescue.rs", "struct Rescue;"),
        0
    );
    let files = product(all(&[".rs"]));
    let mut findings: Findings = files.iter().flat_map(names_a_robot).collect();
    for (path, why) in NAMED {
        let before = findings.len();
        findings.retain(|finding| !finding.starts_with(path));
        assert!(
            findings.len() < before,
            "no exception is needed any more: {path}, {why}"
        );
    }
    assert!(findings.is_empty(), "\n{}", findings.join("\n"));
}
