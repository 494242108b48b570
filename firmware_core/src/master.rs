use protocols::{Instant, LineConfig, LineEvent, Port};

/// A robot's program: the master of its devices.
///
/// [`receive`](Self::receive) is what the receive interrupt calls, [`transmit`](Self::transmit)
/// what the transmitter asks when it has room, [`poll`](Self::poll) is the main loop's body and
/// may take long on a real processor. Time never runs backwards between calls; polling early,
/// late or twice is harmless.
pub trait Master {
    /// Bytes that arrived on `port`, the last of them at `now`. Never empty. Called at any time,
    /// also between a [`poll`](Self::poll) and the end of the work that it began.
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]);

    /// Something besides bytes happened on `port`.
    fn line_event(&mut self, _port: Port, _now: Instant, _event: LineEvent) {}

    /// A change of the program's end of the line that the device would see, such as the port being
    /// opened again, which resets many a microcontroller; taken once.
    fn line_change(&mut self, _port: Port) -> Option<LineEvent> {
        None
    }

    /// Does all work due by `now`. Work that costs processor time is done here at once, but its
    /// results take effect in the next call. The `now` of that call includes the time of the work:
    /// see [`take_work`](Self::take_work).
    fn poll(&mut self, now: Instant);

    /// Moves up to `buf.len()` bytes to be sent on `port` into `buf`; returns how many.
    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize;

    /// Whether the program may have something to send on `port`, or a [`line_change`] to tell:
    /// where it has nothing, a line need not ask. `true` is always right.
    ///
    /// [`line_change`]: Self::line_change
    fn may_send(&self, _port: Port) -> bool {
        true
    }

    /// When the program next wants to be polled by itself; `None`: only after input.
    fn poll_at(&self) -> Option<Instant>;

    /// Line coding of `port`.
    fn line_config(&self, port: Port) -> LineConfig;

    /// Computing done since the last call. A rig that models the processor does not poll again
    /// before this work would have been finished; a real board does not call it.
    fn take_work(&mut self) -> Work;
}

/// Computing that takes noticeable time on the microcontroller, counted in units that a cost
/// model can price.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Scans that went through match and map update.
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
    /// Where the program believes the robot was, in its own map's frame, and when: the end of the
    /// last scan that was matched, not the moment of asking.
    fn estimate(&self) -> Option<(Instant, crate::pose::Pose)>;

    /// The map as the program holds it, if it makes one.
    fn map(&self) -> Option<crate::map_view::MapView<'_>>;

    /// Where the beams of the newest scan that was matched ended, in the robot's frame at the time
    /// of the [`estimate`](Self::estimate).
    fn scan(&self) -> &[crate::pose::Point] {
        &[]
    }

    /// Current activity of the program, in one or two words, e.g. `waypoint` or `stop`.
    fn mode(&self) -> &'static str;

    /// Whether a search that the program does by itself has come to its end; `None` if there is
    /// none.
    fn is_done(&self) -> Option<bool> {
        None
    }

    /// Reports the places in its map where the program has found victims.
    fn victims(&self, _report: &mut dyn FnMut(crate::pose::Point)) {}

    /// Names every buffer beside which the program would have written; see [`crate::memory`].
    fn stray_writes(&self, _report: &mut dyn FnMut(&'static str, crate::memory::StrayWrites)) {}

    /// Whether the program has ended, for instance by a null pointer; it does nothing any more.
    fn is_dead(&self) -> bool {
        false
    }

    /// Names every counter with its value, always in the same order: scans, retries, overflows.
    fn counters(&self, report: &mut dyn FnMut(&'static str, u64));
}
