//! Signals that wait for a stopped thread, as the system lists them.

/// Signals that do nothing unless somebody handles them: SIGCHLD, SIGCONT, SIGURG, SIGWINCH.
const MILD: u64 = 1 << 16 | 1 << 17 | 1 << 22 | 1 << 27;

/// The signals that wait for a thread, as bits.
pub(super) struct Pending {
    pub(super) own: u64,
    /// For any thread of its process.
    pub(super) common: u64,
    pub(super) blocked: u64,
    ignored: u64,
    caught: u64,
}

impl Pending {
    pub(super) fn of(process: i32, tid: i32) -> Self {
        let path = format!("/proc/{process}/task/{tid}/status");
        let status = std::fs::read_to_string(path).unwrap_or_default();
        let mask = |name: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(name));
            line.and_then(|text| u64::from_str_radix(text.trim(), 16).ok())
                .unwrap_or(0)
        };
        Self {
            own: mask("SigPnd:"),
            common: mask("ShdPnd:"),
            blocked: mask("SigBlk:"),
            ignored: mask("SigIgn:"),
            caught: mask("SigCgt:"),
        }
    }

    /// Those that do nothing while `held` are held back.
    pub(super) const fn quiet(&self, held: u64) -> u64 {
        held | self.ignored | (MILD & !self.caught)
    }

    /// Whether one of them ends a wait.
    pub(super) const fn interrupts(&self) -> bool {
        (self.own | self.common) & !self.quiet(self.blocked) != 0
    }
}
