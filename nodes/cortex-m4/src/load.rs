//! The processor's load: instructions a tick.

use cortex_m::Peripherals;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use semihosting::eprintln;

/// Under `-icount shift=2` an instruction takes 4 ns of QEMU's time, and the system timer of the
/// machine counts at 25 MHz: a count is 40 ns.
const INSTRUCTIONS_PER_COUNT: u64 = 10;
/// The timer has 24 bits.
const COUNTS: u32 = 1 << 24;

/// Instructions so far.
pub(crate) struct Load {
    timer: Option<SYST>,
    began: u32,
    clock_hz: u64,
    total: u64,
    now: u64,
    ticks: [Ticks; 2],
}

/// Instructions of each tick.
struct Ticks {
    /// Length, milliseconds.
    length_ms: u64,
    /// Number of the current tick.
    number: u64,
    /// Instructions of the current tick.
    current: u64,
    /// Fewest and most of a finished tick.
    least: u64,
    most: u64,
}

impl Load {
    /// Starts the timer.
    pub(crate) fn start(clock_hz: u64) -> Self {
        let timer = Peripherals::take().map(|peripherals| {
            let mut timer = peripherals.SYST;
            timer.set_clock_source(SystClkSource::Core);
            timer.set_reload(COUNTS - 1);
            timer.clear_current();
            timer.enable_counter();
            timer
        });
        let ticks = |length_ms| Ticks {
            length_ms,
            number: 0,
            current: 0,
            least: u64::MAX,
            most: 0,
        };
        Self {
            timer,
            began: 0,
            clock_hz,
            total: 0,
            now: 0,
            ticks: [ticks(1), ticks(200)],
        }
    }

    /// Work begins.
    pub(crate) fn begin(&mut self) {
        self.began = SYST::get_current();
    }

    /// Work that was due at `now`, nanoseconds, has ended.
    pub(crate) fn end(&mut self, now: u64) {
        let counts = self.began.wrapping_sub(SYST::get_current()) % COUNTS;
        let counts = if self.timer.is_some() { counts } else { 0 };
        let instructions = u64::from(counts) * INSTRUCTIONS_PER_COUNT;
        self.total += instructions;
        self.now = now;
        for ticks in &mut self.ticks {
            ticks.reach(now);
            ticks.current += instructions;
        }
    }

    /// Reports on standard error.
    pub(crate) fn report(&mut self) {
        let now = self.now;
        let ms = now / 1_000_000;
        eprintln!(
            "load: {} instructions in {ms} ms of the rig's time, {}.{:02} million a second",
            self.total,
            self.total / ms.max(1) / 1000,
            self.total / ms.max(1) % 1000 / 10,
        );
        for ticks in &mut self.ticks {
            ticks.reach(now);
            if ticks.number == 0 {
                continue;
            }
            let mean = self.total / ticks.number;
            let [least, mean, most] = [ticks.least, mean, ticks.most];
            let room = self.clock_hz * ticks.length_ms / 1000;
            let percent = |instructions: u64| {
                let hundredths = instructions.saturating_mul(10_000) / room.max(1);
                (hundredths / 100, hundredths % 100)
            };
            let [a, b, c] = [least, mean, most].map(percent);
            eprintln!(
                "load: a tick of {} ms has {least} to {most} instructions, mean {mean}: {}.{:02} % \
                 to {}.{:02} %, mean {}.{:02} % of {} MHz at one cycle an instruction",
                ticks.length_ms,
                a.0,
                a.1,
                c.0,
                c.1,
                b.0,
                b.1,
                self.clock_hz / 1_000_000,
            );
        }
    }
}

impl Ticks {
    /// Closes the ticks that have ended by `now`, nanoseconds.
    fn reach(&mut self, now: u64) {
        let number = now / (self.length_ms * 1_000_000);
        if number > self.number {
            let is_idle_between = number > self.number + 1;
            self.least = self.least.min(self.current);
            if is_idle_between {
                self.least = 0;
            }
            self.most = self.most.max(self.current);
            self.current = 0;
            self.number = number;
        }
    }
}
