//! Commands to the motor board, decoded from the bytes.

use std::sync::LazyLock;

use emulators::wheel_board::{Config, WheelBoard};
use protocols::peripherals::{OUTPUTS_LEN, Outputs, OutputsFormat};
use protocols::{Candidate, Format as _};

use crate::robots::{Command, Dialect};

/// Arbitrary outputs: if a board has other motors, these outputs give other speeds.
const PROBE: Outputs = Outputs {
    duty: [6_000, 7_000],
    channel: 0,
    enable: true,
};

/// The board with the robot's own motors.
static OWN: LazyLock<Config> = LazyLock::new(Config::default);

/// The protocol of commands; `None` if the board does not have the robot's own motors, because
/// frames alone then do not determine the speeds.
pub(super) fn dialect(board: &WheelBoard) -> Option<Dialect> {
    let [own, found] = [&OWN, board.config()].map(|it| it.set_points(PROBE));
    let is_own = own.map(f64::to_bits) == found.map(f64::to_bits);
    is_own.then_some(Dialect {
        link: "board",
        frame_max: OUTPUTS_LEN,
        command,
    })
}

/// The set-points in the last frame of `bytes`.
fn command(bytes: &[u8]) -> Option<Command> {
    let format = OutputsFormat;
    let is_whole = format.judge(bytes) == Candidate::Complete(OUTPUTS_LEN);
    let outputs = (is_whole && bytes.len() == OUTPUTS_LEN).then(|| format.frame(bytes))?;
    let set_points = OWN.set_points(outputs);
    Some(set_points.map(Some).to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 0.6 is 2.4 V of 12 V; 40 rpm/V give 96 rpm, 0.377 m/s; the right motor is mounted in
    /// reverse. Disabled bridges command nothing; a partial frame is ignored.
    #[test]
    fn a_frame_commands_both_wheels() {
        let outputs = Outputs {
            duty: [6_000, 4_000],
            channel: 0,
            enable: true,
        };
        let told = command(&outputs.encode()).expect("a frame");
        let near = |told: &Option<f64>| told.is_some_and(|it| (it - 0.377).abs() < 0.001);
        assert!(told.len() == 2 && told.iter().all(near), "{told:?}");
        let off = Outputs {
            enable: false,
            ..outputs
        };
        assert_eq!(command(&off.encode()), Some(vec![Some(0.0); 2]));
        assert_eq!(command(&outputs.encode()[1..]), None);
    }
}
