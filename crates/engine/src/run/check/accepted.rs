//! Checks that the base obeys its valid commands, and nothing else.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::Instant;

use super::{Check, Checker, Look};
use crate::Shared;
use crate::rig::Rig;
use crate::rig::line::{Delivery, Direction};
use crate::rig::trace::{Side, Tap};
use crate::robots::{Command, Dialect};

/// Minimum number of stored commands: the base may not have received the last ones.
const COMMANDS_MIN: usize = 8;
/// Minimum storage time of commands: a value may be active until the next one is received.
const REMEMBERED: Duration = Duration::from_secs(2);

/// Every active set-point comes from a valid frame that reached the base, or is 0. A frame with a
/// checksum mismatch commands nothing, also after damage on the line.
pub struct SetPointsAsAccepted {
    heard: Shared<Heard>,
    broken: Option<(Instant, String)>,
}

/// Stored accepted frames.
#[derive(Clone)]
struct Heard {
    link: usize,
    dialect: Dialect,
    /// The last bytes that reached the base.
    bytes: Vec<u8>,
    commands: VecDeque<(Instant, Command)>,
    accepted: u64,
}

impl SetPointsAsAccepted {
    /// Observes the frames that `rig` delivers on the link of `dialect`; `None` without such a
    /// link.
    pub fn listening(rig: &mut Rig, dialect: Dialect) -> Option<Self> {
        let link = rig
            .links()
            .iter()
            .position(|found| found.name == dialect.link)?;
        let heard = Shared::new(Heard {
            link,
            dialect,
            bytes: Vec::new(),
            commands: VecDeque::new(),
            accepted: 0,
        });
        rig.add_tap(Box::new(Ear::of(&heard)));
        Some(Self {
            heard,
            broken: None,
        })
    }
}

impl Heard {
    fn take(&mut self, at: Instant, bytes: &[u8]) {
        let known = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        for end in known + 1..=self.bytes.len() {
            let begin = end.saturating_sub(self.dialect.frame_max);
            // A frame may end with any byte, so each byte is tried, independent of a decoder's
            // state.
            let command = (self.dialect.command)(&self.bytes[begin..end]);
            if let Some(command) = command {
                self.accepted += 1;
                self.commands.push_back((at, command));
            }
        }
        let behind = self.bytes.len().saturating_sub(self.dialect.frame_max);
        self.bytes.drain(..behind);
        let is_old = |&(told, _): &(Instant, Command)| at - told > REMEMBERED;
        while self.commands.len() > COMMANDS_MIN && self.commands.front().is_some_and(is_old) {
            self.commands.pop_front();
        }
    }

    fn told(&self, axis: usize, set_point: f64) -> bool {
        // The active set-point is mostly that of the last command.
        let commands = self.commands.iter().rev();
        let mut told = commands.map(|(_, command)| command.get(axis).copied().flatten());
        set_point == 0.0 || told.any(|told| told == Some(set_point))
    }
}

struct Ear {
    link: usize,
    heard: Shared<Heard>,
}

impl Ear {
    fn of(heard: &Shared<Heard>) -> Self {
        Self {
            link: heard.lock().link,
            heard: heard.clone(),
        }
    }
}

impl Tap for Ear {
    fn record(&mut self, _: usize, _: Direction, _: Side, _: Instant, _: &[u8]) {}

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        if direction == Direction::ToDevice && link == self.link {
            let mut heard = self.heard.lock();
            heard.take(delivery.at, &delivery.bytes);
        }
    }
}

impl Checker for SetPointsAsAccepted {
    fn observe(&mut self, look: &Look<'_>) {
        if self.broken.is_some() {
            return;
        }
        let heard = self.heard.lock();
        let mut axes = look.axes.iter().enumerate();
        if axes.any(|(index, axis)| !heard.told(index, axis.set_point)) {
            self.broken = Some((look.rig.now(), super::set_points(look.axes)));
        }
    }

    fn verdict(&self) -> Check {
        let accepted = self.heard.lock().accepted;
        let detail = match &self.broken {
            None => format!("as commanded by {accepted} valid frames"),
            Some((at, points)) => format!("{points} at {at} s, which no valid frame commanded"),
        };
        let check = Check::new("set-points-as-accepted", self.broken.is_none(), detail);
        check.if_observed(accepted > 0)
    }

    fn fork(&self, rig: &mut Rig) -> Option<Box<dyn Checker>> {
        let heard = Shared::new(self.heard.lock().clone());
        rig.add_tap(Box::new(Ear::of(&heard)));
        let broken = self.broken.clone();
        Some(Box::new(Self { heard, broken }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of AA and the set-point of the only axis.
    fn heard() -> Heard {
        Heard {
            link: 0,
            dialect: Dialect {
                link: "base",
                frame_max: 2,
                command: |bytes| match bytes {
                    [0xAA, value] => Some(vec![Some(f64::from(*value))]),
                    _ => None,
                },
            },
            bytes: Vec::new(),
            commands: VecDeque::new(),
            accepted: 0,
        }
    }

    /// A frame may come in pieces, behind other bytes.
    #[test]
    fn set_points_are_those_of_valid_frames() {
        let mut heard = heard();
        heard.take(Instant::ZERO, &[7, 0xAA]);
        heard.take(Instant::ZERO, &[5, 9, 0xAA, 6]);
        assert_eq!((heard.accepted, heard.bytes.len()), (2, 2));
        let told = [0.0, 5.0, 6.0, 9.0].map(|value| heard.told(0, value));
        assert_eq!(told, [true, true, true, false]);
        assert!(heard.told(1, 0.0) && !heard.told(1, 5.0), "no such axis");
    }

    /// Of more than eight commands those of the last two seconds are kept.
    #[test]
    fn commands_are_kept_for_two_seconds() {
        let kept = |later_ms: u64| {
            let mut heard = heard();
            for value in 1..=8 {
                heard.take(Instant::ZERO, &[0xAA, value]);
            }
            assert_eq!(heard.commands.len(), 8);
            heard.take(Instant::from_millis(later_ms), &[0xAA, 9]);
            heard.commands.len()
        };
        assert_eq!((kept(2_000), kept(2_001)), (9, 8));
    }

    /// Frames count that reach the base: not those on the way back or of other links.
    #[test]
    fn only_frames_to_the_base_are_commands() {
        use super::super::Status;
        use super::super::safety::puppet::copied;
        use super::super::safety::tests::look_at;
        let names = ["base", "other"];
        let (mut rig, [base, other]) = crate::rig::bare::linked(names, 1_000_000);
        let dialect = heard().dialect;
        let mut checker = SetPointsAsAccepted::listening(&mut rig, dialect).expect("a link");
        let told = |checker: &SetPointsAsAccepted| {
            let check = checker.verdict();
            (check.status, check.detail)
        };
        let none = "as commanded by 0 valid frames".to_owned();
        assert_eq!(told(&checker), (Status::NotObserved, none));
        for (node, value) in [(base[1].node, 5), (base[0].node, 6), (other[1].node, 7)] {
            rig.inject(node, &[0xAA, value]);
        }
        look_at(&mut checker, &mut rig, 10, 5.0);
        look_at(&mut checker, &mut rig, 20, 0.0);
        assert_eq!(
            told(&checker),
            (Status::Pass, "as commanded by 1 valid frames".to_owned())
        );
        for (millis, set_point) in [(30, 6.0), (40, 7.0)] {
            look_at(&mut checker, &mut rig, millis, set_point);
        }
        let words = "6 at 0.030000 s, which no valid frame commanded";
        assert_eq!(told(&checker), (Status::Fail, words.to_owned()));
        assert!(copied(&checker, &rig).ends_with(words));
        let gone = Dialect {
            link: "gone",
            ..dialect
        };
        assert!(SetPointsAsAccepted::listening(&mut rig, gone).is_none());
    }
}
