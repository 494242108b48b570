//! Types of links, with their possible faults and the baud rates of their ports.

use core::fmt;

use protocols::LineConfig;

/// Type of a link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum LinkKind {
    /// Asynchronous serial: bytes with start and stop bits.
    #[default]
    Uart,
    /// A level, not a message: each byte is its value from then on.
    Pin,
    /// A bus with clock and acknowledge; bytes transmitted in one call are one transaction.
    I2c,
    /// Packets like UDP: bytes transmitted in one call arrive completely, or not at all.
    Datagram,
}

impl LinkKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Uart, Self::Pin, Self::I2c, Self::Datagram];

    /// Name as in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Uart => "uart",
            Self::Pin => "pin",
            Self::I2c => "i2c",
            Self::Datagram => "datagram",
        }
    }

    /// Whether whole messages travel rather than a stream of bytes.
    pub const fn carries_messages(self) -> bool {
        matches!(self, Self::I2c | Self::Datagram)
    }
}

/// The valid baud rates of a link's port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PortRate {
    /// The rate of the line: a client with another rate reads garbage.
    #[default]
    OfLine,
    /// Any rate: there is no UART behind the port, e.g. at the PC's end of a Bluetooth link.
    Any {
        /// Initial settings of the port, until a client changes them.
        usual: LineConfig,
    },
}

impl fmt::Display for LinkKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_of_link_has_its_name_and_its_unit() {
        let names = LinkKind::ALL.map(|kind| kind.to_string());
        assert_eq!(names, ["uart", "pin", "i2c", "datagram"]);
        let messages = LinkKind::ALL.map(LinkKind::carries_messages);
        assert_eq!(messages, [false, false, true, true]);
    }
}
