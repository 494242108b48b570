//! The open ends of a rig's links: pseudo-terminals in a directory, or real ports.

use clap::Args;

use super::CliError;
use super::place::{self, NamedPort};
use crate::realtime::exec::Seat;
use crate::realtime::transport::{PortDir, Pty, Serial, Transport, Udp};
use crate::rig::{PortRate, Rig};
use crate::robots::{Instruments, OpenEnd, Wired};
use crate::show::shell::quoted;

/// Links on real ports.
#[derive(Debug, Args)]
pub(super) struct EndArgs {
    /// Use a real device, or your own pseudo-terminal, instead of the emulated one
    #[arg(long, value_name = "LINK=PATH")]
    device_at: Vec<NamedPort>,
    /// Offer the robot's end of a link on a serial port instead of a pseudo-terminal, or the end of
    /// a message link on a network port: NAME=udp:9000
    #[arg(long, value_name = "LINK=PATH")]
    dut_at: Vec<NamedPort>,
}

/// A rig with the interface of its robot, and the addresses of its open ends.
pub(super) type Placed = (Rig, Box<dyn Instruments>, Vec<Seat>);

impl EndArgs {
    /// Whether any link is on a real port.
    pub(super) const fn is_given(&self) -> bool {
        !self.device_at.is_empty() || !self.dut_at.is_empty()
    }

    /// The given options as text, each after a blank.
    pub(super) fn repeat(&self) -> String {
        let option = |name: &str, ports: &[NamedPort]| {
            let words = ports.iter().map(|port| {
                let place = format!("{}={}", port.name, port.path.display());
                format!(" --{name} {}", quoted(&place))
            });
            words.collect::<String>()
        };
        option("device-at", &self.device_at) + &option("dut-at", &self.dut_at)
    }

    /// Opens or creates a port for each open end.
    pub(super) fn place(&self, wired: Wired, dir: &mut PortDir) -> Result<Placed, CliError> {
        self.place_all(wired, Vec::new(), dir)
    }

    /// As [`place`](Self::place), with the open ends of further robots: their ports are in
    /// directories with the names of the robots.
    pub(super) fn place_all(
        &self,
        wired: Wired,
        others: Vec<OpenEnd>,
        dir: &mut PortDir,
    ) -> Result<Placed, CliError> {
        let Wired {
            mut rig,
            mut open_ends,
            instruments,
        } = wired;
        open_ends.extend(others);
        let names: Vec<String> = open_ends.iter().map(|end| end.name.clone()).collect();
        place::check("--dut-at", &self.dut_at, &names)?;
        place::check("--device-at", &self.device_at, &names)?;
        let mut seats = Vec::new();
        for end in open_ends {
            let real = place::find(&self.dut_at, &end.name);
            let transport: Box<dyn Transport> = match real {
                Some(place) => open(place, &end, &rig)?,
                None => match end.name.split_once('/') {
                    Some((robot, own)) => Box::new(Pty::open(dir.part(robot)?, own, end.line)?),
                    None => Box::new(Pty::open(dir, &end.name, end.line)?),
                },
            };
            seats.extend(self.device(&mut rig, &end)?);
            seats.push(Seat {
                end,
                transport,
                is_terminal: real.is_none(),
            });
        }
        Ok((rig, instruments, seats))
    }

    /// The real device at the other side of `end`, if one is given.
    fn device(&self, rig: &mut Rig, end: &OpenEnd) -> Result<Option<Seat>, CliError> {
        let Some(place) = place::find(&self.device_at, &end.name) else {
            return Ok(None);
        };
        let port = Serial::open(&place.path, end.line)?;
        let node = rig.replace_device(&end.link).ok_or_else(|| {
            let name = &end.name;
            CliError::Usage(format!("--device-at {name}: expected a link with a device"))
        })?;
        if end.rate == PortRate::OfLine {
            rig.set_line_config(node, end.line);
        }
        let end = OpenEnd {
            name: format!("{} (device)", end.name),
            node,
            connect: "a device in place of the emulated one",
            ..end.clone()
        };
        Ok(Some(Seat {
            end,
            transport: Box::new(port),
            is_terminal: false,
        }))
    }
}

/// The real port of `end` at `place`.
fn open(place: &NamedPort, end: &OpenEnd, rig: &Rig) -> Result<Box<dyn Transport>, CliError> {
    let Some(address) = Udp::address(&place.path) else {
        return Ok(Box::new(Serial::open(&place.path, end.line)?));
    };
    let link = rig.link(&end.link);
    if !link.is_some_and(|link| link.kind.carries_messages()) {
        let name = &end.name;
        let text = format!(
            "--dut-at {name}: udp carries whole messages, but this link carries single bytes; \
             expected a serial port, or a link of messages"
        );
        return Err(CliError::Usage(text));
    }
    Ok(Box::new(Udp::open(address)?))
}

/// The ports as data, one a line.
pub(super) fn print_table(seats: &[Seat]) {
    let rows: Vec<[String; 4]> = seats
        .iter()
        .map(|Seat { end, transport, .. }| {
            [
                end.name.clone(),
                transport.path().display().to_string(),
                match end.rate {
                    PortRate::OfLine => end.line.baud.to_string(),
                    PortRate::Any { .. } => "any".to_owned(),
                },
                end.connect.to_owned(),
            ]
        })
        .collect();
    let head = ["name", "path", "baud", "connect"].map(str::to_owned);
    let width = |column: usize| {
        let cells = rows.iter().chain([&head]);
        cells.map(|row| row[column].len()).max().unwrap_or(0)
    };
    let [name_width, path_width, baud_width] = [width(0), width(1), width(2)];
    for [name, path, baud, connect] in [&head].into_iter().chain(&rows) {
        println!("{name:<name_width$}  {path:<path_width$}  {baud:>baud_width$}  {connect}");
    }
}
