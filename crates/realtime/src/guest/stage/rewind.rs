//! Saves and restores the program's side of the stage; the rig always continues.

use protocols::Instant;

use super::Stage;
use crate::transport::Terminal;

/// The program's time, and the state of its ports in the program's view.
pub(in crate::guest) struct StageMoment {
    now: Instant,
    heard: Vec<Instant>,
    terminals: Vec<Terminal>,
}

impl Stage {
    /// The current moment; `None` if a client may still send or receive something, or if the kernel
    /// holds bytes of a port.
    pub(in crate::guest) fn moment(&mut self) -> Option<StageMoment> {
        if !self.is_quiet() {
            return None;
        }
        let ports = 0..self.slots.len();
        let terminals: Option<Vec<Terminal>> =
            ports.map(|port| self.terminal(port).cloned()).collect();
        Some(StageMoment {
            now: self.now,
            heard: self.slots.iter().map(|slot| slot.heard).collect(),
            terminals: terminals?,
        })
    }

    /// Restores the program's time and its terminals; returns whether this was possible.
    pub(in crate::guest) fn put_back(&mut self, moment: &StageMoment) -> bool {
        let Some(begun) = self.begun.filter(|_| self.is_quiet()) else {
            return false;
        };
        // Rig time continues, so the program's earlier time corresponds to rig time now.
        let gone = (self.run.rig.now() - Instant::ZERO).saturating_sub(moment.now - begun);
        self.zero = Instant::ZERO + gone;
        self.now = moment.now;
        self.next_look = moment.now;
        self.forget_foreseen();
        self.has_delivered = false;
        self.fruitless = 0;
        for (port, (terminal, heard)) in moment.terminals.iter().zip(&moment.heard).enumerate() {
            let slot = &mut self.slots[port];
            (slot.heard, slot.has_arrived) = (*heard, false);
            match self.terminal(port) {
                Some(model) => *model = terminal.clone(),
                None => return false,
            }
        }
        true
    }

    /// Whether rig time runs, no byte is in flight, and the models of the terminals hold all unread
    /// bytes of the client.
    fn is_quiet(&mut self) -> bool {
        self.stir();
        if self.begun.is_none() || self.carry().is_err() {
            return false;
        }
        (0..self.slots.len()).all(|port| {
            let is_held = self
                .terminal(port)
                .is_some_and(|it| it.holds() && it.is_whole());
            is_held && self.backlog(port) == 0 && self.slots[port].openings.is_open
        })
    }

    /// The paths of the ports' terminals for their clients.
    pub(in crate::guest) fn clients(&self) -> Vec<String> {
        let places = self.realtime.places();
        let paths = places.filter_map(|place| place.path.canonicalize().ok());
        paths
            .map(|path| path.to_string_lossy().into_owned())
            .collect()
    }
}
