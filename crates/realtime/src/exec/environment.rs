//! Environment variables of a program: its ports, its scenario.

use std::ffi::OsString;
use std::path::Path;

use super::{PORTS_VARIABLE, Seat, TERMINAL_VARIABLE};
use crate::transport::{Note, PortDir};
use engine::run::Run;

/// Environment variables of a program on `seats`, for the robot with the index `robot`. The
/// variables of its ports have the names of a robot alone, also those of cables. `dir` is that of
/// all ports.
pub(crate) fn environment(
    seats: &[Seat],
    dir: &PortDir,
    run: &Run,
    robot: usize,
) -> Vec<(String, OsString)> {
    let member = robot.checked_sub(1).and_then(|it| run.team().get(it));
    let scenario = member.map_or(run.scenario(), |member| member.run.scenario());
    let path = match member {
        Some(member) => dir.path().join(&member.name),
        None => dir.path().to_owned(),
    };
    let mut env = vec![
        (PORTS_VARIABLE.to_owned(), path.clone().into()),
        ("HILRIG_SEED".to_owned(), scenario.seed.to_string().into()),
        (
            "HILRIG_SCENARIO".to_owned(),
            Note::Scenario.path_in(&path).into(),
        ),
    ];
    for seat in seats.iter().filter(|seat| seat.is_terminal) {
        let path = seat.transport.path();
        let is_cable = || run.scenario().cable.contains_key(&seat.end.link);
        if seat.end.robot == robot || (seat.end.robot == 0 && is_cable()) {
            env.push((port_variable(seat.end.own_name()), path.into()));
            env.extend(terminal_of(seat.end.own_name(), path));
        }
        if seat.end.robot != 0 {
            env.push((port_variable(&seat.end.name), path.into()));
            env.extend(terminal_of(&seat.end.name, path));
        }
    }
    env
}

/// The variable with the name of a port in `/dev`, and this name. Some libraries accept no other
/// names of ports.
pub(crate) fn terminal_of(name: &str, path: &Path) -> Option<(String, OsString)> {
    let terminal = path.canonicalize().ok()?;
    let variable = format!("{TERMINAL_VARIABLE}{}", variable(name));
    (terminal != path).then(|| (variable, terminal.into()))
}

/// The name of a port as part of the name of a variable.
fn variable(name: &str) -> String {
    name.to_ascii_uppercase().replace(['-', '/'], "_")
}

/// Environment variable with the path of the port `name`.
pub fn port_variable(name: &str) -> String {
    format!("HILRIG_PORT_{}", variable(name))
}
