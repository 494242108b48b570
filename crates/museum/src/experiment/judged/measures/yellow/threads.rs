//! The table of threads: periods that show outside of the robot.

use core::time::Duration;
use std::sync::{Arc, Mutex};

use engine::rig::line::Direction;
use engine::rig::trace::{Side, Tap};
use engine::run::Run;
use firmware_core::Master as _;
use firmware_core::robots::yellow::{Mode, Yellow};
use protocols::peripherals::{OutputsDecoder, OutputsFormat};
use protocols::telemetry::message::{State, Telecommand};
use protocols::{Decode as _, Instant};

use super::missions::{frame, of_pc};
use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::{Measure, Model, Told, by_seed};
use crate::experiment::runs::start;

/// Page 3: the table of threads.
pub(in super::super) const THREADS: Measure = Measure {
    name: "yellow-threads",
    planted: "a link that loses one byte in fifty, and the published state machine",
    perform: threads,
};

/// The published state machine, which runs each 10 ms.
const SLOW: &str = "YS-03";
/// A room in which the robot rests.
const ROOM: &str = "schema = 1\nname = \"room\"\nrobot = \"yellow\"\nduration = \"60s\"\n\
    [mission]\nto_the_end = true\n\
    [world]\nstart = { x_m = 1, y_m = 1, heading_deg = 0 }\n[[world.wall]]\n\
    path_m = [[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]]\n";
/// Duration of the measurement of the telemetry and the motor control, seconds.
const SECONDS: u64 = 20;
/// Orders to the state machine, the time between two, and the step in which it is watched. The time
/// is no multiple of 10 ms, so the orders come at all phases.
const ORDERS: u64 = 20;
const BETWEEN: Duration = Duration::from_micros(1_203_300);
const WATCH: Duration = Duration::from_micros(250);

fn threads(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let fault = "[[fault]]\nkind = \"drop\"\nlink = \"telemetry\"\n\
        direction = \"to-device\"\nrate = 0.02\n";
    let text = format!("{ROOM}{}", model.pick("", fault));
    let ends = by_seed(plan, tell, |seed| {
        let mut run = start(&text, seed, |scenario| {
            if model == Model::Planted {
                super::missions::with_defect(scenario, SLOW);
            }
        });
        let outputs = Outputs::of(&mut run);
        let mut counts = |seconds: u64| {
            run.go_on_until(Instant::from_secs(seconds));
            let frames = of_pc(&run.instruments().panels(&run.rig), "frames");
            [frames, outputs.count() as f64]
        };
        let (from, until) = (counts(2), counts(2 + SECONDS));
        let [telemetry, motor] = [0, 1].map(|of| 1_000.0 * SECONDS as f64 / (until[of] - from[of]));
        [telemetry, motor, longest_wait_ms(&mut run)]
    });
    let mut measured = Measured::default();
    let names = [
        "period of the telemetry (ms)",
        "period of the motor control (ms)",
        "longest wait for the state machine (ms)",
    ];
    for (index, name) in names.into_iter().enumerate() {
        measured.value(name, ends.iter().map(|end| end[index]));
    }
    measured
}

/// Longest time from an order to the state that it leads to, ms.
fn longest_wait_ms(run: &mut Run) -> f64 {
    let mut longest = Duration::ZERO;
    for order in 0..ORDERS {
        let state = if order % 2 == 0 {
            State::Manual
        } else {
            State::Off
        };
        run.go_on_until(run.rig.now() + BETWEEN);
        let mode = |run: &Run| run.rig.program_as::<Yellow>().map(Yellow::mode);
        let (before, begun): (Option<Mode>, Instant) = (mode(run), run.rig.now());
        let command = Telecommand {
            state: Some(state),
            ..Telecommand::default()
        };
        if let Some(program) = run.rig.program_as_mut::<Yellow>() {
            program.receive(Yellow::TELEMETRY, begun, &frame(&command));
        }
        while mode(run) == before && run.rig.now() < begun + BETWEEN {
            run.go_on_until(run.rig.now() + WATCH);
        }
        longest = longest.max(run.rig.now() - begun);
    }
    1_000.0 * longest.as_secs_f64()
}

/// Counts the set-points of the motors on the board's link.
#[derive(Clone, Debug)]
struct Outputs {
    link: usize,
    state: Arc<Mutex<(OutputsDecoder, u64)>>,
}

impl Outputs {
    /// Listens to a run.
    fn of(run: &mut Run) -> Self {
        let mut links = run.rig.links().iter();
        let outputs = Self {
            link: links.position(|link| link.name == "board").unwrap_or(0),
            state: Arc::new(Mutex::new((OutputsDecoder::with_format(OutputsFormat), 0))),
        };
        run.rig.add_tap(Box::new(outputs.clone()));
        outputs
    }

    fn count(&self) -> u64 {
        self.state.lock().map_or(0, |state| state.1)
    }
}

impl Tap for Outputs {
    fn record(&mut self, link: usize, to: Direction, side: Side, _: Instant, bytes: &[u8]) {
        if (link, to, side) == (self.link, Direction::ToDevice, Side::Sent)
            && let Ok(mut state) = self.state.lock()
        {
            let (decoder, count) = &mut *state;
            *count += decoder.push(bytes).flatten().count() as u64;
        }
    }
}
