//! The other end of a line as a driver sees it, and exchanges with it.
//!
//! A [`Peer`] accepts bytes and returns bytes with their times. [`Emulated`] is a device in virtual
//! time; a real port is a peer too.

use core::time::Duration;
use std::collections::VecDeque;

use emulators::device::{Device, next_poll};
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::{Decode as _, Instant, LineConfig, Port};

use crate::description::Description;
use crate::framing::{Cutter, Frame};
use crate::schema::message::From;

/// The other end of a line.
pub trait Peer {
    /// The present time.
    fn now(&self) -> Instant;

    /// Sends bytes; returns the time at which the last one has left the line.
    ///
    /// # Errors
    /// If the port is gone.
    fn send(&mut self, bytes: &[u8]) -> Result<Instant, String>;

    /// The next bytes and the start time of the first one; `None` if no byte arrives before
    /// `until`.
    ///
    /// # Errors
    /// If the port is gone.
    fn hear(&mut self, until: Instant) -> Result<Option<(Instant, Vec<u8>)>, String>;

    /// Time by which bytes may arrive later than they were sent. A busy computer, or the driver of
    /// an adapter, delivers a frame in pieces with pauses between them.
    fn lateness(&self) -> Duration {
        Duration::ZERO
    }

    /// The line of the device, if it is known: an emulated device answers whatever line the driver
    /// has. `None` at a port, at which a device with another line does not answer.
    fn line(&self) -> Option<LineConfig> {
        None
    }
}

impl<P: Peer + ?Sized> Peer for &mut P {
    fn now(&self) -> Instant {
        (**self).now()
    }

    fn send(&mut self, bytes: &[u8]) -> Result<Instant, String> {
        (**self).send(bytes)
    }

    fn hear(&mut self, until: Instant) -> Result<Option<(Instant, Vec<u8>)>, String> {
        (**self).hear(until)
    }

    fn lateness(&self) -> Duration {
        (**self).lateness()
    }

    fn line(&self) -> Option<LineConfig> {
        (**self).line()
    }
}

/// A device in virtual time, at the other end of an ideal line.
pub struct Emulated {
    device: Box<dyn Device>,
    port: Port,
    line: LineConfig,
    world: World,
    now: Instant,
    /// End of the device's transmission.
    sending_until: Instant,
    heard: VecDeque<(Instant, Vec<u8>)>,
    /// Whether the device gets each byte when it ends, instead of all bytes of a request at once.
    is_bytewise: bool,
    /// Whether the line takes a byte only when it is free, instead of all bytes at once.
    is_paced: bool,
}

impl Emulated {
    /// The device that owns `port`, in an empty world.
    pub fn new(device: Box<dyn Device>, port: Port) -> Self {
        let scene = Scene::new::<Shape>([], Vec::new()).expect("an empty scene is sound");
        let world = World::new(scene, BodyConfig::default(), Pose::default(), 1);
        Self {
            line: device.line_config(port),
            device,
            port,
            world: world.expect("nothing is in the way"),
            now: Instant::ZERO,
            sending_until: Instant::ZERO,
            heard: VecDeque::new(),
            is_bytewise: false,
            is_paced: false,
        }
    }

    /// Takes a byte of the device only when the line is free. A restart of the device then loses
    /// the bytes that the line has not taken.
    #[must_use]
    pub fn paced(mut self) -> Self {
        self.is_paced = true;
        self
    }

    /// Delivers each byte when it ends, instead of all bytes of a request at once.
    #[must_use]
    pub fn bytewise(mut self) -> Self {
        self.is_bytewise = true;
        self
    }

    /// The number of violations of each rule so far.
    pub fn broken_rules(&self) -> Vec<(&'static str, u64)> {
        let rules = self.device.broken_rules();
        rules.map_or_else(Vec::new, |rules| rules.iter().collect())
    }

    /// Lets time pass and discards the device's output. Stops after `polls` steps, so that a device
    /// that streams does not take too long.
    pub fn pass(&mut self, time: Duration, polls: u32) {
        let end = self.now + time;
        for _ in 0..polls {
            if self.now >= end {
                break;
            }
            self.step(end);
        }
        self.heard.clear();
    }

    fn step(&mut self, end: Instant) {
        let next = next_poll(&*self.device, self.now, end);
        // The device may have a byte for the line when it is free again.
        self.now = match self.is_paced && self.sending_until > self.now {
            true => next.min(self.sending_until),
            false => next,
        };
        self.poll();
    }

    /// Polls the device and takes its bytes.
    fn poll(&mut self) {
        self.device.poll(self.now, &mut self.world);
        let mut buf = [0; 1_024];
        let room = match self.is_paced {
            false => buf.len(),
            true => usize::from(self.sending_until <= self.now),
        };
        let len = self.device.transmit(self.port, &mut buf[..room]);
        if len > 0 {
            let start = self.sending_until.max(self.now);
            self.sending_until = start + self.line.bytes_time(len as u64);
            self.heard.push_back((start, buf[..len].to_vec()));
        }
    }
}

impl Peer for Emulated {
    fn line(&self) -> Option<LineConfig> {
        Some(self.line)
    }

    fn now(&self) -> Instant {
        self.now
    }

    fn send(&mut self, bytes: &[u8]) -> Result<Instant, String> {
        let size = if self.is_bytewise { 1 } else { bytes.len() };
        let mut behind = bytes.len() as u64;
        let end = self.now + self.line.bytes_time(behind);
        for piece in bytes.chunks(size.max(1)) {
            behind -= piece.len() as u64;
            let at = self.line.byte_end(end, behind);
            while self.now < at {
                self.step(at);
            }
            self.device.receive(self.port, at, piece);
            // As a rig, which polls a device that has received bytes.
            self.poll();
        }
        Ok(end)
    }

    fn hear(&mut self, until: Instant) -> Result<Option<(Instant, Vec<u8>)>, String> {
        while self.heard.is_empty() && self.now < until {
            self.step(until);
        }
        Ok(self.heard.pop_front())
    }
}

/// Extra time for the end of a frame that began before the timeout.
const LATE_MAX: Duration = Duration::from_secs(3);
/// Share of the lateness of a port that is no pause yet, for frames that only a silence ends.
const OPEN_SHARE: u32 = 10;
/// Maximum number of bytes of an exchange. It also ends the exchange of a program that writes
/// without a pause.
const HEARD_MAX: usize = 1 << 20;

/// Bytes received after a request.
#[derive(Clone, Debug, Default)]
pub struct Heard {
    /// Frames, each with the time from the end of the request to its first byte.
    pub frames: Vec<(Duration, Frame)>,
    /// Number of bytes outside frames.
    pub stray: usize,
}

/// The driver's end of a line to a described device.
pub struct Speaker<'a> {
    description: &'a Description,
    cutter: Cutter,
    /// Silence that a device may need between frames.
    gap: Duration,
}

impl<'a> Speaker<'a> {
    /// A driver of the device.
    pub fn new(description: &'a Description) -> Self {
        let gap = match description.protocol {
            Some(_) => description.idle(),
            None if description.frames_of(From::Host).ends_with_silence() => description.idle(),
            None => Duration::ZERO,
        };
        Self {
            description,
            cutter: description.cutter_of(From::Device),
            gap,
        }
    }

    /// The description of the device.
    pub const fn description(&self) -> &'a Description {
        self.description
    }

    /// Sends `bytes` and receives frames until `is_last` returns true for a frame, or until `time`
    /// is over.
    ///
    /// # Errors
    /// If the port is gone.
    pub fn exchange(
        &mut self,
        peer: &mut dyn Peer,
        bytes: &[u8],
        time: Duration,
        is_last: &mut dyn FnMut(&Frame) -> bool,
    ) -> Result<Heard, String> {
        self.wait(peer, self.gap, &mut Heard::default())?;
        self.exchange_now(peer, bytes, time, is_last)
    }

    /// Like [`exchange`](Self::exchange), without the silence before a frame: `bytes` continue it.
    ///
    /// # Errors
    /// If the port is gone.
    pub fn exchange_now(
        &mut self,
        peer: &mut dyn Peer,
        bytes: &[u8],
        time: Duration,
        is_last: &mut dyn FnMut(&Frame) -> bool,
    ) -> Result<Heard, String> {
        let mut heard = Heard::default();
        let sent = match bytes {
            [] => peer.now(),
            bytes => peer.send(bytes)?,
        };
        let until = sent + time;
        let idle = self.idle(peer);
        let mut began = None;
        let stop_at = until + LATE_MAX;
        let mut room = HEARD_MAX;
        loop {
            // A pause ends a partial frame; a frame that began before the timeout is received to
            // its end.
            let stop = match self.cutter.pending() {
                0 => until,
                _ => stop_at.min(peer.now() + idle),
            };
            let Some((start, piece)) = peer.hear(stop)? else {
                let is_over = peer.now() >= until;
                if self.cutter.pending() > 0 {
                    self.cutter.idle();
                    self.take(&[], began.unwrap_or(sent), sent, &mut heard);
                    began = None;
                    if heard.frames.last().is_some_and(|(_, frame)| is_last(frame)) {
                        return Ok(heard);
                    }
                }
                if is_over {
                    return Ok(heard);
                }
                continue;
            };
            let first = *began.get_or_insert(start);
            let known = heard.frames.len();
            self.take(&piece, first, sent, &mut heard);
            if self.cutter.pending() == 0 {
                began = None;
            } else if heard.frames.len() > known {
                began = Some(start);
            }
            let new = &heard.frames[known..];
            room = room.saturating_sub(piece.len());
            let is_over = room == 0 || peer.now() >= stop_at;
            if is_over || new.iter().any(|(_, frame)| is_last(frame)) {
                return Ok(heard);
            }
        }
    }

    /// Pause that ends a partial frame. Only a frame that ends with a silence needs a short one.
    fn idle(&self, peer: &dyn Peer) -> Duration {
        let late = peer.lateness();
        let is_open = self
            .description
            .frames_of(From::Device)
            .ends_with_unknown_silence();
        let late = if is_open { late / OPEN_SHARE } else { late };
        self.description.idle().max(late)
    }

    /// Lets time pass and receives bytes.
    ///
    /// # Errors
    /// If the port is gone.
    pub fn wait(
        &mut self,
        peer: &mut dyn Peer,
        time: Duration,
        heard: &mut Heard,
    ) -> Result<(), String> {
        let until = peer.now() + time;
        while peer.now() < until {
            if let Some((start, piece)) = peer.hear(until)? {
                self.take(&piece, start, start, heard);
            }
        }
        Ok(())
    }

    fn take(&mut self, bytes: &[u8], began: Instant, sent: Instant, heard: &mut Heard) {
        let before = self.cutter.discarded();
        for frame in self.cutter.push(bytes).flatten() {
            let latency = if began > sent {
                began - sent
            } else {
                Duration::ZERO
            };
            heard.frames.push((latency, frame));
        }
        let lost = self.cutter.discarded() - before;
        heard.stray += usize::try_from(lost).unwrap_or(usize::MAX);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A program at the other end that writes without a pause.
    struct Flood {
        now: Instant,
        heard: usize,
    }

    impl Peer for Flood {
        fn now(&self) -> Instant {
            self.now
        }

        fn send(&mut self, _: &[u8]) -> Result<Instant, String> {
            Ok(self.now)
        }

        fn hear(&mut self, _: Instant) -> Result<Option<(Instant, Vec<u8>)>, String> {
            self.now += Duration::from_micros(1);
            self.heard += 1_024;
            assert!(self.heard <= 2 * HEARD_MAX, "the exchange does not end");
            Ok(Some((self.now, vec![0x55; 1_024])))
        }
    }

    #[test]
    fn an_exchange_with_a_program_that_never_pauses_ends() {
        let text = crate::shipped::text("modbus-meter").expect("shipped");
        let description = Description::parse("meter", text, &|_| Err("no file".to_owned()));
        let description = description.expect("a description");
        let mut flood = Flood {
            now: Instant::ZERO,
            heard: 0,
        };
        let heard = Speaker::new(&description)
            .exchange_now(&mut flood, &[1], Duration::from_secs(1), &mut |_| false)
            .expect("a port");
        assert!(heard.frames.is_empty());
        assert_eq!(flood.heard, HEARD_MAX);
    }
}
