//! What the ports will bring in the next milliseconds, if the program sends nothing.

use core::time::Duration;

use protocols::Instant;

use super::Stage;
use crate::guest::clock_page::{LENT_BYTES, LentPort};
use crate::transport::TransportError;

/// The near future, in the program's time.
#[derive(Debug)]
pub(in crate::guest) struct Ahead {
    /// Up to here, this included, only the bytes below come.
    pub(in crate::guest) limit: Instant,
    pub(in crate::guest) ports: Vec<LentPort>,
}

impl Stage {
    /// What comes at `ports` up to `until` at most; each is given with its file and whether a read
    /// of it waits. `None`: that is not known.
    pub(in crate::guest) fn look_ahead(
        &mut self,
        ports: &[(usize, i32, bool)],
        until: Instant,
    ) -> Option<Ahead> {
        let rig_now = self.rig_time(self.now)?;
        if self.is_touched || self.is_stirred || self.is_over() || !self.realtime.is_plain() {
            return None;
        }
        // At these times the stage and the run's checkers look.
        let looks = self.next_look.min(until);
        let undisturbed = self.now + (self.run.undisturbed_until() - rig_now);
        let limit = looks.min(undisturbed);
        let limit = Instant::from_nanos(limit.as_nanos().checked_sub(1)?);
        let span = limit - self.now;
        if limit <= self.now {
            return None;
        }
        let arrivals = self.run.rig.preview(rig_now + span)?;
        let mut lent = Vec::with_capacity(ports.len());
        for &(port, fd, waits) in ports {
            let terminal = self.realtime.terminal(port)?;
            if !terminal.is_transparent() {
                return None;
            }
            let held = terminal.first_held(LENT_BYTES);
            let mut bytes: Vec<(Instant, u8)> = held.map(|byte| (Instant::ZERO, byte)).collect();
            let mut known_until = limit + Duration::from_nanos(1);
            if terminal.unread() > bytes.len() {
                known_until = Instant::ZERO;
            }
            let node = self.realtime.node(port);
            for arrival in arrivals.iter().filter(|arrival| arrival.node == node) {
                let at = self.now + (arrival.at - rig_now);
                let has_room = bytes.len() + arrival.bytes.len() <= LENT_BYTES;
                if arrival.is_damaged || !has_room || known_until <= at {
                    known_until = known_until.min(at);
                    break;
                }
                bytes.extend(arrival.bytes.iter().map(|&byte| (at, byte)));
            }
            lent.push(LentPort {
                port,
                fd,
                waits,
                known_until,
                bytes,
            });
        }
        Some(Ahead { limit, ports: lent })
    }

    /// The program has come to `at` without a stop: the rig follows.
    pub(in crate::guest) fn follow(&mut self, at: Instant) -> Result<(), TransportError> {
        self.now = self.now.max(at);
        self.pass(Duration::ZERO)
    }

    /// The client has read so many held bytes of a port.
    pub(in crate::guest) fn has_read(&mut self, port: usize, len: usize) {
        let terminal = self.terminal(port);
        let taken = terminal.and_then(|it| it.take(len)).map(|it| it.len());
        self.took(port, taken.unwrap_or(0));
    }
}
