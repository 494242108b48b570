//! Whole rigs in virtual time: the seed's figures, determinism, maps, behaviour under faults.

mod apollo13;
mod bench;
mod capture;
mod cases;
mod checkers;
mod checkpoint;
mod custom;
mod determinism;
mod device_keys;
mod display;
mod explore;
mod faults;
mod figures;
mod maps;
mod mission;
mod mutants;
mod nodes;
mod own_device;
mod pc_program;
mod report;
mod robot;
mod rplidar;
mod safety;
mod silence;
mod team;
mod turns;
mod yellow;

#[path = "../support/thorough.rs"]
mod thorough;

use std::path::Path;

use hilrig::run::{Outcome, Run};
use hilrig::scenario::{Scenario, Source};

/// A scenario of the folder `scenarios`.
fn shipped(name: &str) -> (Scenario, Source) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenarios/{name}.toml"));
    Scenario::read(&path).expect("a shipped scenario is sound")
}

/// A scenario made for one test: the rescue robot in a square room of 2.4 m, with `more` TOML
/// behind it.
fn in_a_room(duration: &str, more: &str) -> (Scenario, Source) {
    let text = format!(
        "schema = 1\nname = \"test\"\nrobot = \"rescue\"\nduration = \"{duration}\"\n{more}\n\
         [world]\nstart = {{ x_m = 1.5, y_m = 1.2, heading_deg = 90 }}\n[[world.wall]]\n\
         path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n"
    );
    Scenario::parse(Path::new("<test>"), text).expect("sound")
}

fn start((scenario, source): (Scenario, Source)) -> Run {
    Run::new(scenario, &source, None).expect("can be wired")
}

fn run_to_end(scenario: (Scenario, Source)) -> Outcome {
    start(scenario).finish()
}

/// Names and details of the checks that failed.
fn failures(outcome: &Outcome) -> Vec<String> {
    let failed = outcome
        .checks
        .iter()
        .filter(|check| check.status == hilrig::run::check::Status::Fail);
    failed
        .map(|check| format!("{}: {}", check.name, check.detail))
        .collect()
}
