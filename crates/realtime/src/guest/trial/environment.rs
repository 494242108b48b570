//! The environment of a program in virtual time.

use std::ffi::{OsStr, OsString};

use crate::exec::{Seat, TERMINAL_VARIABLE, environment};
use crate::process::LINES_VARIABLE;
use crate::transport::PortDir;
use engine::run::Run;

/// Length of a terminal's number with the slashes before it.
const NUMBER_LEN: usize = 7;

/// The environment of a program of the robot with the index `robot`.
pub(super) fn environment_of(
    seats: &[Seat],
    dir: &PortDir,
    run: &Run,
    robot: usize,
) -> Vec<(String, OsString)> {
    let mut env = environment(seats, dir, run, robot);
    env.push((LINES_VARIABLE.to_owned(), dir.path().into()));
    for (_, value) in env
        .iter_mut()
        .filter(|(name, _)| name.starts_with(TERMINAL_VARIABLE))
    {
        *value = of_fixed_length(value).into();
    }
    env
}

/// The path of a terminal, extended by slashes to a fixed length. Otherwise the number that the
/// system has given to the terminal would change its length, and with it the layout of the
/// program's memory behind its variables.
fn of_fixed_length(path: &OsStr) -> String {
    let path = path.to_string_lossy();
    let (folder, number) = path.rsplit_once('/').unwrap_or_default();
    format!("{folder}{number:/>NUMBER_LEN$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The system numbers its terminals: /dev/pts/7 and /dev/pts/1234567 are as long.
    #[test]
    fn paths_of_terminals_have_one_length() {
        let of = |path: &str| of_fixed_length(OsStr::new(path));
        assert_eq!(of("/dev/pts/7"), format!("/dev/pts{}7", "/".repeat(6)));
        assert_eq!(of("/dev/pts/123456"), "/dev/pts/123456");
        assert_eq!(of("/dev/pts/1234567"), "/dev/pts1234567");
    }
}
