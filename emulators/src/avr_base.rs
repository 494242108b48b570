//! The base of the rescue robot: an ATmega2560 that owns motors, encoders, infrared sensors and
//! battery, and serves them as byte registers on a checked bus of 1 Mbaud.
//!
//! ```text
//! bytes -> receiver -> pending requests -> answer -> sender -> bytes
//!                                            |
//!             world <- regulator <- registers + memory behind <- odometer, analog task <- world
//! ```
//!
//! The base acts only on frames whose checksum holds, and stops the motors by itself when the
//! master falls silent. A [`Profile`] selects the firmware. The fielded firmwares come with all
//! their defects and with their timing: see the module on ticks.
//!
//! Sources: seed report of 2015, chapter on the slave; field firmware b77a6df and 5f54f4d, run in
//! a simulated ATmega2560 with a byte every 10 us.

mod answer;
mod battery;
mod config;
mod cpu;
mod drive;
mod fault;
mod hand;
mod heat;
mod imu;
mod infrared;
pub mod journal;
pub mod led;
mod listen;
mod memory;
mod motors;
mod processor;
pub mod profile;
mod receiver;
mod request;
mod sender;
#[cfg(test)]
mod tests;
mod ticks;

use std::collections::VecDeque;

use core::time::Duration;

use protocols::avr::{BAUD, registers};
use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::device::{BrokenRules, byte_end, earliest};
use crate::rng::Rng;
use crate::world::{Drive, Wheel, World};
use crate::{Device, Event};

pub use battery::BatteryConfig;
pub use config::{Announce, AvrBaseConfig, DebugText, NATURAL_TEAR, StartCause};
pub use heat::Heat;
pub use imu::Imu;
pub use led::Led;
pub use profile::{Profile, Quirks};

use battery::Battery;
use drive::{Counter, Regulator};
use fault::Encoders;
use heat::Thermometers;
use imu::Gyro;
use journal::{Journal, rules};
use led::Trouble;
use memory::{Memory, Tasks};
use processor::Chip;
use profile::{Bounds, Processor, ReceiverKind, Restart};
use receiver::{Divider, Receiver};
use request::Request;
use sender::Sender;
use ticks::{ANALOG, CYCLE, DIVIDER, REGULATOR, Ticks};

/// The emulated base.
#[derive(Clone, Debug)]
pub struct AvrBase {
    config: AvrBaseConfig,
    quirks: Quirks,
    now: Instant,
    start: Start,
    ticks: Ticks,
    receiver: Receiver,
    pending: VecDeque<Pending>,
    bus: Sender,
    debug: Sender,
    memory: Memory,
    /// Variables by which the fielded builds switch their motors off; only a write over them has an
    /// effect.
    switched_off: [u8; 2],
    sides: [Side; 2],
    regulator_at: Instant,
    regulated: Instant,
    analog_at: Instant,
    infrared: infrared::Sensors,
    encoders: Encoders,
    battery: Battery,
    button: ButtonState,
    /// Until then the base announces the stop button without a request.
    announces_until: Instant,
    watchdog_at: Option<Instant>,
    motors: Motors,
    last_frame: Instant,
    chip: Chip,
    tear: Rng,
    thermometers: Thermometers,
    gyro: Gyro,
    journal: Journal,
}

/// Cause of the processor's start, and time of its next one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Start {
    cause: StartCause,
    /// The main loop runs from here on.
    up_at: Instant,
    /// The wheel counters begin at the next poll, which knows the world.
    counters: Counters,
    /// Time at which the watchdog restarts a processor that has run away.
    crashed_until: Option<Instant>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Counters {
    /// The run has just begun.
    First,
    /// The processor was reset: the motor driver was off for a moment.
    Again,
    Running,
}

/// A request and when the main loop will answer it.
#[derive(Clone, Debug)]
struct Pending {
    request: Request,
    due: Instant,
}

/// State of one wheel in the firmware.
#[derive(Clone, Copy, Debug, Default)]
struct Side {
    counter: Counter,
    regulator: Regulator,
    /// Count at the last run of the regulator.
    counted: i32,
    /// Speed measured by then, ticks per period.
    is: i16,
    /// Copied from its register by the main loop, not limited.
    set_point: i16,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ButtonState {
    Released,
    Pressed,
    /// Released, and still in force until then.
    Lingering(Instant),
    /// Pressed once, in force until pressed again.
    Toggled,
}

/// State of the motors, for the journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Motors {
    driven: bool,
    /// Reason for the last zero set-points.
    reason: &'static str,
    /// Wheels that debris holds, left and right.
    held: [bool; 2],
}

/// From power to the first reply: "within tens of milliseconds".
const BOOT: Duration = Duration::from_millis(30);
/// After its own watchdog the fielded firmware waits this long before its main loop.
const STALE_BOOT: Duration = Duration::from_secs(5);
/// Counts of the divider for which a released stop button stays in force.
const BUTTON_COUNTS: u16 = 120;
/// Counts of the divider after which the light shows that the master is silent.
const SILENT_COUNTS: u16 = 120;
/// Line rate of the debug port: 16 MHz / 16 / 9, called 115200 in the source.
const DEBUG_BAUD: u32 = 111_111;
const BUS_LINE: LineConfig = LineConfig::new_8n1(BAUD);
const DEBUG_LINE: LineConfig = LineConfig::new_8n1(DEBUG_BAUD);

const WHEELS: [Wheel; 2] = [Wheel::Left, Wheel::Right];
const SET_POINT_REGISTERS: [u8; 2] = [registers::SPEED_LEFT_TO, registers::SPEED_RIGHT_TO];

/// Work that the base has to do at some time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Job {
    Restart,
    GiveUpFrame,
    MotorWatchdog,
    Regulate,
    Analog,
    Answer,
    /// Step of the measured processor.
    Step,
}

impl AvrBase {
    /// The register bus.
    pub const BUS: Port = Port(0);
    /// The text of the debug build.
    pub const DEBUG: Port = Port(1);

    /// A base that had power before the run began.
    pub fn new(config: AvrBaseConfig, seed: u64) -> Self {
        let drawn = CYCLE.mul_f64(Rng::stream(seed, "base.phase").uniform());
        let ticks = Ticks::with_phase(config.phase.unwrap_or(drawn));
        let quirks = config.quirks();
        Self {
            now: Instant::ZERO,
            start: Start {
                cause: StartCause::PowerOn,
                up_at: Instant::ZERO,
                counters: Counters::First,
                crashed_until: None,
            },
            ticks,
            receiver: Receiver::new(&quirks),
            pending: VecDeque::new(),
            bus: Sender::new(BUS_LINE.byte_time()),
            debug: Sender::new(DEBUG_LINE.byte_time()),
            memory: Memory::new(quirks.map),
            switched_off: [0; 2],
            sides: [Side::default(); 2],
            regulator_at: ticks.after(Instant::ZERO, REGULATOR, 1),
            regulated: Instant::ZERO,
            analog_at: ticks.after(Instant::ZERO, ANALOG, 1),
            infrared: infrared::Sensors::new(seed),
            encoders: Encoders::default(),
            battery: Battery::new(config.battery),
            button: ButtonState::Released,
            announces_until: Instant::ZERO,
            watchdog_at: None,
            motors: Motors {
                driven: false,
                reason: "set-point",
                held: [false; 2],
            },
            last_frame: Instant::ZERO,
            chip: Chip::new(Instant::ZERO, ticks, Instant::ZERO),
            tear: Rng::stream(seed, "base.tear"),
            thermometers: Thermometers::new(seed),
            gyro: Gyro::new(seed),
            journal: Journal::default(),
            config,
            quirks,
        }
    }

    /// The firmware.
    pub const fn profile(&self) -> Profile {
        self.config.profile
    }

    /// Value of a register for the next read, as of the last poll.
    pub fn register(&self, address: u8) -> u8 {
        self.memory.get(address)
    }

    /// The wheel speeds in force, left and right, ticks per 40.16 ms, as the regulator limits them.
    pub fn set_points(&self) -> [i16; 2] {
        if self.is_stopped() {
            return [0; 2];
        }
        let max = profile::SET_POINT_MAX;
        self.sides.map(|side| side.set_point.clamp(-max, max))
    }

    /// Whether the motor driver is active, standing or driving.
    pub fn motors_enabled(&self) -> bool {
        self.memory.get(registers::MOTOR_STANDBY) == 0
    }

    /// State of the status light.
    pub fn led(&self) -> Led {
        let silent_at = self.ticks.after(self.last_frame, DIVIDER, SILENT_COUNTS);
        let trouble = if self.start.cause == StartCause::Watchdog {
            Some(Trouble::Restarted)
        } else if self.is_stopped() {
            Some(Trouble::Stopped)
        } else if self.now >= silent_at {
            Some(Trouble::Silent)
        } else {
            None
        };
        led::led(&self.memory, trouble)
    }

    /// The processor restarts: all registers and counts are 0.
    pub fn reset(&mut self, now: Instant, cause: StartCause) {
        self.forget(now, cause);
        let detail = match cause {
            StartCause::PowerOn => "power, or the reset button",
            StartCause::Watchdog => "the processor's watchdog",
        };
        self.journal.note(now, "started", detail.into());
    }

    fn forget(&mut self, now: Instant, cause: StartCause) {
        let stale =
            cause == StartCause::Watchdog && self.quirks.restart == Restart::FiveSecondsStale;
        self.start = Start {
            cause,
            up_at: now + if stale { STALE_BOOT } else { BOOT },
            counters: Counters::Again,
            crashed_until: None,
        };
        self.now = self.now.max(now);
        self.ticks = Ticks::started_at(now);
        self.chip = Chip::new(now, self.ticks, self.start.up_at);
        self.receiver = Receiver::new(&self.quirks);
        self.pending.clear();
        self.memory = Memory::new(self.quirks.map);
        self.switched_off = [0; 2];
        self.count_kits();
        self.gyro.restart();
        self.sides = [Side::default(); 2];
        self.regulator_at = now + REGULATOR;
        self.regulated = now;
        self.analog_at = now + ANALOG;
        self.infrared.restart();
        self.battery.forget();
        self.button = ButtonState::Released;
        self.watchdog_at = None;
        self.last_frame = now;
        self.motors.reason = "reset";
    }

    /// Whether the stop button holds the motors, or a write over its variable.
    fn is_stopped(&self) -> bool {
        if self.switched_off[0] != 0 {
            return true;
        }
        match self.button {
            ButtonState::Released => false,
            ButtonState::Pressed | ButtonState::Toggled => true,
            ButtonState::Lingering(until) => self.now < until,
        }
    }

    /// Whether the processor's time is modelled.
    fn is_measured(&self) -> bool {
        self.quirks.processor == Processor::Measured
    }

    /// Time at which an unfinished frame is discarded, unless the processor finds out by itself.
    fn frame_deadline(&self) -> Option<Instant> {
        if self.is_measured() && self.quirks.receiver == ReceiverKind::Interrupt {
            return None;
        }
        self.receiver.deadline(Divider {
            ticks: self.ticks,
            main_loop_from: self.start.up_at,
        })
    }

    fn next_job(&self) -> (Instant, Job) {
        if let Some(at) = self.start.crashed_until {
            return (at, Job::Restart);
        }
        let waits = [
            self.frame_deadline().map(|at| (at, Job::GiveUpFrame)),
            self.watchdog_at.map(|at| (at, Job::MotorWatchdog)),
        ];
        let first = if self.is_measured() {
            (self.chip_at(), Job::Step)
        } else {
            let answer = self.pending.front().map(|p| (p.due, Job::Answer));
            let analog = (self.analog_at, Job::Analog);
            let tasks = analog.min((self.regulator_at, Job::Regulate));
            answer.map_or(tasks, |answer| answer.min(tasks))
        };
        waits.into_iter().flatten().fold(first, Ord::min)
    }

    fn work(&mut self, at: Instant, job: Job, world: &mut World) {
        match job {
            Job::Restart => {
                self.reset(at, StartCause::Watchdog);
                self.start_counters(world);
            }
            Job::GiveUpFrame => {
                let mut heard = Vec::new();
                self.receiver.expire(at, &mut self.journal, &mut heard);
                heard.into_iter().for_each(|heard| self.hear(heard));
            }
            Job::MotorWatchdog => self.motor_watchdog(at, world),
            Job::Regulate => self.regulate(at, world),
            Job::Analog => self.analog(at, world),
            Job::Answer => {
                if let Some(Pending { request, .. }) = self.pending.pop_front() {
                    self.look_at_wheels(world);
                    self.main_loop_pass();
                    let reply = self.answer(at, &request);
                    self.bus.send(at, reply.as_bytes());
                }
            }
            Job::Step => {}
        }
    }

    /// Begins to count where the wheels are now.
    fn start_counters(&mut self, world: &mut World) {
        if self.start.counters == Counters::Again {
            // The driver pins float until the regulator runs for the first time.
            for wheel in WHEELS {
                world.set_drive(wheel, Drive::Coast);
            }
            self.tell_motors(self.now, false);
        }
        for (side, wheel) in self.sides.iter_mut().zip(WHEELS) {
            let edges = self.encoders.count(wheel, world.encoder_ticks(wheel));
            side.counter = Counter::started(self.now, edges);
        }
        if self.quirks.bounds == Bounds::Refused {
            self.battery
                .sample(self.now, self.quirks.battery, &mut self.memory);
        }
        self.start.counters = Counters::Running;
    }

    fn look_at_wheels(&mut self, world: &World) {
        for (side, wheel) in self.sides.iter_mut().zip(WHEELS) {
            let edges = self.encoders.count(wheel, world.encoder_ticks(wheel));
            if self.memory.tasks() == Tasks::Sound {
                side.counter
                    .look(self.quirks.odometer, self.ticks, self.now, edges);
            } else {
                side.counter.miss(self.now, edges);
            }
        }
        self.look_at_turn(world);
    }

    /// One run of the analog task: one block of distance sensors, floor, battery.
    fn analog(&mut self, at: Instant, world: &World) {
        self.analog_at = self.ticks.after(self.now, ANALOG, 1);
        let near = self.quirks.near_objects;
        self.infrared.measure(world, near, &mut self.memory);
        self.battery
            .sample(at, self.quirks.battery, &mut self.memory);
        self.feel(world);
    }
}

impl Device for AvrBase {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        if port != Self::BUS {
            return;
        }
        let mut heard = Vec::new();
        for (index, &byte) in bytes.iter().enumerate() {
            let at = byte_end(now, BUS_LINE, index, bytes.len());
            if self.is_measured() {
                if self.start.crashed_until.is_none() {
                    self.chip.cpu.receive(at, byte);
                }
                continue;
            }
            self.byte(at, byte, &mut heard);
            heard.drain(..).for_each(|heard| self.hear(heard));
        }
    }

    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        if port != Self::BUS {
            return;
        }
        match event {
            LineEvent::FramingError => {
                self.journal.violation(now, rules::FRAMING_ERROR, &[], || {
                    format!("a character without stop bit; the bus runs at {BAUD} baud")
                });
            }
            LineEvent::Break => {
                self.journal.violation(now, rules::BREAK, &[], || {
                    "the line was held low for longer than a character".into()
                });
            }
            LineEvent::Opened | LineEvent::Closed | LineEvent::ParityError | LineEvent::Overrun => {
            }
        }
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        self.now = self.now.max(now);
        if self.start.counters != Counters::Running {
            self.start_counters(world);
        }
        loop {
            let (at, job) = self.next_job();
            let runs = self.is_measured() && self.start.crashed_until.is_none();
            if runs && self.step(at.min(self.now), world) {
                continue;
            }
            if at > self.now {
                break;
            }
            self.work(at, job, world);
        }
        if self.start.crashed_until.is_none() && self.now >= self.start.up_at {
            self.main_loop_pass();
        }
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        match port {
            Self::BUS => self.bus.take(self.now, buf),
            Self::DEBUG => self.debug.take(self.now, buf),
            _ => 0,
        }
    }

    fn may_send(&self, port: Port) -> bool {
        match port {
            Self::BUS => self.bus.has_ready(self.now),
            Self::DEBUG => self.debug.has_ready(self.now),
            _ => false,
        }
    }

    fn poll_at(&self) -> Option<Instant> {
        let fresh = (self.start.counters != Counters::Running).then_some(self.now);
        let job = Some(self.next_job().0);
        let bus = self.bus.ready_after(self.now);
        let debug = self.debug.ready_after(self.now);
        earliest([fresh, job, bus, debug])
    }

    fn line_config(&self, port: Port) -> LineConfig {
        match port {
            Self::DEBUG => DEBUG_LINE,
            _ => BUS_LINE,
        }
    }

    fn known_faults(&self) -> &'static [&'static str] {
        self.faults()
    }

    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        self.change_fault(now, fault, figure, begins);
    }

    fn peek(&self, address: u8) -> Option<u8> {
        Some(self.register(address))
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.journal.take()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        Some(self.journal.broken())
    }
}
