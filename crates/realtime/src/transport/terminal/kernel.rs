//! Conversion of a terminal's settings from and to the kernel's form.

use rustix::io::Result;
use rustix::termios::{
    ControlModes, InputModes, LocalModes, OutputModes, SpecialCodeIndex as Index, Termios,
};

use super::settings::{Code, Settings, bits};

/// The special characters by their indices in [`Settings`]; the index without a character is not
/// used.
const CODES: [(usize, Index); 17] = [
    (0, Index::VINTR),
    (1, Index::VQUIT),
    (2, Index::VERASE),
    (3, Index::VKILL),
    (4, Index::VEOF),
    (5, Index::VTIME),
    (6, Index::VMIN),
    (7, Index::VSWTC),
    (8, Index::VSTART),
    (9, Index::VSTOP),
    (10, Index::VSUSP),
    (11, Index::VEOL),
    (12, Index::VREPRINT),
    (13, Index::VDISCARD),
    (14, Index::VWERASE),
    (15, Index::VLNEXT),
    (16, Index::VEOL2),
];
/// The rates with their own numbers: B0 to B38400, then from B57600 on.
const SLOW: [u32; 16] = [
    0, 50, 75, 110, 134, 150, 200, 300, 600, 1_200, 1_800, 2_400, 4_800, 9_600, 19_200, 38_400,
];
const FAST: [u32; 15] = [
    57_600, 115_200, 230_400, 460_800, 500_000, 576_000, 921_600, 1_000_000, 1_152_000, 1_500_000,
    2_000_000, 2_500_000, 3_000_000, 3_500_000, 4_000_000,
];
/// The bit that distinguishes the numbers of fast rates; alone it means that the rate is given as a
/// number.
const FAST_BIT: u32 = 0o10000;

impl Settings {
    /// Settings from the kernel's form.
    pub(crate) fn of_kernel(termios: &Termios) -> Self {
        let mut new = Self {
            input: termios.input_modes.bits(),
            output: termios.output_modes.bits(),
            control: termios.control_modes.bits(),
            local: termios.local_modes.bits(),
            discipline: termios.line_discipline,
            speeds: [termios.input_speed(), termios.output_speed()],
            ..Self::default()
        };
        for (place, index) in CODES {
            new.codes[place] = termios.special_codes[index];
        }
        new
    }

    /// Changes `termios` to these settings.
    ///
    /// # Errors
    /// If the rate does not exist.
    pub(crate) fn put_into(&self, termios: &mut Termios) -> Result<()> {
        termios.input_modes = InputModes::from_bits_retain(self.input);
        termios.output_modes = OutputModes::from_bits_retain(self.output);
        termios.control_modes = ControlModes::from_bits_retain(self.control);
        termios.local_modes = LocalModes::from_bits_retain(self.local);
        termios.line_discipline = self.discipline;
        for (place, index) in CODES {
            termios.special_codes[index] = self.codes[place];
        }
        termios.set_input_speed(self.speeds[0])?;
        termios.set_output_speed(self.speeds[1])
    }

    /// Copies only the numbers of bytes for which a read or poll waits into `termios`. In canonical
    /// mode one byte counts as a line.
    pub(crate) fn waits_into(&self, termios: &mut Termios) {
        let [least, time] = match self.is_canonical() {
            true => [1, 0],
            false => [self.code(Code::Least), self.code(Code::Time)],
        };
        termios.special_codes[Index::VMIN] = least;
        termios.special_codes[Index::VTIME] = time;
    }

    /// Sets the rates that the control modes name by a number.
    #[must_use]
    pub(crate) fn with_named_speeds(mut self) -> Self {
        let number = self.control & bits::CBAUD;
        let index = usize::try_from(number & 0o17).unwrap_or_default();
        let speed = match number & FAST_BIT {
            0 => SLOW.get(index),
            // Number 0 means that the rate is given as a number.
            _ => index.checked_sub(1).and_then(|index| FAST.get(index)),
        };
        if let Some(&speed) = speed {
            self.speeds = [speed; 2];
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of asm-generic/termbits.h.
    #[test]
    fn rates_are_named_or_written_out() {
        let speed = |control| {
            let settings = Settings {
                control,
                speeds: [250_000; 2],
                ..Settings::default()
            };
            settings.with_named_speeds().speeds[1]
        };
        let named = [0o15, 0o17, 0o10001, 0o10002, 0o10010, 0o10017].map(speed);
        assert_eq!(
            named,
            [9_600, 38_400, 57_600, 115_200, 1_000_000, 4_000_000]
        );
        assert_eq!(speed(0o10000), 250_000);
    }
}
