//! A USB adapter between a port and its client. It collects the bytes of the line and delivers them
//! when its timer expires or a packet is full, so a read can end anywhere in a frame.

use core::time::Duration;

use bytes::{Bytes, BytesMut};
use emulators::rng::Rng;
use protocols::Instant;

use engine::scenario::AdapterSpec;

/// An adapter's buffer towards the client.
#[derive(Debug)]
pub(super) struct Adapter {
    period: Duration,
    /// Size of a full packet, bytes.
    packet: usize,
    expires_at: Instant,
    gathered: BytesMut,
}

impl Adapter {
    /// The adapter of the link `name` at `now`; `seed` sets the phase of its timer. `None` without
    /// an adapter.
    pub(super) fn new(spec: AdapterSpec, name: &str, seed: u64, now: Instant) -> Option<Self> {
        // FTDI's defaults are a latency timer of 16 ms and packets of 62 bytes beside two of
        // status. The other figures are a guess at USB full speed.
        let (millis, packet) = match spec {
            AdapterSpec::Direct => return None,
            AdapterSpec::Ftdi => (16, 62),
            AdapterSpec::Cp2102 => (4, 64),
            AdapterSpec::Ch340 => (1, 32),
        };
        let period = Duration::from_millis(millis);
        let mut rng = Rng::stream(seed, &format!("adapter.{name}"));
        let phase = period.mul_f64(rng.uniform());
        Some(Self {
            period,
            packet,
            expires_at: now + phase,
            gathered: BytesMut::new(),
        })
    }

    /// Time of the next delivery.
    pub(super) const fn expires_at(&self) -> Instant {
        self.expires_at
    }

    /// Delivers its bytes now, as one piece: the chip delivers a damaged character at once.
    pub(super) fn pass_all(&mut self, now: Instant) -> Vec<Bytes> {
        let mut pieces = self.pass(now, &[]);
        if !self.gathered.is_empty() {
            pieces.push(self.gathered.split().freeze());
        }
        pieces
    }

    /// Takes bytes of the line; returns the pieces that the client gets at `now`.
    pub(super) fn pass(&mut self, now: Instant, bytes: &[u8]) -> Vec<Bytes> {
        self.gathered.extend_from_slice(bytes);
        let mut pieces = Vec::new();
        while self.gathered.len() >= self.packet {
            pieces.push(self.gathered.split_to(self.packet).freeze());
        }
        if now >= self.expires_at {
            while self.expires_at <= now {
                self.expires_at += self.period;
            }
            if !self.gathered.is_empty() {
                pieces.push(self.gathered.split().freeze());
            }
        }
        pieces
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At 115,200 baud, 16 ms are 184 bytes: two packets of 62 and a rest of 60.
    #[test]
    fn ftdi_hands_over_full_packets_and_the_rest_when_its_timer_expires() {
        let adapter = Adapter::new(AdapterSpec::Ftdi, "lidar", 1, Instant::ZERO);
        let mut adapter = adapter.expect("has one");
        let begins = adapter.expires_at();
        assert!(begins < Instant::from_millis(16));
        assert!(adapter.pass(begins, &[]).is_empty());
        assert_eq!(adapter.expires_at() - begins, Duration::from_millis(16));
        let mut lens = Vec::new();
        for byte in 0..184_u8 {
            let at = begins + Duration::from_micros(86) * u32::from(byte);
            lens.extend(adapter.pass(at, &[byte]).iter().map(Bytes::len));
        }
        let last = adapter.pass(adapter.expires_at(), &[]);
        lens.extend(last.iter().map(Bytes::len));
        assert_eq!(lens, [62, 62, 60]);
        assert_eq!(last[0][..2], [124, 125]);
    }

    #[test]
    fn without_an_adapter_nothing_is_gathered() {
        assert!(Adapter::new(AdapterSpec::Direct, "lidar", 1, Instant::ZERO).is_none());
    }
}
