//! The contract of every emulated device.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::world::World;

/// A piece of hardware with one or more serial ports, advanced by the owner of the clock.
///
/// The four main methods are those of a master on the other side of the wire. Bytes come in with
/// [`receive`](Self::receive), work is done in [`poll`](Self::poll), bytes leave with
/// [`transmit`](Self::transmit), and [`poll_at`](Self::poll_at) returns the time of the next poll.
///
/// Time never runs backwards between calls. A device may be polled early, late or twice. That
/// changes only its own lateness.
pub trait Device {
    /// Receives bytes that arrived back to back on `port`, the last of them complete at `now`.
    /// Never empty. The device knows its line coding, so it can compute when each byte ended.
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]);

    /// Handles an event other than bytes on `port`. By default it is ignored.
    fn line_event(&mut self, _port: Port, _now: Instant, _event: LineEvent) {}

    /// Does all work due by `now`, sensing and moving the world.
    fn poll(&mut self, now: Instant, world: &mut World);

    /// Moves up to `buf.len()` bytes that are ready to be sent into `buf`; returns how many. The
    /// line calls this when it has room. Further bytes stay in the device's queue.
    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize;

    /// Whether the device may have bytes to send on `port`, or a [`line_change`] to report. With
    /// `false` a line need not ask. `true` is always right.
    ///
    /// [`line_change`]: Self::line_change
    fn may_send(&self, _port: Port) -> bool {
        true
    }

    /// Takes a change of the device's end of the line that the other end would see, such as an
    /// opened port.
    fn line_change(&mut self, _port: Port) -> Option<LineEvent> {
        None
    }

    /// Time at which the device wants to be polled next; `None`: only after input.
    fn poll_at(&self) -> Option<Instant>;

    /// Line coding of `port` as the device is set up now.
    fn line_config(&self, port: Port) -> LineConfig;

    /// Names of the device's own faults. `off`, `restart`, `stuck`, `garbage`, `wrong` and `slow`
    /// mean the same for all devices that have them.
    fn known_faults(&self) -> &'static [&'static str] {
        &[]
    }

    /// Whether a `figure` changes the effect of this fault.
    fn takes_figure(&self, fault: &str) -> bool {
        !matches!(fault, "off" | "restart" | "garbage")
    }

    /// Begins or ends one of [`known_faults`](Self::known_faults) at `now`; others are ignored.
    /// `figure` is its severity, if it has one. The device is polled next.
    fn set_fault(&mut self, _now: Instant, _fault: &str, _figure: Option<f64>, _begins: bool) {}

    /// Value of a register, read without side effects; `None`: no such register.
    fn peek(&self, _address: u8) -> Option<u8> {
        None
    }

    /// Takes the events since the last call, oldest first: events of the device itself, and its
    /// master's mistakes.
    fn take_events(&mut self) -> Vec<Event>;

    /// Number of violations of each rule so far, if several may share one entry of
    /// [`take_events`](Self::take_events); `None`: each entry is one.
    fn broken_rules(&self) -> Option<&BrokenRules> {
        None
    }

    /// Number of received bytes, if requests of a format exist and no frame of this format was
    /// among them; 0 otherwise. A receiver that waits for the first byte of a frame logs no byte
    /// before it.
    fn unframed(&self) -> u64 {
        0
    }

    /// The logs that keep each moment, also moments that [`take_events`](Self::take_events) folds
    /// into one entry. In a device without such logs, each entry is one moment.
    fn logs(&self) -> Vec<&BrokenRules> {
        self.broken_rules().into_iter().collect()
    }
}

/// Meaning of an [`Event`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum EventKind {
    /// Something happened: motors on, lidar locked, radio connected.
    Note,
    /// The master broke a rule of the device.
    Violation,
}

/// One entry of a device's log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// Time of the event.
    pub at: Instant,
    /// Note or violation.
    pub kind: EventKind,
    /// Short stable name in kebab case, e.g. `motors-stopped` or `unknown-register`. Scripts and
    /// tests match it.
    pub rule: &'static str,
    /// A sentence with the figures.
    pub detail: String,
    /// The bytes in question, if any.
    pub bytes: Vec<u8>,
}

/// Maximum number of moments that a log keeps, folded ones included; older ones are only counted.
const MOMENTS_MAX: usize = 1024;

/// Number of violations of each rule by its name, and the latest moments of the log, also those
/// that it folds into one entry.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BrokenRules {
    counts: Vec<(&'static str, u64)>,
    moments: VecDeque<(Instant, &'static str)>,
    /// Number of all moments, also of those that are not kept.
    seen: u64,
}

impl BrokenRules {
    /// Counts one more break of `rule`, at `at`.
    pub fn count(&mut self, at: Instant, rule: &'static str) {
        match self.counts.iter_mut().find(|(known, _)| *known == rule) {
            Some((_, count)) => *count += 1,
            None => self.counts.push((rule, 1)),
        }
        self.note(at, rule);
    }

    /// Keeps the moment of a note, which is no break.
    pub fn note(&mut self, at: Instant, rule: &'static str) {
        if self.moments.len() == MOMENTS_MAX {
            self.moments.pop_front();
        }
        self.moments.push_back((at, rule));
        self.seen += 1;
    }

    /// Each broken rule, with the number of violations.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, u64)> {
        self.counts.iter().copied()
    }

    /// All breaks together.
    pub fn total(&self) -> u64 {
        self.iter().map(|(_, count)| count).sum()
    }

    /// Number of moments so far: notes and breaks.
    pub const fn seen(&self) -> u64 {
        self.seen
    }

    /// The moments after the first `seen` that are kept, in the order in which the device logged
    /// them, and the number of those that are lost.
    pub fn since(&self, seen: u64) -> (impl Iterator<Item = (Instant, &'static str)>, u64) {
        let gone = self.seen - self.moments.len() as u64;
        let lost = gone.saturating_sub(seen);
        let skip = usize::try_from(seen.saturating_sub(gone)).unwrap_or(usize::MAX);
        (self.moments.iter().skip(skip).copied(), lost)
    }
}

/// The instant at which byte `index` of `count` back-to-back bytes ended, when the last ended at
/// `now`.
pub fn byte_end(now: Instant, line: LineConfig, index: usize, count: usize) -> Instant {
    line.byte_end(now, (count - 1 - index) as u64)
}

/// The earliest of some optional deadlines.
pub fn earliest(deadlines: impl IntoIterator<Item = Option<Instant>>) -> Option<Instant> {
    let never = Instant::from_nanos(u64::MAX);
    let at = deadlines.into_iter().map(|at| at.unwrap_or(never));
    let first = at.fold(never, Instant::min);
    (first < never).then_some(first)
}

/// Time of the next poll of a device between `now` and `end`, at `end` at the latest. A device that
/// asks for a time in the past is polled a nanosecond later, so that time moves.
pub fn next_poll(device: &(impl Device + ?Sized), now: Instant, end: Instant) -> Instant {
    let soonest = now + Duration::from_nanos(1);
    device.poll_at().map_or(end, |at| at.max(soonest).min(end))
}

/// Moves bytes from the front of `queue` to `buf` until `buf` is full; returns how many.
pub fn take(queue: &mut VecDeque<u8>, buf: &mut [u8]) -> usize {
    let len = buf.len().min(queue.len());
    let (front, back) = queue.as_slices();
    let first = front.len().min(len);
    buf[..first].copy_from_slice(&front[..first]);
    buf[first..len].copy_from_slice(&back[..len - first]);
    queue.drain(..len);
    len
}

/// The least multiple of `period` after the start of the run that is later than `now`.
pub fn next_multiple(now: Instant, period: Duration) -> Instant {
    let period = u64::try_from(period.as_nanos()).unwrap_or(u64::MAX).max(1);
    Instant::from_nanos((now.as_nanos() / period + 1).saturating_mul(period))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compiles only if all devices, and the world, can be copied: a checkpoint is such a copy.
    #[test]
    fn every_device_is_clone() {
        const fn clone<T: Device + Clone>() {}
        const fn clone_world<T: Clone + Send + Sync>() {}
        const _: () = {
            clone::<crate::avr_base::AvrBase>();
            clone::<crate::camera::Camera>();
            clone::<crate::car_board::CarBoard>();
            clone::<crate::hc06::Hc06>();
            clone::<crate::i2c::OnBus<crate::mpu6050::Mpu6050>>();
            clone::<crate::i2c::OnBus<crate::srf08::Srf08>>();
            clone::<crate::odometer::Odometer>();
            clone::<crate::pc::Pc>();
            clone::<crate::registers::Registers>();
            clone::<crate::rplidar::Rplidar>();
            clone::<crate::text::Text>();
            clone::<crate::touch_panel::TouchPanel>();
            clone::<crate::wheel_board::WheelBoard>();
            clone::<crate::xv11::Xv11>();
            clone_world::<World>();
        };
    }

    /// A device that has nothing but a line.
    struct Mute;

    impl Device for Mute {
        fn receive(&mut self, _port: Port, _now: Instant, _bytes: &[u8]) {}

        fn poll(&mut self, _now: Instant, _world: &mut World) {}

        fn transmit(&mut self, _port: Port, _buf: &mut [u8]) -> usize {
            0
        }

        fn poll_at(&self) -> Option<Instant> {
            None
        }

        fn line_config(&self, _port: Port) -> LineConfig {
            LineConfig::new_8n1(9600)
        }

        fn take_events(&mut self) -> Vec<Event> {
            Vec::new()
        }
    }

    /// Optional features are absent by default.
    #[test]
    fn a_device_has_no_registers_faults_or_changes_of_its_own_accord() {
        let mut mute = Mute;
        assert_eq!(mute.peek(0), None);
        assert_eq!(mute.known_faults(), [""; 0]);
        assert!(mute.logs().is_empty());
        assert_eq!(mute.line_change(Port(0)), None);
        // By default a device is polled each time.
        assert!(mute.may_send(Port(0)));
    }
}
