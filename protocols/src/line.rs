//! A UART line: its two ends, how bits are coded, how long a byte takes.

use core::time::Duration;

use crate::Instant;

/// One of a node's serial ports, numbered from zero. Every node names its own as constants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Port(pub u8);

/// Parity bit of a character.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Parity {
    /// No parity bit.
    #[default]
    None,
    /// The count of ones, parity bit included, is even.
    Even,
    /// The count of ones, parity bit included, is odd.
    Odd,
}

/// Line coding: settings that both ends of a UART must share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineConfig {
    /// Bits per second, never zero.
    pub baud: u32,
    /// Data bits per character, 5 to 8.
    pub data_bits: u8,
    /// Parity bit.
    pub parity: Parity,
    /// Stop bits, 1 or 2.
    pub stop_bits: u8,
}

impl LineConfig {
    /// Eight data bits, no parity, one stop bit: every wire of the three robots.
    pub const fn new_8n1(baud: u32) -> Self {
        Self {
            baud,
            data_bits: 8,
            parity: Parity::None,
            stop_bits: 1,
        }
    }

    /// Bit times of one character, start bit included; ten for 8N1.
    pub const fn bits_per_byte(self) -> u32 {
        let parity = match self.parity {
            Parity::None => 0,
            Parity::Even | Parity::Odd => 1,
        };
        1 + self.data_bits as u32 + parity + self.stop_bits as u32
    }

    /// Whether a receiver with this coding reads the sender's bytes without resampling: equal
    /// coding, and a rate that drifts less than a tenth of a bit over ten bits.
    pub const fn agrees_with(self, receiver: Self) -> bool {
        let coding = self.data_bits == receiver.data_bits
            && self.parity as u8 == receiver.parity as u8
            && self.stop_bits == receiver.stop_bits;
        coding && self.baud.abs_diff(receiver.baud) as u64 * 100 <= self.baud as u64
    }

    /// Whether two UARTs understand each other, one with this coding and the other at `baud`: the
    /// middle of the last bit lies within that bit. For ten bits this is a difference of 5 %.
    pub const fn tolerates(self, baud: u32) -> bool {
        let (slow, fast) = match self.baud < baud {
            true => (self.baud as u64, baud as u64),
            false => (baud as u64, self.baud as u64),
        };
        let bits = self.bits_per_byte() as u64;
        fast * (2 * bits - 1) < slow * 2 * bits
    }

    /// The rate to which a client can be set for this line: the nearest usual one if the line
    /// [tolerates](Self::tolerates) it, else the line's own. A microcontroller divides its clock
    /// and meets a usual rate only roughly: 16 MHz gives 9615 and 117647 baud.
    pub fn usual_baud(self) -> u32 {
        const USUAL: [u32; 22] = [
            300, 600, 1_200, 2_400, 4_800, 9_600, 14_400, 19_200, 28_800, 31_250, 38_400, 57_600,
            76_800, 115_200, 230_400, 250_000, 460_800, 500_000, 921_600, 1_000_000, 2_000_000,
            3_000_000,
        ];
        let near = USUAL.into_iter().filter(|baud| self.tolerates(*baud));
        let near = near.min_by_key(|baud| self.baud.abs_diff(*baud));
        near.unwrap_or(self.baud)
    }

    /// Time on the wire of one character, rounded down to a nanosecond.
    pub const fn byte_time(self) -> Duration {
        self.bytes_time(1)
    }

    /// Time on the wire of `count` characters back to back. Rounded once: rounding of each
    /// [`byte_time`](Self::byte_time) would add up in a long burst.
    pub const fn bytes_time(self, count: u64) -> Duration {
        Duration::from_nanos(self.bytes_nanos(count))
    }

    const fn bytes_nanos(self, count: u64) -> u64 {
        self.bits_per_byte() as u64 * count * 1_000_000_000 / self.baud as u64
    }

    /// End of a byte after which `behind` more bytes followed without a gap, the last of them
    /// ending at `end`; never before [`Instant::ZERO`].
    #[inline]
    pub const fn byte_end(self, end: Instant, behind: u64) -> Instant {
        Instant::from_nanos(end.as_nanos().saturating_sub(self.bytes_nanos(behind)))
    }
}

/// Events of a line other than bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineEvent {
    /// The other end opened its port (for the air end of a radio: the PC connected).
    Opened,
    /// The other end closed its port or was unplugged.
    Closed,
    /// The line was held low for longer than a character.
    Break,
    /// A character without a valid stop bit: noise, or a wrong baud rate.
    FramingError,
    /// A character whose parity bit is wrong.
    ParityError,
    /// The receiver had no room for a character.
    Overrun,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An ATmega at 16 MHz divides by 16 or 8, and by a whole number: 16 * 104, 16 * 17 and 8 * 17
    /// give 9615, 58823 and 117647 baud. The middle of the stop bit, 9.5 bits after the edge, must
    /// come before the end of the tenth bit, so the rates may differ by 20 to 19.
    #[test]
    fn rates_of_dividers_are_understood() {
        for (device, usual) in [(9_615, 9_600), (58_823, 57_600), (117_647, 115_200)] {
            let line = LineConfig::new_8n1(device);
            assert!(line.tolerates(usual), "{device}");
            assert_eq!(line.usual_baud(), usual);
        }
        let line = LineConfig::new_8n1(9_500);
        assert!(line.tolerates(9_999) && !line.tolerates(10_000));
        assert!(line.tolerates(9_026) && !line.tolerates(9_025));
        // No usual rate is near.
        assert_eq!(LineConfig::new_8n1(66_666).usual_baud(), 66_666);
    }

    /// Style budget: 86.8 us at 115200, 10 us at 1 Mbaud, 21.7 us at 460800, all with ten bits.
    #[test]
    fn an_8n1_byte_costs_ten_bit_times() {
        assert_eq!(
            LineConfig::new_8n1(115_200).byte_time(),
            Duration::from_nanos(86_805)
        );
        assert_eq!(
            LineConfig::new_8n1(1_000_000).byte_time(),
            Duration::from_micros(10)
        );
        assert_eq!(
            LineConfig::new_8n1(460_800).byte_time(),
            Duration::from_nanos(21_701)
        );
    }

    /// Seed figure S7: 90,000 cells take 1.953125 s with ten bits a byte, not 1.5625 s.
    #[test]
    fn a_raw_map_takes_1953_ms_at_460800_baud() {
        let map = LineConfig::new_8n1(460_800).bytes_time(300 * 300);
        assert_eq!(map, Duration::from_micros(1_953_125));
    }

    /// Finding T1: a character of start bit, 8 data bits, parity and 2 stop bits; and one of start
    /// bit, 5 data bits and 1 stop bit.
    #[test]
    fn every_bit_of_a_character_is_counted() {
        let line = |data_bits, parity, stop_bits| LineConfig {
            baud: 1_000_000,
            data_bits,
            parity,
            stop_bits,
        };
        assert_eq!(line(8, Parity::Even, 2).bits_per_byte(), 12);
        assert_eq!(line(8, Parity::Odd, 1).bits_per_byte(), 11);
        assert_eq!(line(5, Parity::None, 1).bits_per_byte(), 7);
        let byte_time = line(8, Parity::Odd, 1).byte_time();
        assert_eq!(byte_time, Duration::from_micros(11));
    }

    /// Finding T1: rates that differ by 1 %, a tenth of a bit over ten bits, are still read: 960 of
    /// 96,000 baud.
    #[test]
    fn lines_agree_up_to_one_per_cent() {
        let sender = LineConfig::new_8n1(96_000);
        let at = |baud| sender.agrees_with(LineConfig::new_8n1(baud));
        assert!(at(96_000) && at(96_960) && at(95_040));
        assert!(!at(96_961) && !at(95_039));
        // The allowed share is one of the sender's rate.
        assert!(!LineConfig::new_8n1(95_040).agrees_with(sender));
    }

    /// Finding T1: each part of the coding separately.
    #[test]
    fn lines_of_another_coding_never_agree() {
        let sender = LineConfig::new_8n1(9_600);
        let others = [
            LineConfig {
                data_bits: 7,
                ..sender
            },
            LineConfig {
                parity: Parity::Even,
                ..sender
            },
            LineConfig {
                stop_bits: 2,
                ..sender
            },
        ];
        assert!(sender.agrees_with(sender));
        assert!(others.iter().all(|&other| !sender.agrees_with(other)));
    }

    /// A byte with three bytes of 10 us behind it, the last of which ends at 100 us, ended at 70
    /// us. With 11 bytes behind it, the byte would have ended before the run: the result is 0.
    #[test]
    fn the_end_of_a_byte_follows_from_those_behind_it() {
        let line = LineConfig::new_8n1(1_000_000);
        let end = Instant::from_micros(100);
        assert_eq!(line.byte_end(end, 0), end);
        assert_eq!(line.byte_end(end, 3), Instant::from_micros(70));
        assert_eq!(line.byte_end(end, 11), Instant::ZERO);
    }
}
