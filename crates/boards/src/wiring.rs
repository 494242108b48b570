//! The connections between the ports of a rig and the units of a board.

use core::fmt;
use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Map, Value, json};

use crate::Board;

/// The kind of data that a port of the rig carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortKind {
    /// Bytes of a UART.
    Uart,
    /// Transactions of a two-wire bus.
    I2c,
}

impl PortKind {
    /// Whether a port of this kind can be connected to this unit of a board. A byte on SPI is
    /// transferred like a byte on a UART.
    const fn fits(self, unit: Unit) -> bool {
        match unit {
            Unit::Uart(_) | Unit::Spi => matches!(self, Self::Uart),
            Unit::Twi => matches!(self, Self::I2c),
        }
    }
}

/// A unit of a board that can be connected to a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// The UART with this number.
    Uart(u8),
    /// The two-wire bus.
    Twi,
    /// The SPI bus.
    Spi,
}

/// The reason why ports cannot be connected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WiringError(String);

impl fmt::Display for WiringError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl core::error::Error for WiringError {}

impl Board {
    /// The unit of the board called `name`.
    pub fn unit(&self, name: &str) -> Option<Unit> {
        if self.i2c.as_deref() == Some(name) {
            return Some(Unit::Twi);
        }
        if self.spi.as_deref() == Some(name) {
            return Some(Unit::Spi);
        }
        self.uarts.get(name).copied().map(Unit::Uart)
    }

    /// The names of the board's units.
    pub fn port_names(&self) -> Vec<&str> {
        let uarts = self.uarts.keys();
        let buses = self.i2c.iter().chain(&self.spi);
        uarts.chain(buses).map(String::as_str).collect()
    }

    /// Connects `ports` of a rig. The unit of a port is the one in `wires` (pairs of a port of the
    /// rig and a unit), else the unit with the same name, else the only free unit of its kind, if
    /// no other port can use it. A two-wire bus accepts all chips.
    ///
    /// # Errors
    /// If a wire names an unknown end, or the unit of a port is ambiguous.
    pub fn wire(
        &self,
        ports: &[(String, PortKind)],
        wires: &BTreeMap<String, String>,
    ) -> Result<Value, WiringError> {
        let mut found: BTreeMap<&str, Unit> = BTreeMap::new();
        let known = || self.port_names().join(", ");
        for (port, to) in wires {
            let Some((_, kind)) = ports.iter().find(|(name, _)| name == port) else {
                let names: Vec<_> = ports.iter().map(|(name, _)| name.as_str()).collect();
                return Err(WiringError(format!(
                    "wire {port}={to}: the rig has no port \"{port}\", expected one of {}",
                    names.join(", ")
                )));
            };
            let unit = self.unit(to).ok_or_else(|| {
                WiringError(format!(
                    "wire {port}={to}: the board {} has no port \"{to}\", expected one of {}",
                    self.name,
                    known()
                ))
            })?;
            if !kind.fits(unit) {
                let fitting = self.port_names().into_iter();
                let fitting: Vec<_> = fitting
                    .filter(|name| self.unit(name).is_some_and(|unit| kind.fits(unit)))
                    .collect();
                let carries = match kind {
                    PortKind::Uart => "bytes of a UART",
                    PortKind::I2c => "transactions of I2C",
                };
                return Err(WiringError(format!(
                    "wire {port}={to}: the rig's port \"{port}\" carries {carries}, expected one of \
                     {}",
                    fitting.join(", ")
                )));
            }
            found.insert(port, unit);
        }
        for (port, kind) in ports {
            let same = self.unit(port).filter(|unit| kind.fits(*unit));
            if let (false, Some(unit)) = (found.contains_key(port.as_str()), same) {
                found.insert(port, unit);
            }
        }
        self.wire_the_rest(ports, &mut found)?;
        let mut taken = BTreeSet::new();
        let mut told = Map::new();
        for (port, unit) in found {
            let (name, number) = match unit {
                Unit::Uart(number) => ("uart", number),
                Unit::Twi => ("twi", 0),
                Unit::Spi => ("spi", 0),
            };
            if unit != Unit::Twi && !taken.insert((name, number)) {
                return Err(WiringError(format!(
                    "port \"{port}\": another port of the rig uses the board's {name}; connect \
                     this one elsewhere by a wire"
                )));
            }
            told.insert(port.to_owned(), json!({ "unit": name, "number": number }));
        }
        Ok(Value::Object(told))
    }

    fn wire_the_rest<'a>(
        &self,
        ports: &'a [(String, PortKind)],
        found: &mut BTreeMap<&'a str, Unit>,
    ) -> Result<(), WiringError> {
        for kind in [PortKind::I2c, PortKind::Uart] {
            let left = ports
                .iter()
                .filter(|(name, of)| *of == kind && !found.contains_key(name.as_str()));
            let left: Vec<_> = left.map(|(name, _)| name.as_str()).collect();
            let free = self.port_names().into_iter();
            let free = free.filter(|name| {
                self.unit(name).is_some_and(|unit| {
                    let fits = kind.fits(unit) && unit != Unit::Spi;
                    let is_taken = found.values().any(|taken| *taken == unit);
                    fits && (unit == Unit::Twi || !is_taken)
                })
            });
            let free: Vec<_> = free.collect();
            match (&left[..], &free[..]) {
                ([], _) => {}
                (ports, [only]) if ports.len() == 1 || kind == PortKind::I2c => {
                    let unit = self.unit(only);
                    found.extend(ports.iter().filter_map(|port| Some((*port, unit?))));
                }
                ([port, ..], _) => {
                    let free = match free.is_empty() {
                        true => "none is free".to_owned(),
                        false => format!("free are {}", free.join(", ")),
                    };
                    return Err(WiringError(format!(
                        "port \"{port}\" of the rig: its port of the board {} is not clear \
                         ({free}); add a wire, e.g. {port}={}",
                        self.name,
                        self.port_names().first().unwrap_or(&"serial")
                    )));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn wired(board: &str, ports: &[(&str, PortKind)], wires: &[(&str, &str)]) -> String {
        let board = Board::load(board, Path::new("")).expect("is shipped");
        let ports: Vec<_> = ports
            .iter()
            .map(|(n, kind)| ((*n).to_owned(), *kind))
            .collect();
        let wires = wires
            .iter()
            .map(|(a, b)| ((*a).to_owned(), (*b).to_owned()));
        match board.wire(&ports, &wires.collect()) {
            Ok(told) => told.to_string(),
            Err(error) => error.to_string(),
        }
    }

    #[test]
    fn the_only_port_left_takes_the_only_one_free() {
        use PortKind::{I2c, Uart};
        assert_eq!(
            wired(
                "arduino-uno",
                &[("scale", Uart), ("imu", I2c), ("sonar", I2c)],
                &[]
            ),
            r#"{"imu":{"number":0,"unit":"twi"},"scale":{"number":0,"unit":"uart"},"sonar":{"number":0,"unit":"twi"}}"#
        );
        assert_eq!(
            wired("arduino-mega", &[("serial2", Uart)], &[]),
            r#"{"serial2":{"number":2,"unit":"uart"}}"#
        );
    }

    #[test]
    fn what_is_not_clear_names_the_wire() {
        use PortKind::Uart;
        let two = [("gps", Uart), ("servo", Uart)];
        assert_eq!(
            wired("arduino-mega", &two, &[("gps", "serial1")]),
            "port \"servo\" of the rig: its port of the board arduino-mega is not clear (free \
             are serial, serial2, serial3); add a wire, e.g. servo=serial"
        );
        assert_eq!(
            wired("arduino-mega", &two, &[("gps", "com1")]),
            "wire gps=com1: the board arduino-mega has no port \"com1\", expected one of serial, \
             serial1, serial2, serial3, i2c, spi"
        );
        assert_eq!(
            wired("arduino-mega", &two, &[("gps", "i2c")]),
            "wire gps=i2c: the rig's port \"gps\" carries bytes of a UART, expected one of serial, \
             serial1, serial2, serial3, spi"
        );
        assert_eq!(
            wired(
                "arduino-uno",
                &[("imu", PortKind::I2c)],
                &[("imu", "serial")]
            ),
            "wire imu=serial: the rig's port \"imu\" carries transactions of I2C, expected one of i2c"
        );
        assert_eq!(
            wired("arduino-uno", &[("i2c", Uart), ("imu", PortKind::I2c)], &[]),
            r#"{"i2c":{"number":0,"unit":"uart"},"imu":{"number":0,"unit":"twi"}}"#
        );
        assert_eq!(
            wired("arduino-mega", &two, &[("gsp", "serial")]),
            "wire gsp=serial: the rig has no port \"gsp\", expected one of gps, servo"
        );
        assert_eq!(
            wired(
                "arduino-mega",
                &two,
                &[("gps", "serial1"), ("servo", "serial1")]
            ),
            "port \"servo\": another port of the rig uses the board's uart; connect this one \
             elsewhere by a wire"
        );
    }
}
