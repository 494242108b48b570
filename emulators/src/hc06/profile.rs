//! Kind of a module: its firmware, the figures of its radio, and its stored settings.

use core::time::Duration;

use protocols::LineConfig;
use protocols::hc06::{BAUD_DEFAULT, Family, Led, Texts};

/// Time at which a new line coding takes effect. No source says; reports only agree that the reply
/// to a new rate is easily missed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LineSwitch {
    /// The reply still goes out in the old coding.
    #[default]
    AfterReply,
    /// The reply already goes out in the new coding.
    BeforeReply,
    /// At the next start.
    AtPowerOn,
}

/// Treatment of undelivered bytes when the connection ends. No source says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Leftovers {
    /// The bytes are lost.
    #[default]
    Dropped,
    /// The bytes go out over the next connection.
    Kept,
}

/// Settings that the module keeps without power.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Name shown to a host that scans for modules, at most 20 bytes.
    pub name: Vec<u8>,
    /// Pairing code.
    pub pin: [u8; 4],
    /// Line coding of the UART.
    pub line: LineConfig,
    /// Whether the status LED may light up.
    pub led: Led,
}

/// A kind of module. A field without a source for its figure says so; such defaults are guesses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Profile {
    /// Firmware family.
    pub family: Family,
    /// Wording of the replies.
    pub texts: Texts,
    /// Text to the UART when a connection ends. By report some newer builds print one, no source
    /// says which; empty by default.
    pub disconnect_text: &'static [u8],
    /// Settings of the module as shipped.
    pub settings: Settings,
    /// Address on the air.
    pub address: [u8; 6],
    /// Silence that ends a command without a line end. Public tools that configure real
    /// modules look for the reply 0.55, 0.6 or 1 s after their command. One states that the module
    /// takes 0.6 s: about half a second. "One command a second" is a rule for the sender.
    pub silence: Duration,
    /// Longest time from the first to the last byte of a command without a line end:
    /// typing by hand fails, pasting works. About 1 s by report.
    pub command_time: Duration,
    /// Time at which a new line coding takes effect.
    pub line_switch: LineSwitch,
    /// From the host opening its port to data mode; 1 to 3 s by report.
    pub connect_delay: Duration,
    /// Radio silence after which both sides give the connection up. Bluetooth default.
    pub supervision: Duration,
    /// Treatment of bytes under way when the connection ends.
    pub leftovers: Leftovers,
    /// Bytes between UART and radio, towards the host. One remark has "after about 700 bytes".
    pub fifo_len: usize,
    /// Bytes a second that the module moves in one direction while the other is idle: 20 to 22.5
    /// kB/s measured. With both directions loaded each gets half: 10.8 kB/s measured.
    pub rate_bytes_s: u32,
    /// Maximum number of bytes of a radio frame: 127 or 330, no source says which of them linvor
    /// uses.
    pub frame_max: usize,
    /// Grid of the radio frames: five slots and the answer of the Bluetooth baseband.
    pub slot: Duration,
    /// Minimum and maximum time on the air after a pause.
    pub latency_idle: [Duration; 2],
    /// Minimum and maximum time on the air otherwise.
    pub latency_busy: [Duration; 2],
    /// Pause after which the radio link counts as idle. No source says.
    pub idle_after: Duration,
    /// Number of bytes per direction, under way or not yet taken, at which the module stops moving
    /// bytes. No source says; enough not to slow down a link whose other end reads.
    pub window: usize,
    /// Bytes that the host's operating system holds for the module before it loses some. No real
    /// host loses any: it makes the writer wait, see [`Hc06::room`](super::Hc06::room).
    pub host_queue_len: usize,
}

impl Profile {
    /// The usual module of a family.
    pub fn of(family: Family) -> Self {
        let name: &[u8] = match family {
            Family::Linvor18 => b"linvor",
            Family::Hc01V20 | Family::V30 => b"HC-06",
        };
        Self {
            family,
            texts: Texts::of(family),
            disconnect_text: b"",
            settings: Settings {
                name: name.to_vec(),
                pin: *b"1234",
                line: LineConfig::new_8n1(BAUD_DEFAULT),
                led: Led::On,
            },
            address: [0x98, 0xD3, 0x31, 0xF0, 0xA1, 0xB2],
            silence: Duration::from_millis(500),
            command_time: Duration::from_secs(1),
            line_switch: LineSwitch::AfterReply,
            connect_delay: Duration::from_secs(1),
            supervision: Duration::from_secs(20),
            leftovers: Leftovers::Dropped,
            fifo_len: 700,
            rate_bytes_s: 20_500,
            frame_max: 127,
            slot: Duration::from_micros(3_750),
            latency_idle: [25, 40].map(Duration::from_millis),
            latency_busy: [5, 15].map(Duration::from_millis),
            idle_after: Duration::from_millis(100),
            window: 2_048,
            host_queue_len: 1 << 20,
        }
    }

    /// The same module with its rate set to `baud`, as before its installation.
    #[must_use]
    pub fn at_baud(mut self, baud: u32) -> Self {
        self.settings.line = LineConfig::new_8n1(baud);
        self
    }
}

impl Default for Profile {
    fn default() -> Self {
        Self::of(Family::default())
    }
}
