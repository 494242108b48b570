//! Events of a port besides bytes: a pulled plug, lost bytes, a modelled terminal.

use protocols::LineConfig;

use super::transport::{Settings, Terminal, TransportError};
use super::{Clock, Paced, Port, PortRate, Realtime, Rig, Traffic, losses};
use engine::rig::line::Direction;

impl<C: Clock> Realtime<C> {
    /// Models the terminals of all ports in this process from now on.
    pub(crate) fn model_terminals(&mut self) {
        self.ports
            .iter_mut()
            .for_each(|port| port.transport.model());
    }

    /// The terminal of the port `index`, if this process models it.
    pub(crate) fn terminal(&mut self, index: usize) -> Option<&mut Terminal> {
        self.ports[index].transport.terminal()
    }

    /// Passes the unread bytes of the port `index` to the kernel, permanently.
    pub(crate) fn release(&mut self, index: usize) {
        self.ports[index].transport.release();
    }

    /// Applies new settings of the client to the modelled terminal of the port `index`.
    pub(crate) fn set_terminal(&mut self, index: usize, settings: Settings) {
        let port = &mut self.ports[index];
        port.traffic.to_client += port.transport.set_terminal(settings) as u64;
    }

    /// Number of ports that existed at `index` so far: a new one after each plugging.
    pub(crate) fn made(&self, index: usize) -> u64 {
        self.ports[index].transport.made()
    }

    /// Bytes that passed the port `index`.
    pub(crate) fn traffic(&self, index: usize) -> Traffic {
        self.ports[index].traffic
    }

    /// Discards the bytes that the client of the port `index` has sent and the line has not taken.
    pub(crate) fn discard_input(&self, index: usize, paced: &mut impl Paced) {
        let end = &self.ports[index].end;
        paced.rig_of_mut(end.robot).discard_input(end.node);
    }
}

impl Port {
    /// Logs bytes that were lost because the client does not read.
    pub(super) fn tell_losses(&mut self, rig: &mut Rig) {
        let lost = self.transport.counters().overrun;
        if let Some(detail) = self.losses.see(rig.now(), lost) {
            self.log(rig, losses::RULE, detail);
        }
    }

    /// Pulls or plugs in the port as the fault `unplugged` demands.
    pub(super) fn carry_plug(&mut self, paced: &mut impl Paced) -> Result<(), TransportError> {
        let node = self.end.node;
        let is_unplugged = paced.rig_of_mut(self.end.robot).is_unplugged(node);
        if is_unplugged == core::mem::replace(&mut self.is_unplugged, is_unplugged) {
            return Ok(());
        }
        let (before, rule, detail);
        if is_unplugged {
            before = self.transport.path().display().to_string();
            self.transport.unplug();
            (rule, detail) = ("port-unplugged", format!("{before} hangs up and is gone"));
        } else {
            let name = paced
                .rig_of_mut(self.end.robot)
                .back_as(node)
                .map(str::to_owned);
            self.transport.plug(name.as_deref())?;
            let path = self.transport.path().display();
            (rule, detail) = ("port-plugged", format!("back as {path}, a fresh port"));
        }
        self.log(paced.rig_of_mut(self.end.robot), rule, detail);
        // Settings of the old port do not apply to the next one.
        paced
            .rig_of_mut(self.end.robot)
            .set_terminal_modes(node, None);
        while let Some(event) = self.transport.next_event() {
            self.report(paced.rig_of_mut(self.end.robot), event);
            let now = paced.rig_of_mut(self.end.robot).now();
            paced.run_until(now);
        }
        Ok(())
    }

    /// Stops a client with RTS/CTS flow control while CTS is off, as its driver would.
    pub(super) fn hold_back(&mut self, rig: &mut Rig) {
        let inputs = self.inputs;
        let must_wait = inputs.is_some_and(|inputs| !inputs.is_clear_to_send(rig));
        let is_held = must_wait && self.transport.has_flow_control();
        let terminal = self.transport.terminal();
        let is_stopped = terminal.is_some_and(|terminal| terminal.is_stopped());
        rig.hold(self.end.node, is_held || is_stopped);
    }

    /// Current coding of the other end; `None` if it accepts any rate.
    fn far_line(&self, rig: &Rig) -> Option<LineConfig> {
        let link = rig.link(&self.end.link)?;
        let mut lines = link.lines.iter();
        let line = lines.find(|line| line.from.node == self.end.node)?;
        (self.end.rate == PortRate::OfLine).then(|| rig.line_configs(line)[1])
    }

    /// Logs once if the client of an open port uses a rate that the other end does not understand.
    pub(super) fn judge_baud(&mut self, rig: &mut Rig) {
        let wrong = self
            .far_line(rig)
            .filter(|far| !far.tolerates(self.baud))
            .map(|far| (self.baud, far.usual_baud()));
        if let Some(link) = rig.link(&self.end.link) {
            let sent = [Direction::ToDevice, Direction::ToMaster];
            let sent = sent.map(|direction| link.line(direction).traffic().sent);
            let since = (self.is_open && wrong == self.wrong_rate).then_some(wrong);
            self.garbled.note(rig.now(), sent, since);
        }
        // A port that is closed keeps the client's last rate: a program that sets it right and
        // closes at once has ended at the right one.
        if !self.is_open || wrong == self.wrong_rate {
            return;
        }
        self.wrong_rate = wrong;
        if let Some((baud, expected)) = wrong {
            let detail = format!("client at {baud} baud, expected {expected}: it reads garbage");
            self.log(rig, "wrong-baud", detail);
        }
    }
}
