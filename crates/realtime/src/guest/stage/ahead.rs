//! Preview of the bytes that the ports will deliver in the next milliseconds if the program sends
//! nothing.

use core::time::Duration;
use std::collections::BTreeMap;

use engine::rig::Arrival;
use protocols::Instant;

use super::Stage;
use crate::guest::lent::{LENT_BYTES, LentPort};
use crate::transport::TransportError;

/// The near future of the ports, in the program's time.
#[derive(Debug)]
pub(in crate::guest) struct Ahead {
    /// Time up to which, inclusive, no other bytes arrive than those in `ports`.
    pub(in crate::guest) limit: Instant,
    pub(in crate::guest) ports: Vec<LentPort>,
}

/// Bytes that the rig will deliver without further input, in rig time.
#[derive(Debug)]
pub(in crate::guest) struct Foreseen {
    arrivals: Vec<Arrival>,
    /// Time up to which, inclusive, `arrivals` is complete.
    until: Instant,
    /// Time from which an action other than the rig's may change the preview.
    valid_until: Instant,
}

impl Stage {
    /// Discards the preview, because the rig will get input.
    pub(in crate::guest) fn forget_foreseen(&mut self) {
        self.foreseen = None;
    }

    /// Whether no part of the rigs reads the wall clock; node programs do, because they have
    /// timeouts.
    pub(in crate::guest) fn reads_no_clock(&self) -> bool {
        let members = self.run.team().iter().map(|member| &member.run.rig);
        let mut rigs = core::iter::once(&self.run.rig).chain(members);
        rigs.all(|rig| rig.preview(rig.now()).is_some())
    }

    /// The bytes that will arrive at `ports`, at most up to `until`. Each port has its file, and
    /// whether a read of it waits. `None` if this is not known.
    pub(in crate::guest) fn look_ahead(
        &mut self,
        ports: &[(usize, i32, bool)],
        until: Instant,
    ) -> Option<Ahead> {
        let rig_now = self.rig_time(self.now)?;
        if self.is_touched || self.is_stirred || self.is_over() || !self.realtime.is_plain() {
            return None;
        }
        // The stage and the run's checkers observe the program at these times.
        let looks = self.next_look.min(until);
        let valid_until = self.run.undisturbed_until();
        let limit = looks.min(self.now + (valid_until - rig_now));
        let limit = Instant::from_nanos(limit.as_nanos().checked_sub(1)?);
        if limit <= self.now {
            return None;
        }
        let is_valid = |it: &Foreseen| it.valid_until == valid_until && it.until > rig_now;
        if !self.foreseen.as_ref().is_some_and(is_valid) {
            let until = rig_now + (limit - self.now);
            self.foreseen = Some(Foreseen {
                arrivals: self.run.rig.preview(until)?,
                until,
                valid_until,
            });
        }
        let foreseen = self.foreseen.take()?;
        let limit = limit.min(self.now + (foreseen.until - rig_now));
        let lent = self.bytes_ahead(ports, &foreseen, [rig_now, limit]);
        self.foreseen = Some(foreseen);
        Some(Ahead {
            limit,
            ports: lent?,
        })
    }

    /// The bytes of `ports` between two times: the rig's current time, and a limit.
    fn bytes_ahead(
        &mut self,
        ports: &[(usize, i32, bool)],
        foreseen: &Foreseen,
        [rig_now, limit]: [Instant; 2],
    ) -> Option<Vec<LentPort>> {
        let coming = foreseen.arrivals.iter();
        let coming = coming.filter(|it| rig_now < it.at && it.at <= rig_now + (limit - self.now));
        let arrivals: Vec<&Arrival> = coming.collect();
        let mut lent = Vec::with_capacity(ports.len());
        for &(port, fd, waits) in ports {
            let node = self.realtime.node(port);
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
                takes: !terminal.is_stopped(),
                known_until,
                bytes,
            });
        }
        Some(lent)
    }

    /// For each port, the last time before the program's time `until` at which bytes arrive; in
    /// order of time.
    pub(in crate::guest) fn last_arrivals(&self, until: Instant) -> Vec<Instant> {
        let (Some(rig_now), Some(foreseen)) = (self.rig_time(self.now), &self.foreseen) else {
            return Vec::new();
        };
        let mut last = BTreeMap::new();
        for arrival in foreseen.arrivals.iter().filter(|it| it.at > rig_now) {
            let at = self.now + (arrival.at - rig_now);
            if at <= until {
                last.insert(arrival.node, at);
            }
        }
        let mut times: Vec<Instant> = last.into_values().collect();
        times.sort_unstable();
        times
    }

    /// Lets the rig follow the program, which has come to `at` without a stop.
    pub(in crate::guest) fn follow(&mut self, at: Instant) -> Result<(), TransportError> {
        self.now = self.now.max(at);
        self.pass(Duration::ZERO)
    }

    /// Removes `len` stored bytes of a port that the client has read. Returns whether there were as
    /// many.
    pub(in crate::guest) fn has_read(&mut self, port: usize, len: usize) -> bool {
        let terminal = self.terminal(port);
        let taken = terminal.and_then(|it| it.take(len)).map(|it| it.len());
        let taken = taken.unwrap_or(0);
        self.took(port, taken);
        taken == len
    }
}
