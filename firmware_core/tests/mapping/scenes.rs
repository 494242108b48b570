//! Random scenes, in which every build of the mapper must produce the same poses and maps.

use core::f64::consts::TAU;

use firmware_core::slam::{Outcome, Settings};

use crate::measure::Run;
use crate::world::{Dice, Wall, World, boxed};

const SCENES: u64 = 4;
const TURNS: u32 = 30;

/// Fingerprint of every pose, every judgement and every map of all scenes, in both modes.
pub(crate) fn fingerprint() -> u64 {
    let mut print = Print::default();
    for seed in 1..=SCENES {
        for settings in [Settings::default(), Settings::document()] {
            play(seed, Settings { seed, ..settings }, &mut print);
        }
    }
    print.0
}

/// Blocks in a room, and a robot that drives at random; in every third scene a person pushes it.
fn play(seed: u64, settings: Settings, print: &mut Print) {
    let mut dice = Dice::new(seed);
    let mut run: Run = Run::new(world(seed, &mut dice), settings);
    for turn in 0..TURNS {
        run.world.command = [0; 2].map(|_| (dice.uniform() * 40.0).floor() - 12.0);
        let is_pushed = seed.is_multiple_of(3) && turn == TURNS / 2;
        run.world.push = [if is_pushed { 0.7 } else { 0.0 }, 0.0, 0.0];
        print.outcome(run.step());
    }
    print.bytes(run.mapper.grid().rows().as_flattened());
}

fn world(seed: u64, dice: &mut Dice) -> World {
    let mut walls: Vec<Wall> = boxed(60.0, 90.0, 2900.0, 2800.0).to_vec();
    for _ in 0..6 {
        let [x, y] = [0; 2].map(|_| 100.0 + dice.uniform() * 2500.0);
        let [width, height] = [0; 2].map(|_| 30.0 + dice.uniform() * 300.0);
        // The area around the robot's start stays free.
        if (x - 1400.0).abs() > 500.0 || (y - 1500.0).abs() > 500.0 {
            walls.extend(boxed(x, y, x + width, y + height));
        }
    }
    World::new(walls, [1500.0, 1600.0, dice.uniform() * TAU], seed)
}

/// FNV-1a with 64 bits.
struct Print(u64);

impl Default for Print {
    fn default() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }
}

impl Print {
    fn bytes(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01B3);
        }
    }

    fn outcome(&mut self, outcome: Outcome) {
        let Outcome { pose, score, .. } = outcome;
        for part in [pose.x_mm, pose.y_mm, pose.heading, outcome.quality] {
            self.bytes(&part.to_bits().to_le_bytes());
        }
        self.bytes(&score.to_le_bytes());
        for count in [outcome.tries, outcome.points, outcome.poses] {
            self.bytes(&count.to_le_bytes());
        }
        self.bytes(&[outcome.certainty as u8]);
    }
}
