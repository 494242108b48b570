//! The sensor's transmitter: a ring of bytes behind a UART without flow control.
//!
//! If a packet does not fit the ring, the whole packet is dropped. So a host sees index jumps,
//! never torn packets. The capture shows about five packets behind the one on the line: with the
//! motor slow, 4 to 6 packets in sequence come out of a burst before the first jump.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::{Instant, LineConfig, xv11};

use crate::device::take;

/// Line coding of the UART, always the same.
pub(super) const LINE: LineConfig = LineConfig::new_8n1(xv11::BAUD);
/// Bytes that may be waiting, those on the line included.
const RING: u64 = 6 * xv11::FRAME_LEN as u64;
/// Bytes handed out but not taken by the line. The line takes them as fast as they are sent, so
/// more than this means that nothing is connected.
const UNTAKEN_MAX: usize = 1024;

/// Bytes that are sent or dropped together.
#[derive(Clone, Copy, Debug)]
struct Packet {
    bytes: [u8; xv11::FRAME_LEN],
    len: usize,
    /// Start of its first bit.
    starts: Instant,
}

/// Transmitter state. It keeps its own time, so dropped packets do not depend on when the line
/// takes bytes.
#[derive(Clone, Debug, Default)]
pub(super) struct Uart {
    waiting: VecDeque<Packet>,
    /// End of the last accepted byte.
    free_at: Instant,
    out: VecDeque<u8>,
    dropped: u64,
}

impl Uart {
    /// Time at which a packet of `len` bytes will fit.
    pub(super) fn room_at(&self, len: usize) -> Instant {
        let ahead = LINE.bytes_time(RING - len as u64);
        Instant::ZERO + (self.free_at - Instant::ZERO).saturating_sub(ahead)
    }

    /// Accepts a packet of at most 22 bytes or drops it, counted.
    pub(super) fn push(&mut self, now: Instant, bytes: &[u8]) {
        debug_assert!(bytes.len() <= xv11::FRAME_LEN, "packets are short");
        let len = bytes.len().min(xv11::FRAME_LEN);
        if self.room_at(len) > now {
            self.dropped += 1;
            return;
        }
        let mut packet = Packet {
            bytes: [0; xv11::FRAME_LEN],
            len,
            starts: self.free_at.max(now),
        };
        packet.bytes[..len].copy_from_slice(&bytes[..len]);
        self.free_at = packet.starts + LINE.bytes_time(len as u64);
        self.waiting.push_back(packet);
    }

    /// Prints text, waiting for each character: nothing else runs meanwhile.
    pub(super) fn print(&mut self, now: Instant, text: &str) {
        self.free_at = self.free_at.max(now) + LINE.bytes_time(text.len() as u64);
        self.hand_out(text.as_bytes());
    }

    /// End of the first `count` bytes of the last accepted packet.
    pub(super) fn part_out_at(&self, count: u64) -> Instant {
        let last = self.waiting.back().map(|packet| packet.starts);
        last.unwrap_or(self.free_at) + LINE.bytes_time(count)
    }

    /// Time at which [`release`](Self::release) has work.
    pub(super) fn release_at(&self) -> Option<Instant> {
        self.waiting.front().map(|packet| packet.starts)
    }

    /// Moves the bytes due by `now` to the line. Of a packet that would not be finished at
    /// `power_cut` only the finished bytes go out.
    pub(super) fn release(&mut self, now: Instant, power_cut: Option<Instant>) {
        while let Some(packet) = self.waiting.front().copied() {
            if packet.starts > now {
                break;
            }
            self.waiting.pop_front();
            let len = power_cut.map_or(packet.len, |cut| packet.done_by(cut));
            self.hand_out(&packet.bytes[..len]);
        }
    }

    /// Discards bytes that are not on the line yet: the processor restarts at `now`.
    pub(super) fn reset(&mut self, now: Instant) {
        self.waiting.clear();
        self.free_at = now;
    }

    /// Cuts the supply: no byte leaves any more.
    pub(super) fn power_off(&mut self, now: Instant) {
        self.reset(now);
        self.out.clear();
    }

    /// Whether bytes wait for the line.
    pub(super) fn has_output(&self) -> bool {
        !self.out.is_empty()
    }

    pub(super) fn transmit(&mut self, buf: &mut [u8]) -> usize {
        take(&mut self.out, buf)
    }

    /// Packets dropped since power-on because the ring was full.
    pub(super) const fn dropped(&self) -> u64 {
        self.dropped
    }

    fn hand_out(&mut self, bytes: &[u8]) {
        if self.out.len() + bytes.len() <= UNTAKEN_MAX {
            self.out.extend(bytes);
        } else {
            self.dropped += 1;
        }
    }
}

impl Packet {
    /// Bytes that are out at `cut`.
    fn done_by(&self, cut: Instant) -> usize {
        let line_time: Duration = cut - self.starts;
        (1..=self.len)
            .take_while(|&count| LINE.bytes_time(count as u64) <= line_time)
            .count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACKET: [u8; 22] = [0xFA; 22];

    fn taken(uart: &mut Uart) -> usize {
        uart.transmit(&mut [0; 2048])
    }

    /// Six packets of 22 bytes fill the ring; the seventh fits when the first is out, 22 byte
    /// times of 86.8 us later.
    #[test]
    fn a_full_ring_drops_whole_packets_until_one_is_out() {
        let mut uart = Uart::default();
        for _ in 0..7 {
            uart.push(Instant::ZERO, &PACKET);
        }
        assert_eq!(uart.dropped(), 1);
        assert_eq!(uart.room_at(22).as_micros(), 1_909);
        uart.push(Instant::from_nanos(1_909_722), &PACKET);
        assert_eq!(uart.dropped(), 1);
    }

    /// A packet is handed to the line when its first bit goes out, not before.
    #[test]
    fn packets_leave_one_after_the_other() {
        let mut uart = Uart::default();
        uart.push(Instant::ZERO, &PACKET);
        uart.push(Instant::ZERO, &PACKET);
        uart.release(Instant::from_micros(1), None);
        assert_eq!(taken(&mut uart), 22);
        assert_eq!(uart.release_at().map(Instant::as_micros), Some(1_909));
        uart.release(Instant::from_millis(2), None);
        assert_eq!(taken(&mut uart), 22);
    }

    /// 7 bytes take 607.6 us: the cut that the capture shows before its boot text.
    #[test]
    fn a_restart_cuts_the_packet_on_the_line() {
        let mut uart = Uart::default();
        uart.push(Instant::ZERO, &PACKET);
        uart.release(Instant::ZERO, Some(Instant::from_micros(650)));
        assert_eq!(taken(&mut uart), 7);
    }

    #[test]
    fn without_a_line_the_bytes_are_bounded_and_counted() {
        let mut uart = Uart::default();
        for at in 0..100 {
            let now = Instant::from_millis(3 * at);
            uart.push(now, &PACKET);
            uart.release(now, None);
        }
        assert_eq!(taken(&mut uart), 46 * 22);
        assert_eq!(uart.dropped(), 100 - 46);
    }

    /// Four characters take 347.2 us; a packet behind them starts when they are out.
    #[test]
    fn text_goes_out_at_once_and_holds_the_line() {
        let mut uart = Uart::default();
        assert!(!uart.has_output());
        uart.print(Instant::from_millis(1), "boot");
        assert!(uart.has_output());
        assert_eq!(uart.transmit(&mut [0; 3]), 3);
        assert!(uart.has_output());
        assert_eq!(uart.transmit(&mut [0; 3]), 1);
        assert!(!uart.has_output());
        uart.push(Instant::from_millis(1), &PACKET);
        assert_eq!(uart.release_at().map(Instant::as_micros), Some(1_347));
        uart.release(Instant::from_micros(1_347), None);
        assert_eq!(taken(&mut uart), 0);
        uart.release(Instant::from_micros(1_348), None);
        assert_eq!((taken(&mut uart), uart.release_at()), (22, None));
    }

    /// Seven bytes of the packet that was accepted last are out 607.6 us behind its start: the
    /// second packet starts at 1,909.7 us. Without a packet they count from the end of the last.
    #[test]
    fn a_part_of_the_last_packet_is_out_later() {
        let mut uart = Uart::default();
        uart.push(Instant::ZERO, &PACKET);
        assert_eq!(uart.part_out_at(7).as_micros(), 607);
        uart.push(Instant::ZERO, &PACKET);
        assert_eq!(uart.part_out_at(7).as_micros(), 2_517);
        uart.release(Instant::from_millis(2), None);
        assert_eq!(uart.part_out_at(7).as_micros(), 4_427);
    }

    /// A restart forgets what waits; what was handed to the line stays, unless the supply is cut.
    #[test]
    fn a_restart_forgets_packets_and_a_cut_supply_bytes() {
        let mut uart = Uart::default();
        for _ in 0..3 {
            uart.push(Instant::ZERO, &PACKET);
        }
        uart.release(Instant::ZERO, None);
        let now = Instant::from_millis(1);
        uart.reset(now);
        assert_eq!((uart.release_at(), uart.free_at), (None, now));
        assert_eq!(taken(&mut uart), 22);
        uart.push(now, &PACKET);
        uart.release(now, None);
        assert!(uart.has_output());
        uart.power_off(now);
        assert!(!uart.has_output());
    }
}
