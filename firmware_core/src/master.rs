use protocols::{Instant, LineConfig, LineEvent, Port};

/// A robot's program: the master of its devices.
///
/// The receive interrupt calls [`receive`](Self::receive); the transmitter calls
/// [`transmit`](Self::transmit) when it has room. [`poll`](Self::poll) is the main loop's body and
/// may take long on a real processor. Time never runs backwards between calls; polling early, late
/// or twice is harmless.
pub trait Master {
    /// Bytes that arrived on `port`, the last of them at `now`. `bytes` is never empty. The call
    /// may come at any time, also between a [`poll`](Self::poll) and the end of the work that it
    /// began.
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]);

    /// Notifies of an event other than received bytes on `port`.
    fn line_event(&mut self, _port: Port, _now: Instant, _event: LineEvent) {}

    /// A change of the program's end of the line that the device would notice; returned once.
    /// Example: opening the port again, which resets many microcontrollers.
    fn line_change(&mut self, _port: Port) -> Option<LineEvent> {
        None
    }

    /// Does all work due by `now`. Work that costs processor time is done here at once, but its
    /// results take effect in the next call. The `now` of that call includes the time of the work:
    /// see [`take_work`](Self::take_work).
    fn poll(&mut self, now: Instant);

    /// Moves up to `buf.len()` bytes to be sent on `port` into `buf`; returns how many.
    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize;

    /// Whether the program may have bytes to send or a [`line_change`] to report on `port`. If not,
    /// the line need not ask. `true` is always correct.
    ///
    /// [`line_change`]: Self::line_change
    fn may_send(&self, _port: Port) -> bool {
        true
    }

    /// Time at which the program wants to be polled without input; `None`: only after input.
    fn poll_at(&self) -> Option<Instant>;

    /// Line coding of `port`.
    fn line_config(&self, port: Port) -> LineConfig;

    /// Computing done since the last call. A rig that models the processor delays the next poll
    /// until this work would have finished; a real board does not call this method.
    fn take_work(&mut self) -> Work;
}

/// Computing that takes noticeable time on the microcontroller, in units that a cost model can
/// convert to time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Scans that were matched and drawn.
    pub scans: u32,
    /// Candidate poses scored.
    pub tries: u32,
    /// Beam end points looked up in the map, over all tries.
    pub points: u32,
}

impl Work {
    /// No computing.
    pub const NONE: Self = Self {
        scans: 0,
        tries: 0,
        points: 0,
    };
}

/// State that a rig can read in a program of its own process: for checkers, reports and the page,
/// never for devices.
pub trait Inspect {
    /// Believed pose in the program's own map frame, and its time: the end of the last matched
    /// scan, not the moment of the call.
    fn estimate(&self) -> Option<(Instant, crate::pose::Pose)>;

    /// The program's map, if it makes one.
    fn map(&self) -> Option<crate::map_view::MapView<'_>>;

    /// End points of the beams of the newest matched scan, in the robot's frame at the time of the
    /// [`estimate`](Self::estimate).
    fn scan(&self) -> &[crate::pose::Point] {
        &[]
    }

    /// Current activity of the program, in one or two words, e.g. `waypoint` or `stop`.
    fn mode(&self) -> &'static str;

    /// Whether the program's autonomous search has ended; `None` if there is none.
    fn is_done(&self) -> Option<bool> {
        None
    }

    /// Reports the positions of found victims in the program's map.
    fn victims(&self, _report: &mut dyn FnMut(crate::pose::Point)) {}

    /// Reports every buffer beyond which the program would have written; see [`crate::memory`].
    fn stray_writes(&self, _report: &mut dyn FnMut(&'static str, crate::memory::StrayWrites)) {}

    /// Whether the program has ended, for instance by a null pointer, and does nothing any more.
    fn is_dead(&self) -> bool {
        false
    }

    /// Reports every counter with its name and value, always in the same order: scans, retries,
    /// overflows.
    fn counters(&self, report: &mut dyn FnMut(&'static str, u64));
}
