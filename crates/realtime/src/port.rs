//! Transfer of bytes and events at one port, in both directions.

use core::time::Duration;

use emulators::{Event, EventKind};
use protocols::{LineConfig, LineEvent};

use super::{BACKLOG_MAX, Port};
use crate::transport::{PortEvent, Settings, Special, TransportError};
use engine::rig::{Paced, PortRate, Rig};

impl Port {
    /// Takes the actions and bytes of the client in their order.
    pub(super) fn carry_in(&mut self, paced: &mut impl Paced) -> Result<(), TransportError> {
        // Large enough for a whole network packet.
        let mut buf = [0; 2048];
        let node = self.end.node;
        if let Some([input, control]) = paced.rig_of_mut(self.end.robot).terminal_modes(node) {
            self.transport.tell(Settings::of_modes(input, control));
        }
        let now = paced.rig_of_mut(self.end.robot).now();
        let due = self.spread.due(now);
        paced.rig_of_mut(self.end.robot).inject(node, &due);
        while self.spread.is_empty() && paced.rig_of_mut(self.end.robot).backlog(node) < BACKLOG_MAX
        {
            let len = self.read(paced, &mut buf)?;
            if len == 0 {
                break;
            }
            paced.rig_of_mut(self.end.robot).inject(node, &buf[..len]);
        }
        paced.run_until(now);
        Ok(())
    }

    /// Takes the actions and bytes of the client after rig time stood for `late`.
    pub(super) fn carry_late(
        &mut self,
        paced: &mut impl Paced,
        late: Duration,
    ) -> Result<(), TransportError> {
        let mut buf = [0; BACKLOG_MAX];
        let len = self.read(paced, &mut buf)?;
        let now = paced.rig_of_mut(self.end.robot).now();
        self.spread.begin(&buf[..len], now, late);
        Ok(())
    }

    /// Reads bytes of the client into `buf`. Applies earlier events of the client first, after the
    /// bytes that it sent before them.
    pub(super) fn read(
        &mut self,
        paced: &mut impl Paced,
        buf: &mut [u8],
    ) -> Result<usize, TransportError> {
        let read = self.transport.read(buf);
        while let Some(event) = self.transport.next_event() {
            let before = self.spread.rest();
            paced
                .rig_of_mut(self.end.robot)
                .inject(self.end.node, &before);
            self.report(paced.rig_of_mut(self.end.robot), event);
            // The rig stores one change of the line at a time.
            let now = paced.rig_of_mut(self.end.robot).now();
            paced.run_until(now);
        }
        let len = read?;
        self.traffic.from_client += len as u64;
        self.special[1].count(&buf[..len]);
        Ok(len)
    }

    /// Bytes that line settings may change.
    pub(super) fn all_special(&self) -> [Special; 2] {
        let [to_client, from_client] = self.special;
        let cut = self.transport.cut();
        [Special { cut, ..to_client }, from_client]
    }

    /// Passes bytes of the rig to the client.
    pub(super) fn carry_out(&mut self, rig: &mut Rig) {
        // The other end may also have changed its rate.
        self.judge_baud(rig);
        let link = rig.link(&self.end.link);
        if link.is_some_and(|link| link.kind.carries_messages()) {
            for message in rig.take_messages(self.end.node) {
                self.traffic.to_client += self.transport.write(&message) as u64;
            }
            return;
        }
        let marks = rig.take_marks(self.end.node);
        let bytes = rig.take_output(self.end.node);
        let pieces = match &mut self.adapter {
            Some(adapter) if marks.is_empty() => adapter.pass(rig.now(), &bytes),
            // A damaged character keeps its position among the others.
            Some(adapter) => {
                for piece in adapter.pass_all(rig.now()) {
                    self.traffic.to_client += self.transport.write(&piece) as u64;
                }
                vec![bytes]
            }
            None if bytes.is_empty() && marks.is_empty() => return,
            None => vec![bytes],
        };
        for piece in pieces {
            let written = self.transport.write_marked(&piece, &marks);
            self.traffic.to_client += written as u64;
            // Count bytes that the line settings hold back, too.
            if self.is_open {
                self.special[0].count(&piece);
            }
        }
        self.tell_losses(rig);
    }

    /// Reports an event of the port to the rig and to the log.
    pub(super) fn report(&mut self, rig: &mut Rig, event: PortEvent) {
        let node = self.end.node;
        match event {
            PortEvent::Opened => {
                self.is_open = true;
                self.openings += 1;
                self.wrong_rate = None;
                rig.change_line(node, LineEvent::Opened);
                self.log(rig, "port-opened", format!("client at {} baud", self.baud));
                self.judge_baud(rig);
            }
            PortEvent::Closed => {
                self.is_open = false;
                rig.change_line(node, LineEvent::Closed);
                self.log(rig, "port-closed", "no client any more".to_owned());
            }
            PortEvent::BaudChanged(baud) => {
                self.baud = baud;
                if baud > 0 && self.end.rate == PortRate::OfLine {
                    let line = LineConfig {
                        baud,
                        ..self.end.line
                    };
                    rig.set_line_config(node, line);
                }
                self.judge_baud(rig);
            }
        }
    }

    pub(super) fn log(&self, rig: &mut Rig, rule: &'static str, detail: String) {
        let event = Event {
            at: rig.now(),
            kind: EventKind::Note,
            rule,
            detail,
            bytes: Vec::new(),
        };
        rig.log(self.end.own_name(), event);
    }
}
