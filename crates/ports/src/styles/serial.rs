//! `serialport::SerialPort`.

use core::time::Duration;
use std::io;

use ::serialport::{
    ClearBuffer, DataBits, Error, ErrorKind as Kind, FlowControl, Parity, Result, SerialPort,
    StopBits,
};
use engine::rig::LinkKind;
use engine::run::Run;
use protocols::{LineConfig, LineEvent, line};

use crate::state::PortState;
use crate::{Bench, VirtualPort};

/// Indices in [`engine::rig::Rig::forced_lines`].
const CTS: usize = 0;
const DSR: usize = 1;
const RI: usize = 2;
const DCD: usize = 3;

impl Bench {
    /// Opens the port `name` like `serialport::new(name, baud).open()`: 8 data bits, no parity, one
    /// stop bit, no flow control; DTR and RTS are raised. Reads have the timeout
    /// [`TIMEOUT`](crate::TIMEOUT).
    ///
    /// # Errors
    /// Those of [`Bench::port`].
    pub fn serial(&self, name: &str, baud: u32) -> io::Result<Box<dyn SerialPort>> {
        let mut port = self.port(name)?;
        port.set_line(LineConfig::new_8n1(baud))?;
        port.write_data_terminal_ready(true)?;
        port.write_request_to_send(true)?;
        Ok(Box::new(port))
    }
}

fn not_possible<T>(what: &str) -> Result<T> {
    let message = format!("a port of the bench has no {what}");
    Err(Error::new(Kind::InvalidInput, message))
}

impl VirtualPort {
    fn change_line(&self, change: impl FnOnce(&mut LineConfig)) -> Result<()> {
        let mut port = self.clone();
        let mut line = port.line()?;
        change(&mut line);
        Ok(port.set_line(line)?)
    }

    /// Calls `act` with the port and its run.
    fn with<T>(&self, act: impl FnOnce(&mut Run, &mut PortState) -> T) -> Result<T> {
        let mut turn = self.bench.core.enter().map_err(Error::from)?;
        let (run, port) = turn.port(self.index).map_err(Error::from)?;
        Ok(act(run, port))
    }

    /// The node of the pin for this port's modem line `what`, if its device has one.
    fn pin(&self, what: &str) -> Option<usize> {
        let name = format!("{}-{what}", self.name());
        let mut turn = self.bench.core.enter().ok()?;
        let index = turn.find(&name)?;
        let (_, port) = turn.port(index).ok()?;
        (port.kind == LinkKind::Pin).then_some(port.end.node)
    }

    fn drive(&self, what: &str, level: bool) -> Result<()> {
        let Some(node) = self.pin(what) else {
            // The behaviour of an adapter with an unconnected line.
            return self.with(|_, _| ());
        };
        self.with(|run, _| {
            run.rig.inject(node, &[u8::from(level)]);
            run.go_on_until(run.rig.now());
        })
    }

    /// The level of a modem line: forced, else that of the device's pin, else that of a plain
    /// cable.
    fn sense(&self, what: &str, index: usize, usual: bool) -> Result<bool> {
        let pin = self.pin(what);
        let level = self.with(|run, port| {
            run.go_on_until(run.rig.now());
            let forced = run.rig.forced_lines(port.end.node)[index];
            forced.or_else(|| pin.and_then(|node| run.rig.level(node)))
        })?;
        let turn = self.bench.core.enter().map_err(Error::from)?;
        turn.asked().map_err(Error::from)?;
        Ok(level.unwrap_or(usual))
    }
}

impl SerialPort for VirtualPort {
    fn name(&self) -> Option<String> {
        Some(Self::name(self).to_owned())
    }

    fn baud_rate(&self) -> Result<u32> {
        Ok(self.line()?.baud)
    }

    fn data_bits(&self) -> Result<DataBits> {
        Ok(match self.line()?.data_bits {
            5 => DataBits::Five,
            6 => DataBits::Six,
            7 => DataBits::Seven,
            _ => DataBits::Eight,
        })
    }

    fn flow_control(&self) -> Result<FlowControl> {
        Ok(FlowControl::None)
    }

    fn parity(&self) -> Result<Parity> {
        Ok(match self.line()?.parity {
            line::Parity::None => Parity::None,
            line::Parity::Even => Parity::Even,
            line::Parity::Odd => Parity::Odd,
        })
    }

    fn stop_bits(&self) -> Result<StopBits> {
        Ok(match self.line()?.stop_bits {
            2 => StopBits::Two,
            _ => StopBits::One,
        })
    }

    fn timeout(&self) -> Duration {
        Self::timeout(self)
    }

    fn set_baud_rate(&mut self, baud_rate: u32) -> Result<()> {
        self.change_line(|line| line.baud = baud_rate)
    }

    fn set_data_bits(&mut self, data_bits: DataBits) -> Result<()> {
        self.change_line(|line| line.data_bits = data_bits.into())
    }

    fn set_flow_control(&mut self, flow_control: FlowControl) -> Result<()> {
        match flow_control {
            FlowControl::None => self.with(|_, _| ()),
            FlowControl::Software => not_possible("XON/XOFF flow control"),
            FlowControl::Hardware => not_possible("RTS/CTS flow control"),
        }
    }

    fn set_parity(&mut self, parity: Parity) -> Result<()> {
        self.change_line(|line| {
            line.parity = match parity {
                Parity::None => line::Parity::None,
                Parity::Even => line::Parity::Even,
                Parity::Odd => line::Parity::Odd,
            }
        })
    }

    fn set_stop_bits(&mut self, stop_bits: StopBits) -> Result<()> {
        self.change_line(|line| line.stop_bits = stop_bits.into())
    }

    fn set_timeout(&mut self, timeout: Duration) -> Result<()> {
        Self::set_timeout(self, timeout);
        Ok(())
    }

    fn write_request_to_send(&mut self, level: bool) -> Result<()> {
        self.drive("rts", level)
    }

    fn write_data_terminal_ready(&mut self, level: bool) -> Result<()> {
        self.drive("dtr", level)
    }

    fn read_clear_to_send(&mut self) -> Result<bool> {
        self.sense("cts", CTS, true)
    }

    fn read_data_set_ready(&mut self) -> Result<bool> {
        self.sense("dsr", DSR, true)
    }

    fn read_ring_indicator(&mut self) -> Result<bool> {
        self.sense("ri", RI, false)
    }

    fn read_carrier_detect(&mut self) -> Result<bool> {
        self.sense("dcd", DCD, true)
    }

    fn bytes_to_read(&self) -> Result<u32> {
        Ok(u32::try_from(self.available()?).unwrap_or(u32::MAX))
    }

    fn bytes_to_write(&self) -> Result<u32> {
        let mut turn = self.bench.core.enter().map_err(Error::from)?;
        let (run, port) = turn.port(self.index).map_err(Error::from)?;
        let waiting = run.rig.backlog(port.end.node);
        turn.asked().map_err(Error::from)?;
        // The character in the shift register of the UART has left the buffer.
        Ok(u32::try_from(waiting).unwrap_or(u32::MAX))
    }

    fn clear(&self, buffer_to_clear: ClearBuffer) -> Result<()> {
        self.with(|run, port| {
            if buffer_to_clear != ClearBuffer::Output {
                port.clear(run);
            }
            if buffer_to_clear != ClearBuffer::Input {
                run.rig.discard_input(port.end.node);
            }
        })
    }

    fn try_clone(&self) -> Result<Box<dyn SerialPort>> {
        Ok(Box::new(self.clone()))
    }

    fn set_break(&self) -> Result<()> {
        self.with(|run, port| {
            run.rig.change_line(port.end.node, LineEvent::Break);
            run.go_on_until(run.rig.now());
        })
    }

    fn clear_break(&self) -> Result<()> {
        self.with(|_, _| ())
    }
}
