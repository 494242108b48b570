//! The base on the register bus: frames and pauses of a master, judged by the document of the base
//! from bytes and motors alone.

mod bench;

use core::time::Duration;

use emulators::avr_base::AvrBaseConfig;
use emulators::avr_base::profile::{Bounds, Quirks, ReceiverKind, Registers, SetPoints, Watchdog};
use protocols::avr::{self, ChecksumOrder, Frame};

use super::step::Step;
use super::tape::Tape;
use crate::fuzz::subject::{Behaviour, Violation};
use bench::Master;
use engine::codec::wire::Choices;

/// The emulated base with some defects of the fielded firmware.
pub(super) struct Base {
    config: AvrBaseConfig,
    defects: Vec<String>,
}

/// Activates a defect.
type Switch = fn(&mut Quirks);

/// Defects that these laws can detect, each isolated as far as possible.
const SWITCHES: [(&str, Switch); 7] = [
    // Only if such a write is not refused.
    ("AV-02", |quirks| {
        quirks.bounds = Bounds::Memory;
        quirks.watchdog = Watchdog::Divider {
            counts: 40,
            clears: Registers::Cleared,
        };
    }),
    ("AV-03a", |quirks| quirks.bounds = Bounds::Memory),
    ("AV-03b", |quirks| quirks.bounds = Bounds::Memory),
    ("AV-03c", |quirks| quirks.bounds = Bounds::Memory),
    ("AV-04", |quirks| quirks.receiver = ReceiverKind::Interrupt),
    ("H-AV-1", |quirks| {
        quirks.watchdog = Watchdog::Divider {
            counts: 80,
            clears: Registers::Kept,
        };
    }),
    ("H-AV-2", |quirks| {
        quirks.set_points = SetPoints::Unsigned;
    }),
];

/// Whether the base has this defect.
pub(super) fn knows(id: &str) -> bool {
    SWITCHES.iter().any(|(known, _)| *known == id)
}

impl Base {
    pub(super) const NAME: &'static str = "base";

    pub(super) fn new(defects: &[String]) -> Self {
        let mut config = AvrBaseConfig {
            phase: Some(Duration::ZERO),
            ..AvrBaseConfig::default()
        };
        let mut quirks = config.quirks();
        let known = |id: &&String| knows(id);
        let defects: Vec<String> = defects.iter().filter(known).cloned().collect();
        for (id, switch) in SWITCHES {
            if defects.iter().any(|defect| defect == id) {
                switch(&mut quirks);
            }
        }
        config.quirks = Some(quirks);
        Self { config, defects }
    }
}

/// The byte order of the document.
const ORDER: ChecksumOrder = ChecksumOrder::LowFirst;
/// Maximum number of frames and pauses in a session.
const STEPS_MAX: usize = 12;
/// Registers at boundaries: set-points and their neighbours, counts, the end of the register map,
/// and addresses far behind it.
const REGISTERS: [u8; 16] = [
    46, 46, 46, 47, 45, 44, 48, 36, 40, 33, 49, 52, 53, 60, 254, 255,
];
/// Pauses, ms: within a frame, between frames, and longer than the time after which motors must
/// stop.
const PAUSES: [u32; 8] = [1, 30, 30, 30, 200, 900, 1200, 2500];

fn register(choices: &mut Choices<'_>) -> u8 {
    match choices.byte() {
        byte @ 0..208 => REGISTERS[usize::from(byte) % REGISTERS.len()],
        byte => byte.wrapping_mul(5),
    }
}

/// A frame of a master, possibly unusual.
fn frame(choices: &mut Choices<'_>) -> Frame {
    let register = register(choices);
    let kind = choices.byte();
    let count = match kind >> 1 {
        length @ 0..112 => length % 15,
        length => 120 + length % 8,
    };
    if kind & 1 == 0 {
        let mut data = choices.take(usize::from(count)).to_vec();
        data.resize(usize::from(count), 0);
        Frame::write(register, &data, ORDER)
    } else {
        Frame::read(register, count, ORDER)
    }
}

/// Changes, removes or adds one byte.
fn damage(bytes: &mut Vec<u8>, choices: &mut Choices<'_>) {
    let at = choices.below(bytes.len());
    match choices.byte() % 4 {
        0 | 1 => bytes[at] ^= 1 << (choices.byte() % 8),
        2 => drop(bytes.remove(at)),
        _ => bytes.insert(at, choices.byte()),
    }
}

impl super::Bench for Base {
    const NAME: &'static str = Self::NAME;
    const PORTS: &'static [(&'static str, u32)] = &[("base", avr::BAUD)];

    fn steps(&self, choices: &[u8]) -> Vec<Step> {
        let mut choices = Choices::new(choices);
        let mut steps = Vec::new();
        while !choices.is_empty() && steps.len() < STEPS_MAX {
            let kind = choices.byte() % 16;
            if kind < 9 {
                // A frame on a quiet line, as a correct master sends it.
                steps.push(Step::Wait(bench::QUIET_MS));
            }
            steps.push(match kind {
                0..11 => Step::Send(0, frame(&mut choices).as_bytes().to_vec()),
                11 => {
                    let mut bytes = frame(&mut choices).as_bytes().to_vec();
                    damage(&mut bytes, &mut choices);
                    Step::Send(0, bytes)
                }
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
        let mut master = Master::new(self.config.clone(), behaviour, tape);
        for (at, step) in steps.iter().enumerate() {
            match step {
                Step::Wait(ms) => master.wait(*ms)?,
                Step::Send(_, bytes) => {
                    let next = steps.get(at + 1);
                    let is_left_alone = match next {
                        Some(Step::Wait(ms)) => *ms >= bench::QUIET_MS,
                        Some(_) => false,
                        None => true,
                    };
                    master.send(bytes, is_left_alone)?;
                }
                Step::Reply(_) => {}
            }
        }
        master.end()
    }

    fn plainer(&self, step: &Step) -> Vec<Step> {
        match step {
            Step::Wait(ms) => PAUSES
                .iter()
                .filter(|pause| *pause < ms)
                .map(|pause| Step::Wait(*pause))
                .collect(),
            Step::Send(port, bytes) => {
                let frames = plainer_frames(bytes).into_iter();
                frames.map(|bytes| Step::Send(*port, bytes)).collect()
            }
            Step::Reply(_) => Vec::new(),
        }
    }

    fn defects(&self) -> &[String] {
        &self.defects
    }
}

/// Simpler variants of a write: with one byte fewer, or with one byte zero.
fn plainer_frames(bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut plainer = Vec::new();
    if bench::frame_len(bytes) != Some(bytes.len()) || bytes[2] < 0x80 {
        return plainer;
    }
    let data = &bytes[3..bytes.len() - 2];
    let write = |data: &[u8]| Frame::write(bytes[1], data, ORDER).as_bytes().to_vec();
    if let Some((_, fewer)) = data.split_last() {
        plainer.push(write(&fewer[..fewer.len() / 2]));
        plainer.push(write(fewer));
    }
    for at in 0..data.len() {
        for value in [0, 20] {
            let mut other = data.to_vec();
            if other[at] != 0 && other[at] != 20 {
                other[at] = value;
                plainer.push(write(&other));
            }
        }
    }
    plainer
}
