//! Commands of a page, as JSON: `{"do": "add", "at": [1200, 800]}`.

use serde::Deserialize;
use tokio::sync::mpsc;

use engine::robots::Gesture;
use engine::scenario::{FaultSpec, SetPoint};

/// Maximum length of a command, bytes.
pub(super) const COMMAND_MAX: usize = 2048;

/// A command of a page.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub(super) enum Command {
    /// Pauses virtual time.
    Pause,
    /// Resumes virtual time.
    Play,
    /// Advances virtual time by this much, then pauses.
    Step { ms: u32 },
    /// Sets the speed, virtual seconds per second.
    Speed { x: f64 },
    /// Restarts the run, with another seed if given.
    Restart { seed: Option<u64> },
    /// Branches the run from an earlier time, nanoseconds, and pauses there.
    Branch { at_ns: u64 },
    /// Adds a waypoint, millimetres of the map.
    Add { at: [i32; 2] },
    /// Moves a waypoint.
    Move {
        index: usize,
        from: [i32; 2],
        to: [i32; 2],
    },
    /// Deletes a waypoint.
    Delete { index: usize, at: [i32; 2] },
    /// Deletes all waypoints.
    Clear,
    /// Sends an order to the robot.
    Mode { mode: String },
    /// Sets the axes by hand.
    Drive { axes: Vec<SetPoint> },
    /// Touches the robot's display, column and row.
    Tap { place: [u16; 2] },
    /// The PC opens its port.
    Connect,
    /// The PC closes its port.
    Disconnect,
    /// Begins a fault, for a time if one is given.
    Fault {
        fault: Box<FaultSpec>,
        for_ms: Option<u32>,
    },
    /// Ends a fault.
    EndFault { id: usize },
    /// Saves the run so far as a scenario. Sent only by the server itself.
    #[serde(skip)]
    Save,
}

impl Command {
    /// Parses a command; the error names the expected input.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        if text.len() > COMMAND_MAX {
            return Err(format!("a command has at most {COMMAND_MAX} bytes"));
        }
        serde_json::from_str(text).map_err(|error| format!("not a command: {error}"))
    }

    /// The action of the command on the robot, if it has one.
    pub(super) fn gesture(&self) -> Option<Gesture> {
        Some(match self {
            &Self::Add { at } => Gesture::Add { at },
            &Self::Move { index, from, to } => Gesture::Move { index, from, to },
            &Self::Delete { index, at } => Gesture::Delete { index, at },
            Self::Clear => Gesture::Clear,
            Self::Mode { mode } => Gesture::Mode(mode.clone()),
            Self::Connect => Gesture::Connect,
            Self::Disconnect => Gesture::Disconnect,
            _ => return None,
        })
    }
}

/// A command and the channel for its answer.
#[derive(Debug)]
pub(super) struct Envelope {
    pub(super) command: Command,
    pub(super) reply: mpsc::Sender<Answer>,
}

impl Envelope {
    /// Sends an answer to the page; a page that does not read misses it.
    pub(super) fn answer(&self, answer: Answer) {
        // A full or closed queue affects only this page.
        drop(self.reply.try_send(answer));
    }
}

/// An answer to a page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Answer {
    /// The command was refused, with the reason.
    Refused(String),
    /// The requested scenario.
    Case(String),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_read() {
        let read = |text| Command::parse(text).expect("a command");
        assert_eq!(read(r#"{"do":"pause"}"#), Command::Pause);
        assert_eq!(
            read(r#"{"do":"move","index":1,"from":[1,2],"to":[3,4]}"#),
            Command::Move {
                index: 1,
                from: [1, 2],
                to: [3, 4]
            }
        );
        let text = r#"{"do":"fault","fault":{"link":"base","direction":"to-device",
                       "kind":"flip","rate":0.01},"for_ms":500}"#;
        assert!(matches!(
            read(text),
            Command::Fault {
                for_ms: Some(500),
                ..
            }
        ));
    }

    #[test]
    fn what_is_no_command_is_refused_with_a_reason() {
        let wrong = [
            "",
            "[]",
            "{}",
            r#"{"do":"fly"}"#,
            r#"{"do":"save"}"#,
            r#"{"do":"drive","wheels":[200,0]}"#,
            r#"{"do":"add","at":[1]}"#,
            r#"{"do":"add","at":[1,2],"more":3}"#,
            r#"{"do":"add","at":["<b>",2]}"#,
        ];
        for text in wrong {
            assert!(Command::parse(text).is_err(), "{text}");
        }
        let huge = format!(r#"{{"do":"pause","x":"{}"}}"#, "x".repeat(COMMAND_MAX));
        assert!(Command::parse(&huge).expect_err("huge").contains("2048"));
        let deep = "[".repeat(COMMAND_MAX);
        assert!(Command::parse(&deep).is_err());
    }
}
