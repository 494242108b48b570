//! The settings of a terminal, as the system calls carry them.

/// Bits of Linux' terminal settings, the same on all processors that hilrig runs on.
pub(super) mod bits {
    pub(in super::super) const IGNBRK: u32 = 0o1;
    pub(in super::super) const BRKINT: u32 = 0o2;
    pub(in super::super) const IGNPAR: u32 = 0o4;
    pub(in super::super) const PARMRK: u32 = 0o10;
    pub(in super::super) const INPCK: u32 = 0o20;
    pub(in super::super) const ISTRIP: u32 = 0o40;
    pub(in super::super) const INLCR: u32 = 0o100;
    pub(in super::super) const IGNCR: u32 = 0o200;
    pub(in super::super) const ICRNL: u32 = 0o400;
    pub(in super::super) const IUCLC: u32 = 0o1000;
    pub(in super::super) const IXON: u32 = 0o2000;
    pub(in super::super) const IXANY: u32 = 0o4000;
    pub(in super::super) const OPOST: u32 = 0o1;
    pub(in super::super) const OLCUC: u32 = 0o2;
    pub(in super::super) const ONLCR: u32 = 0o4;
    pub(in super::super) const OCRNL: u32 = 0o10;
    pub(in super::super) const ONOCR: u32 = 0o20;
    pub(in super::super) const ONLRET: u32 = 0o40;
    pub(in super::super) const TABDLY: u32 = 0o14000;
    pub(in super::super) const CSIZE: u32 = 0o60;
    pub(in super::super) const PARENB: u32 = 0o400;
    pub(in super::super) const PARODD: u32 = 0o1000;
    pub(in super::super) const CREAD: u32 = 0o200;
    pub(in super::super) const CBAUD: u32 = 0o10017;
    pub(in super::super) const CMSPAR: u32 = 0o10_000_000_000;
    pub(in super::super) const ISIG: u32 = 0o1;
    pub(in super::super) const ICANON: u32 = 0o2;
    pub(in super::super) const ECHO: u32 = 0o10;
    pub(in super::super) const ECHOE: u32 = 0o20;
    pub(in super::super) const ECHOK: u32 = 0o40;
    pub(in super::super) const ECHONL: u32 = 0o100;
    pub(in super::super) const NOFLSH: u32 = 0o200;
    pub(in super::super) const ECHOCTL: u32 = 0o1000;
    pub(in super::super) const ECHOKE: u32 = 0o4000;
    pub(in super::super) const IEXTEN: u32 = 0o100_000;
}

/// Whether `flags` have all bits of `wanted`.
pub(super) const fn has(flags: u32, wanted: u32) -> bool {
    flags & wanted == wanted
}

/// Special characters, by their indices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "each has its name from termios(3)")]
pub enum Code {
    Interrupt = 0,
    Quit = 1,
    Erase = 2,
    Kill = 3,
    EndOfFile = 4,
    Time = 5,
    Least = 6,
    Start = 8,
    Stop = 9,
    Suspend = 10,
    EndOfLine = 11,
    Reprint = 12,
    WordErase = 14,
    Literal = 15,
    SecondEndOfLine = 16,
}

/// Number of special characters that the kernel knows.
const CODES: usize = 19;

/// The settings of a terminal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Settings {
    /// Input modes.
    pub input: u32,
    /// Output modes.
    pub output: u32,
    /// Control modes.
    pub control: u32,
    /// Local modes.
    pub local: u32,
    /// Number of the line discipline.
    pub(super) discipline: u8,
    /// Special characters.
    pub(super) codes: [u8; CODES],
    /// Rates of input and output, bit/s.
    pub speeds: [u32; 2],
}

impl Settings {
    /// Length of the kernel's `termios`.
    pub const LEN: usize = 36;
    /// Length of the kernel's `termios2`, which also contains the rates.
    pub const LEN_WITH_SPEEDS: usize = 44;
    /// Length of the old `termio`.
    pub const LEN_OLD: usize = 18;

    /// Settings with only these modes known.
    pub(crate) fn of_modes(input: u32, control: u32) -> Self {
        Self {
            input,
            control,
            ..Self::default()
        }
    }

    /// These settings with the input and control modes of `other`.
    #[must_use]
    pub(crate) const fn with_modes_of(mut self, other: &Self) -> Self {
        (self.input, self.control) = (other.input, other.control);
        self
    }

    /// A special character.
    pub const fn code(&self, code: Code) -> u8 {
        self.codes[code as usize]
    }

    /// The settings of a `termios` or `termios2`; rates that it does not contain stay.
    #[must_use]
    pub fn with(mut self, bytes: &[u8]) -> Self {
        let word = |index: usize| {
            let word = bytes.get(4 * index..4 * index + 4)?;
            Some(u32::from_ne_bytes(word.try_into().ok()?))
        };
        let flags = [
            &mut self.input,
            &mut self.output,
            &mut self.control,
            &mut self.local,
        ];
        for (index, flags) in flags.into_iter().enumerate() {
            *flags = word(index).unwrap_or(*flags);
        }
        if let Some(rest) = bytes.get(16..17 + CODES) {
            self.discipline = rest[0];
            self.codes.copy_from_slice(&rest[1..]);
        }
        if let (Some(input), Some(output)) = (word(9), word(10)) {
            self.speeds = [input, output];
        }
        self
    }

    /// The settings of an old `termio`: low halves, eight characters.
    #[must_use]
    pub fn with_old(mut self, bytes: &[u8; Self::LEN_OLD]) -> Self {
        let flags = [
            &mut self.input,
            &mut self.output,
            &mut self.control,
            &mut self.local,
        ];
        for (half, flags) in bytes.chunks_exact(2).zip(flags) {
            *flags = *flags & 0xFFFF_0000 | u32::from(u16::from_ne_bytes([half[0], half[1]]));
        }
        self.discipline = bytes[8];
        self.codes[..8].copy_from_slice(&bytes[9..17]);
        self
    }

    /// The settings as a `termios2`; its first [`LEN`](Self::LEN) bytes are a `termios`.
    pub fn bytes(&self) -> [u8; Self::LEN_WITH_SPEEDS] {
        let mut bytes = [0; Self::LEN_WITH_SPEEDS];
        let flags = [self.input, self.output, self.control, self.local];
        for (place, word) in bytes.chunks_exact_mut(4).zip(flags) {
            place.copy_from_slice(&word.to_ne_bytes());
        }
        bytes[16] = self.discipline;
        bytes[17..17 + CODES].copy_from_slice(&self.codes);
        for (place, word) in bytes[36..].chunks_exact_mut(4).zip(self.speeds) {
            place.copy_from_slice(&word.to_ne_bytes());
        }
        bytes
    }

    /// The settings as an old `termio`.
    pub fn bytes_old(&self) -> [u8; Self::LEN_OLD] {
        let mut bytes = [0; Self::LEN_OLD];
        let flags = [self.input, self.output, self.control, self.local];
        for (place, word) in bytes.chunks_exact_mut(2).zip(flags) {
            let [a, b, ..] = word.to_le_bytes();
            place.copy_from_slice(&u16::from_le_bytes([a, b]).to_ne_bytes());
        }
        bytes[8] = self.discipline;
        bytes[9..17].copy_from_slice(&self.codes[..8]);
        bytes
    }

    /// Mask of the bits of a character on the line.
    pub(super) const fn character_mask(&self) -> u8 {
        match self.control & bits::CSIZE {
            0 => 0x1F,
            0o20 => 0x3F,
            0o40 => 0x7F,
            _ => 0xFF,
        }
    }

    /// The complete settings of a terminal: those that the kernel of a pseudo-terminal stores,
    /// `kernel`, except for two kinds of modes, which come from these settings: modes that the
    /// kernel drops, and modes that are processed here.
    #[must_use]
    pub(crate) const fn merged(mut self, kernel: &Self) -> Self {
        let own = bits::CSIZE | bits::PARENB | bits::PARODD | bits::CMSPAR | bits::CREAD;
        let taken = self.taken();
        self.control = self.control & own | kernel.control & !own;
        self.input = self.input & taken | kernel.input & !taken;
        self.output = kernel.output;
        self.local = kernel.local;
        self.codes = kernel.codes;
        self.speeds = kernel.speeds;
        self
    }

    /// These settings without the modes that the kernel of a pseudo-terminal must not process,
    /// because damaged characters are inserted above it.
    #[must_use]
    pub(crate) const fn for_kernel(mut self) -> Self {
        self.input &= !self.taken();
        self
    }

    /// These settings without the marking of damaged characters.
    #[must_use]
    pub(crate) const fn without_marks(mut self) -> Self {
        self.input &= !bits::PARMRK;
        self
    }

    /// Whether the client reads by lines.
    pub const fn is_canonical(&self) -> bool {
        has(self.local, bits::ICANON)
    }

    /// Input modes that are processed here instead of in the kernel.
    const fn taken(&self) -> u32 {
        let marks = bits::PARMRK | bits::INPCK | bits::IGNPAR | bits::BRKINT | bits::IGNBRK;
        match has(self.input, bits::PARMRK) {
            true => marks | bits::ISTRIP,
            false => marks,
        }
    }

    /// Text for the log: `8E1`.
    pub fn coding(&self) -> String {
        let data = self.character_mask().count_ones();
        let is = |bit| has(self.control, bit);
        let parity = match (is(bits::PARENB), is(bits::PARODD), is(bits::CMSPAR)) {
            (false, ..) => 'N',
            (_, false, false) => 'E',
            (_, true, false) => 'O',
            (_, false, true) => 'S',
            (_, true, true) => 'M',
        };
        let stop = match is(0o100) {
            true => 2,
            false => 1,
        };
        format!("{data}{parity}{stop}")
    }
}
