//! The rescue robot's program between its three links, without a world: damaged traffic on all
//! links, and a base with damaged replies. The judge uses the bytes that the program can have
//! received, and its memory.

mod bench;

use firmware_core::robots::rescue::{Config, Display};
use protocols::{avr, pcui, xv11};

use super::step::{Spoil, Step};
use super::tape::Tape;
use crate::fuzz::subject::{Behaviour, Violation};
use bench::Around;
use engine::codec;
use engine::codec::wire::{Choices, Wire};

/// The program with some defects of the fielded one.
pub(super) struct Robot {
    config: Config,
    defects: Vec<String>,
}

/// Whether the program has this defect.
pub(super) fn knows(id: &str) -> bool {
    Config::defects().any(|known| known == id)
}

impl Robot {
    pub(super) const NAME: &'static str = "rescue";

    pub(super) fn new(defects: &[String]) -> Self {
        let known = |id: &&String| knows(id);
        let defects: Vec<String> = defects.iter().filter(known).cloned().collect();
        let sound = Config {
            display: Display::None,
            ..Config::default()
        };
        let config = defects.iter().fold(sound, |config, id| {
            config.with_defect(id).expect("those known were kept")
        });
        Self { config, defects }
    }
}

pub(super) const LIDAR: usize = 0;
pub(super) const BASE: usize = 1;
pub(super) const RADIO: usize = 2;

/// Maximum number of steps in a session.
const STEPS_MAX: usize = 24;
/// Pauses, ms; each of them ends a wait for the rest of a frame.
const PAUSES: [u32; 4] = [120, 120, 200, 600];

/// A frame, intact, truncated, with one byte changed, removed or added, or with its own beginning
/// before it.
fn frame<W: Wire>(choices: &mut Choices<'_>) -> Vec<u8> {
    let damage = choices.byte();
    let mut bytes = Vec::new();
    W::build(choices, &mut bytes);
    let at = choices.below(bytes.len());
    match damage % 16 {
        0..8 => return bytes,
        8 | 9 => bytes[at] ^= 1 << (choices.byte() % 8),
        // The header determines the interpretation of the rest.
        10 | 11 => {
            let header = bytes.len().min(14);
            bytes[at % header] ^= 1 << (choices.byte() % 8);
        }
        12 => drop(bytes.remove(at)),
        13 => bytes.insert(at, choices.byte()),
        14 => bytes.truncate(at),
        _ => {
            let head = bytes[..at.min(8)].to_vec();
            bytes.splice(0..0, head);
            return bytes;
        }
    }
    if damage >= 192 {
        W::repair(&mut bytes);
    }
    bytes
}

fn spoil(choices: &mut Choices<'_>) -> Spoil {
    match choices.byte() % 9 {
        0 => Spoil::Nothing,
        1 => Spoil::Acknowledged,
        2 => Spoil::Error,
        3 => Spoil::Count(choices.byte()),
        4 => Spoil::Register(choices.byte()),
        5 => Spoil::Flip(choices.byte(), choices.byte() % 8),
        6 => Spoil::Cut(choices.byte() % 16),
        7 => Spoil::Twice,
        _ => Spoil::Late(choices.byte() % 32),
    }
}

impl super::Bench for Robot {
    const NAME: &'static str = Self::NAME;
    const PORTS: &'static [(&'static str, u32)] = &[
        ("lidar", xv11::BAUD),
        ("base", avr::BAUD),
        ("radio", pcui::BAUD),
    ];

    fn steps(&self, choices: &[u8]) -> Vec<Step> {
        let mut choices = Choices::new(choices);
        let mut steps = Vec::new();
        while !choices.is_empty() && steps.len() < STEPS_MAX {
            steps.push(match choices.byte() % 16 {
                0..4 => Step::Send(RADIO, frame::<codec::Pcui>(&mut choices)),
                4..8 => Step::Send(LIDAR, frame::<codec::Xv11>(&mut choices)),
                8 => Step::Send(BASE, frame::<codec::Avr<codec::LowFirst>>(&mut choices)),
                9..12 => Step::Reply(spoil(&mut choices)),
                _ => Step::Wait(PAUSES[choices.below(PAUSES.len())]),
            });
        }
        steps
    }

    fn judge(
        &self,
        steps: &[Step],
        behaviour: &mut Behaviour,
        tape: &mut Tape,
    ) -> Result<(), Violation> {
        let mut around = Around::new(self.config, tape);
        let judged = around.live_through(steps);
        around.note(behaviour);
        judged
    }

    fn plainer(&self, step: &Step) -> Vec<Step> {
        match step {
            Step::Wait(ms) if *ms > PAUSES[0] => vec![Step::Wait(PAUSES[0])],
            Step::Send(port, bytes) => {
                let plainer = match *port {
                    LIDAR => plainer::<codec::Xv11>(bytes),
                    RADIO => {
                        let mut all = fewer_waypoints(bytes);
                        all.extend(plainer::<codec::Pcui>(bytes));
                        all
                    }
                    _ => plainer::<codec::Avr<codec::LowFirst>>(bytes),
                };
                plainer
                    .into_iter()
                    .map(|bytes| Step::Send(*port, bytes))
                    .collect()
            }
            _ => Vec::new(),
        }
    }

    fn defects(&self) -> &[String] {
        &self.defects
    }
}

/// Simpler variants of a list of waypoints, each without one waypoint.
fn fewer_waypoints(bytes: &[u8]) -> Vec<Vec<u8>> {
    let Some((head, list)) = bytes.split_at_checked(pcui::HEADER_LEN + 2) else {
        return Vec::new();
    };
    let is_list = head[14..17] == *b"LWP" && usize::from(head[17]) * 9 == list.len();
    let count = if is_list { list.len() / 9 } else { 0 };
    let without = |index: usize| {
        let mut fewer = [head, &list[..9 * index], &list[9 * index + 9..]].concat();
        fewer[17] -= 1;
        codec::Pcui::repair(&mut fewer);
        fewer
    };
    (0..count).map(without).collect()
}

/// Simpler variants of `bytes`: half of them, one byte fewer, one byte zero. If `bytes` were a
/// frame, the variants are frames too.
fn plainer<W: Wire>(bytes: &[u8]) -> Vec<Vec<u8>> {
    let was_frame = W::frame_at(bytes) == Some(bytes.len());
    let mut plainer = vec![bytes[..bytes.len() / 2].to_vec()];
    for at in 0..bytes.len() {
        plainer.push([&bytes[..at], &bytes[at + 1..]].concat());
    }
    for at in 0..bytes.len() {
        let mut other = bytes.to_vec();
        if other[at] != 0 {
            other[at] = 0;
            plainer.push(other);
        }
    }
    if was_frame {
        plainer.iter_mut().for_each(|bytes| W::repair(bytes));
        plainer.retain(|bytes| W::frame_at(bytes) == Some(bytes.len()));
    }
    plainer.retain(|other| !other.is_empty() && other.len() <= bytes.len() && other != bytes);
    plainer
}
