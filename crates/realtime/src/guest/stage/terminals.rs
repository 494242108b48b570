//! The terminals of the ports: unread bytes, settings, a pulled plug.

use core::time::Duration;
use std::os::fd::OwnedFd;

use emulators::{Event, EventKind};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::ioctl_fionread;

use super::{Slot, Stage};
use crate::Traffic;
use crate::clock::{Clock as _, WallClock};
use crate::transport::{Settings, Terminal, TransportError};

/// Number of checks in direct succession for bytes in flight from one end of a terminal to the
/// other; later checks follow at intervals of wall time. Checks are counted instead of timed, so a
/// check on a delayed machine does not end too early.
const HASTY_LOOKS: u32 = 1_000;
const LOOK_PACE: Duration = Duration::from_millis(1);
/// Number of slow checks after which the missing bytes count as read. The terminal passes on every
/// byte that it receives, so a process without supervision must have read them.
const LOOKS: u32 = 20_000;
/// Number of consecutive calls at a port that has hung up from which a program is in a busy loop,
/// and the virtual time of each later call.
const FRUITLESS_MAX: u32 = 1_000;
const FRUITLESS_COST: Duration = Duration::from_micros(100);

impl Stage {
    /// Whether the device with this number was a port and has hung up.
    pub(in crate::guest) fn is_gone(&self, device: u64) -> bool {
        self.gone.contains(&device)
    }

    /// Counts a call that did not wait, at a port that has hung up. After very many in a row, such
    /// calls take longer: a program that takes the end of input for "nothing yet" would otherwise
    /// continue for a long time.
    pub(in crate::guest) fn note_fruitless(&mut self) {
        self.fruitless = self.fruitless.saturating_add(1);
        if self.fruitless < FRUITLESS_MAX {
            return;
        }
        self.now += FRUITLESS_COST;
        if self.busy.is_some() {
            return;
        }
        let detail = format!(
            "busy loop at a port that hung up: {FRUITLESS_MAX} calls in a row that did not wait"
        );
        let event = Event {
            at: self.run.rig.now(),
            kind: EventKind::Note,
            rule: "busy-loop",
            detail: detail.clone(),
            bytes: Vec::new(),
        };
        self.run.rig.log("program", event);
        self.busy = Some(detail);
    }

    /// Resets this count, because a thread has waited or made another call.
    pub(in crate::guest) const fn end_fruitless(&mut self) {
        self.fruitless = 0;
    }

    /// Whether a client uses a port exclusively.
    pub(in crate::guest) fn has_exclusive(&self) -> bool {
        self.slots.iter().any(|slot| slot.is_exclusive)
    }

    /// The slot of a port.
    pub(in crate::guest) fn slot(&mut self, port: usize) -> &mut Slot {
        &mut self.slots[port]
    }

    /// The terminal of a port.
    pub(in crate::guest) fn terminal(&mut self, port: usize) -> Option<&mut Terminal> {
        self.realtime.terminal(port)
    }

    /// Passes the unread bytes of a port to the kernel permanently.
    pub(in crate::guest) fn release(&mut self, port: usize) {
        self.realtime.release(port);
    }

    /// Passes the unread bytes of all ports to the kernel permanently.
    pub(in crate::guest) fn release_all(&mut self) {
        for port in 0..self.slots.len() {
            self.release(port);
        }
    }

    /// Number of bytes that passed a port, to its client and from it.
    pub(in crate::guest) fn traffic(&self, port: usize) -> Traffic {
        self.realtime.traffic(port)
    }

    /// Changes the client's settings, and delivers the bytes that they make readable.
    pub(in crate::guest) fn set_terminal(&mut self, port: usize, settings: Settings, fd: &OwnedFd) {
        self.touch();
        self.settle(port, fd);
        self.realtime.set_terminal(port, settings);
        self.has_delivered = true;
    }

    /// Discards the client's sent bytes that the line has not taken.
    pub(in crate::guest) fn discard_sent(&mut self, port: usize) -> Result<(), TransportError> {
        self.carry()?;
        self.forget_foreseen();
        self.realtime.discard_input(port, &mut self.run);
        Ok(())
    }

    /// Removes bytes that the client has read.
    pub(in crate::guest) fn took(&mut self, port: usize, len: usize) {
        if let Some(terminal) = self.terminal(port) {
            terminal.took(len);
        }
    }

    /// Discards the client's unread bytes.
    pub(in crate::guest) fn forget_unread(&mut self, port: usize) {
        if let Some(terminal) = self.terminal(port) {
            terminal.forget();
        }
    }

    /// Waits until the kernel shows at `fd`, the client's end, all bytes that were put into the
    /// port. The kernel transfers them on a separate thread.
    pub(in crate::guest) fn settle(&mut self, port: usize, fd: &OwnedFd) {
        if self.terminal(port).is_some_and(|it| it.holds()) {
            return;
        }
        let unread = self.terminal(port).map_or(0, |it| it.unread());
        if let Some(shown) = missed(fd, unread as u64)
            && let Some(terminal) = self.terminal(port)
        {
            // A process without supervision read some bytes: the kernel's count is right.
            terminal.correct_unread(usize::try_from(shown).unwrap_or(unread));
        }
    }

    /// Waits in this way for all ports, without a file of the client.
    pub(in crate::guest) fn settle_all(&mut self) {
        for port in 0..self.slots.len() {
            let terminal = self.terminal(port);
            let unread = terminal.map_or(0, |it| if it.holds() { 0 } else { it.unread() });
            if self.slots[port].openings.is_open
                && unread > 0
                && let Some(fd) = self.realtime.client_side(port)
            {
                self.settle(port, &fd);
            }
        }
    }
}

/// Waits until `fd` shows `expected` bytes. Returns the shown number if the others are not in
/// flight.
fn missed(fd: &OwnedFd, expected: u64) -> Option<u64> {
    let shows = || ioctl_fionread(fd).unwrap_or(u64::MAX);
    if shows() >= expected {
        return None;
    }
    let clock = WallClock::start();
    let mut looks = 0;
    loop {
        // Before it reports that there are no bytes, the kernel transfers all bytes in flight.
        let is_nothing = !is_readable(fd);
        let shown = shows();
        if shown >= expected {
            return None;
        }
        if is_nothing {
            return Some(shown);
        }
        looks += 1;
        if looks <= HASTY_LOOKS {
            std::thread::yield_now();
            continue;
        }
        if looks - HASTY_LOOKS > LOOKS {
            return Some(shown);
        }
        clock.sleep_until(clock.now() + LOOK_PACE);
    }
}

fn is_readable(fd: &OwnedFd) -> bool {
    let mut fds = [PollFd::new(fd, PollFlags::IN)];
    let done = poll(&mut fds, Some(&Timespec::default()));
    done.is_ok() && !fds[0].revents().is_empty()
}

#[cfg(test)]
mod tests {
    use protocols::Instant;
    use rustix::pty::{OpenptFlags, ioctl_tiocgptpeer, openpt, unlockpt};
    use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

    use super::*;

    /// The rig's end of a raw terminal and its client's.
    fn terminal() -> [OwnedFd; 2] {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY;
        let rig = openpt(flags).expect("Linux has some");
        unlockpt(&rig).expect("it is new");
        let client = ioctl_tiocgptpeer(&rig, flags).expect("it is new");
        let mut termios = tcgetattr(&client).expect("a terminal");
        termios.make_raw();
        tcsetattr(&client, OptionalActions::Now, &termios).expect("a terminal");
        [rig, client]
    }

    fn write(rig: &OwnedFd, bytes: &[u8]) {
        assert_eq!(rustix::io::write(rig, bytes), Ok(bytes.len()));
    }

    /// Once, two runs of one program differed here, because the machine had stopped for a while.
    #[test]
    fn bytes_that_are_late_are_waited_for() {
        let [rig, client] = terminal();
        write(&rig, b"ten bytes.");
        let late = std::thread::spawn(move || {
            let clock = WallClock::start();
            clock.sleep_until(Instant::from_millis(500));
            write(&rig, b"and twelve..");
            rig
        });
        assert_eq!(missed(&client, 22), None);
        drop(late.join());
    }

    #[test]
    fn bytes_that_somebody_took_are_not_waited_for() {
        let [rig, client] = terminal();
        write(&rig, b"taken");
        let mut taken = [0; 5];
        assert_eq!(rustix::io::read(&client, &mut taken), Ok(5));
        assert_eq!(missed(&client, 5), Some(0));
    }
}
