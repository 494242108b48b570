//! Work of the sensor's processor: boot, wait, lock on the encoder, measure, lose the lock.
//!
//! The behaviour at low speed follows the coast-down at the end of the "hand in box" capture
//! (firmware 2.4). The other generations are assumed to behave alike.
//!
//! | module | is |
//! |---|---|
//! | `teeth` | effect of a tooth on the measurement |
//! | `output` | readings and packets, measured or not |
//! | `host` | input from the host |

mod host;
mod output;
mod teeth;

use core::time::Duration;

use protocols::Instant;
use protocols::xv11::FRAME_LEN;

use super::profile::{BOOT_TIME, DOT_TIME, DOTS, PROMPT_TIME};
use super::scan::{Pace, Scan};
use super::uart::Uart;
use super::{Fault, State, Xv11};
use crate::device::earliest;
use crate::lidar::rotor::nanos;
use crate::world::World;

/// Packet after packet without measuring: 45.5 indices per packet time of 1.9097 ms.
const FREE_RUN_TICK: Duration = Duration::from_nanos(41_950);
/// Time after which the firmware no longer waits for a tooth, in times of the previous one. A
/// guess.
const WAIT_TEETH: f64 = 1.5;
/// A head that turns but does not lock makes the processor restart after this. A guess; two sources
/// report that it restarts forever.
const SPIN_TIME: Duration = Duration::from_secs(2);
#[derive(Clone, Debug)]
enum Phase {
    Off,
    Boot {
        banner_at: Instant,
    },
    Spin {
        /// Next dot, or the text before them.
        print_at: Option<Instant>,
        dots: u8,
        give_up_at: Instant,
    },
    Locked,
    Slow {
        run: FreeRun,
        resume: Option<Resume>,
        give_up_at: Instant,
    },
    Doubled,
    Lost {
        run: FreeRun,
    },
    Console,
}

/// Packets made without measuring: the loop runs as fast as it can, and the transmitter has room
/// for only some of them.
#[derive(Clone, Copy, Debug)]
struct FreeRun {
    code: u8,
    from: Instant,
    /// Packet index at tick 0.
    base: u8,
    tick: u64,
}

/// Continuation of measuring after a pause.
#[derive(Clone, Copy, Debug)]
struct Resume {
    at: Instant,
    pace: Pace,
    doubled: bool,
}

/// State of the processor.
#[derive(Clone, Debug)]
pub(super) struct Firmware {
    phase: Phase,
    scan: Scan,
    /// Time of the last tooth.
    last_edge: Option<Instant>,
    /// Duration of a tooth, as the firmware assumes.
    tooth_s: f64,
    word: u16,
    good_teeth: u8,
    /// Time of the next restart, if it is known.
    restart_at: Option<Instant>,
    /// Whether the 1446-byte frame of firmware 2.1 was begun.
    turn_begun: bool,
    escapes: u8,
    /// Whether late teeth, and a head too fast for the line, were reported since the last lock.
    late_told: bool,
    overspeed_told: bool,
}

impl FreeRun {
    fn at(&self, tick: u64) -> Instant {
        let ticks = u32::try_from(tick).unwrap_or(u32::MAX);
        self.from + FREE_RUN_TICK.saturating_mul(ticks)
    }

    /// The next tick that finds room.
    fn next_tick(&self, uart: &Uart) -> u64 {
        let room = (uart.room_at(FRAME_LEN) - self.from).as_nanos();
        let tick = room.div_ceil(FREE_RUN_TICK.as_nanos());
        u64::try_from(tick).unwrap_or(u64::MAX).max(self.tick)
    }

    fn next_at(&self, uart: &Uart) -> Instant {
        self.at(self.next_tick(uart))
    }

    fn index(&self, tick: u64) -> u8 {
        let index = (u64::from(self.base) + tick) % 90;
        u8::try_from(index).expect("below 90")
    }
}

impl Firmware {
    /// A processor that is powered at the beginning of the run.
    pub(super) fn new() -> Self {
        Self {
            phase: Phase::Boot {
                banner_at: Instant::ZERO + BOOT_TIME,
            },
            scan: Scan::new(),
            last_edge: None,
            tooth_s: 0.0,
            word: 0,
            good_teeth: 0,
            restart_at: None,
            turn_begun: false,
            escapes: 0,
            late_told: false,
            overspeed_told: false,
        }
    }

    pub(super) fn state(&self) -> State {
        match self.phase {
            Phase::Off => State::Off,
            Phase::Boot { .. } => State::Boot,
            Phase::Spin { .. } => State::Spin,
            Phase::Locked => State::Locked,
            Phase::Slow { .. } => State::Slow,
            Phase::Doubled => State::Doubled,
            Phase::Lost { .. } => State::Lost,
            Phase::Console => State::Console,
        }
    }

    /// Time of the processor's next work.
    pub(super) fn next_at(&self, uart: &Uart) -> Option<Instant> {
        let own = match &self.phase {
            Phase::Off | Phase::Console => None,
            Phase::Boot { banner_at } => Some(*banner_at),
            Phase::Spin {
                print_at,
                give_up_at,
                ..
            } => earliest([*print_at, Some(*give_up_at)]),
            Phase::Locked => self.scan.full_at().or_else(|| self.wait_until()),
            Phase::Doubled => self.scan.full_at().or_else(|| self.scan.end()),
            Phase::Slow {
                run,
                resume,
                give_up_at,
            } => {
                let end = resume.map_or(*give_up_at, |resume| resume.at);
                Some(end.min(run.next_at(uart)))
            }
            Phase::Lost { run } => Some(run.next_at(uart)),
        };
        earliest([own, self.restart_at])
    }

    /// End of the wait for a tooth.
    fn wait_until(&self) -> Option<Instant> {
        let edge = self.last_edge?;
        Some(edge + nanos(WAIT_TEETH * self.tooth_s))
    }
}

impl Xv11 {
    /// Handles the work due at `at`.
    pub(super) fn step(&mut self, at: Instant, world: &World) {
        let cut = self
            .firmware
            .restart_at
            .filter(|&cut| self.edge_at.is_none_or(|edge| edge > cut));
        self.uart.release(at, cut);
        if self.edge_at.is_some_and(|edge| edge <= at) {
            self.tooth_passes(at, world);
        } else if self.firmware.restart_at.is_some_and(|cut| cut <= at) {
            self.restart(at);
        } else if self.work_at.is_some_and(|due| due <= at) {
            self.work(at, world);
        }
        self.foresee();
    }

    fn work(&mut self, at: Instant, world: &World) {
        match self.firmware.phase {
            Phase::Off | Phase::Console => {}
            Phase::Boot { .. } => self.boot(at),
            Phase::Spin { .. } => self.spin(at),
            Phase::Locked if self.firmware.scan.full_at().is_none() => self.lose(at, world),
            Phase::Doubled if self.firmware.scan.full_at().is_none() => self.lose(at, world),
            Phase::Locked | Phase::Doubled => self.measure_until(at, world),
            Phase::Slow { resume, .. } => match resume.filter(|resume| resume.at <= at) {
                Some(resume) => self.resume(resume),
                None if self.give_up_due(at) => self.lose(at, world),
                None => self.free_run(at),
            },
            Phase::Lost { .. } => self.free_run(at),
        }
    }

    pub(super) fn switch_off(&mut self, now: Instant) {
        self.uart.power_off(now);
        self.firmware = Firmware {
            phase: Phase::Off,
            ..Firmware::new()
        };
    }

    pub(super) fn switch_on(&mut self, now: Instant) {
        self.firmware = Firmware {
            phase: Phase::Boot {
                banner_at: now + BOOT_TIME,
            },
            ..Firmware::new()
        };
    }

    fn restart(&mut self, at: Instant) {
        self.uart.reset(at);
        self.switch_on(at);
        self.log
            .note(at, "restarted", "the processor restarts".to_owned());
    }

    /// Orders a restart: in the middle of the next packet, or at once if no packet is in progress.
    pub(super) fn order_restart(&mut self, now: Instant) {
        match self.firmware.phase {
            Phase::Off => {}
            Phase::Locked | Phase::Slow { .. } | Phase::Doubled | Phase::Lost { .. } => {
                self.faults.set(Fault::Restart);
            }
            Phase::Boot { .. } | Phase::Spin { .. } | Phase::Console => self.restart(now),
        }
    }

    fn boot(&mut self, at: Instant) {
        self.uart.print(at, self.profile.banner());
        let text_at = at + PROMPT_TIME;
        self.firmware.phase = Phase::Spin {
            print_at: Some(text_at),
            dots: 0,
            give_up_at: text_at + SPIN_TIME,
        };
        self.log.note(at, "booted", "boot text printed".to_owned());
    }

    fn spin(&mut self, at: Instant) {
        let Phase::Spin {
            print_at,
            dots,
            give_up_at,
        } = &mut self.firmware.phase
        else {
            return;
        };
        if let Some(due) = print_at.filter(|&due| due <= at) {
            // The text counts as dot number zero.
            let text = if *dots == 0 {
                self.profile.spin_text()
            } else {
                "."
            };
            self.uart.print(at, text);
            *print_at = (*dots < DOTS).then_some(due + DOT_TIME);
            *dots += 1;
            return;
        }
        // The firmware says nothing about a head that stands still; it gives up only a turning one.
        let turned = self
            .firmware
            .last_edge
            .is_some_and(|edge| at - edge < SPIN_TIME);
        *give_up_at = at + SPIN_TIME;
        if turned || self.faults.has(Fault::EncoderBlind) {
            self.restart(at);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xv11::Config;

    const NOW: Instant = Instant::from_secs(100);

    /// State after a sensor has waited for its head in vain, with the last tooth this long ago.
    fn given_up(tooth: Option<Duration>) -> (State, Option<Instant>) {
        let mut lidar = Xv11::new("lidar", 1, Config::default());
        lidar.firmware.phase = Phase::Spin {
            print_at: None,
            dots: 0,
            give_up_at: NOW,
        };
        lidar.firmware.last_edge = tooth.map(|ago| Instant::ZERO + (NOW - Instant::ZERO - ago));
        lidar.spin(NOW);
        (lidar.firmware.state(), lidar.firmware.next_at(&lidar.uart))
    }

    /// The firmware gives up only a turning head; it waits for one that stands.
    #[test]
    fn a_head_that_turns_unevenly_is_given_up() {
        let nanosecond = Duration::from_nanos(1);
        assert_eq!(given_up(Some(SPIN_TIME - nanosecond)).0, State::Boot);
        assert_eq!(given_up(Some(Duration::from_millis(20))).0, State::Boot);
        let waits = (State::Spin, Some(NOW + SPIN_TIME));
        assert_eq!([given_up(Some(SPIN_TIME)), given_up(None)], [waits; 2]);
    }

    /// The firmware sends a text, then one dot each time, and no text after the last dot.
    #[test]
    fn a_head_that_is_waited_for_makes_dots() {
        let mut lidar = Xv11::new("lidar", 1, Config::default());
        lidar.boot(NOW);
        let mut times = Vec::new();
        while let Phase::Spin {
            print_at: Some(at), ..
        } = lidar.firmware.phase
        {
            times.push(at);
            lidar.spin(at);
        }
        let text_at = NOW + PROMPT_TIME;
        assert_eq!(times.len(), usize::from(DOTS) + 1);
        let expected = (0..).map(|dot| text_at + DOT_TIME * dot);
        assert!(times.iter().copied().eq(expected.take(times.len())));
    }

    /// After 90 packets the first index comes again; the ticks between packets equal a packet's
    /// time.
    #[test]
    fn packets_of_a_free_run_follow_each_other() {
        let run = FreeRun {
            code: 0x52,
            from: NOW,
            base: 84,
            tick: 1,
        };
        assert_eq!([0, 5, 6, 96].map(|tick| run.index(tick)), [84, 89, 0, 0]);
        assert_eq!(run.at(0), NOW);
        assert_eq!(run.at(3) - NOW, FREE_RUN_TICK * 3);
    }
}
