//! Links that carry whole messages instead of a stream of bytes: the transactions of an I2C bus,
//! the packets of a datagram network.
//!
//! One transmit call of a node is one message, and so is one receive call. Faults count messages
//! instead of bytes.
//!
//! ```text
//! I2C:       start | byte 8 + ack 1 | .. | stop          9 n + 2 bit times
//! datagram:  IP and UDP headers, 28 bytes | n bytes      8 (n + 28) bit times
//! ```
//!
//! The bit rate is the `baud` of the sender's line coding.

use core::time::Duration;

use protocols::{Instant, LineConfig};

use super::{Chunk, Errors, Line, Original};
use crate::rig::LinkKind;
use crate::rig::fault::Budget;

/// Maximum message length: the payload of a UDP packet in one Ethernet frame.
pub const MESSAGE_MAX: usize = 1472;
/// Bytes before the payload of a packet: 20 of IP, 8 of UDP.
const HEADERS_LEN: usize = 28;

/// A message that waits until another one has overtaken it.
#[derive(Clone, Debug)]
pub(super) struct Message {
    bytes: Vec<u8>,
    copies: usize,
    original: Option<Box<Original>>,
}

/// Duration of a message of `len` bytes on a link of `kind` whose sender has this `line`.
pub fn message_time(kind: LinkKind, line: LineConfig, len: usize) -> Duration {
    let len = len as u64;
    let bits = match kind {
        LinkKind::I2c => 9 * len + 2,
        LinkKind::Datagram => 8 * (len + HEADERS_LEN as u64),
        LinkKind::Uart | LinkKind::Pin => return line.bytes_time(len),
    };
    Duration::from_nanos(bits * 1_000_000_000 / u64::from(line.baud.max(1)))
}

impl Line {
    /// Sends the message `sent` by the sender; returns its end.
    pub(crate) fn take_message(
        &mut self,
        kind: LinkKind,
        now: Instant,
        sender: LineConfig,
        budget: &mut Budget,
        sent: &[u8],
    ) -> Instant {
        let ends = now + message_time(kind, sender, sent.len());
        self.free_at = ends;
        self.traffic.sent += sent.len() as u64;
        let number = self.messages;
        self.messages += 1;
        if self.is_played {
            self.traffic.lost += sent.len() as u64;
        } else {
            self.send_message(number, now, ends, sent.to_vec(), budget);
        }
        ends
    }

    fn send_message(
        &mut self,
        number: u64,
        start: Instant,
        ends: Instant,
        bytes: Vec<u8>,
        budget: &mut Budget,
    ) {
        let struck = self.faults.struck_len();
        let passed = self.faults.pass_message(number, start, budget);
        let late = self.latency + passed.late;
        let is_changed = self.faults.struck_len() > struck || !passed.effects.is_empty();
        let original = (is_changed || late > Duration::ZERO).then(|| {
            Box::new(Original {
                at: ends,
                bytes: bytes.clone(),
                strikes: self.faults.struck().skip(struck).copied().collect(),
                effects: passed.effects,
                bauds: None,
            })
        });
        let (len, copies) = (bytes.len() as u64, passed.copies);
        self.traffic.lost += if copies == 0 { len } else { 0 };
        self.traffic.added += copies.saturating_sub(1) as u64 * len;
        self.in_flight += copies as u64 * len;
        let message = Message {
            bytes,
            copies,
            original,
        };
        let overtaken = if passed.is_overtaken {
            self.waiting.replace(message)
        } else {
            self.arrive(ends + late, message);
            self.waiting.take()
        };
        if let Some(message) = overtaken {
            self.arrive(ends + late, message);
        }
    }

    /// Delivers `message` at `at`, after messages that arrive no later.
    fn arrive(&mut self, at: Instant, message: Message) {
        let Message {
            bytes,
            copies,
            mut original,
        } = message;
        for _ in 0..copies {
            let place = self.chunks.partition_point(|chunk| chunk.arrives <= at);
            let chunk = Chunk {
                arrives: at,
                bytes: bytes.clone(),
                errors: Errors::default(),
                original: original.take(),
            };
            self.chunks.insert(place, chunk);
        }
        self.note_due();
    }
}

#[cfg(test)]
mod tests {
    use emulators::world::{BodyConfig, Pose, Scene, World};
    use protocols::Port;

    use super::*;
    use crate::rig::Rig;
    use crate::rig::fault::{Activity, Damage, Effect, FaultId, Strike, Window};
    use crate::rig::line::{Direction, End};

    const LEFT: usize = 0;
    const RIGHT: usize = 1;

    /// Two outside ends, joined by a link of `kind` with this bit rate.
    fn joined(kind: LinkKind, rate: u32) -> Rig {
        let scene = Scene::new(Vec::<emulators::world::Shape>::new(), Vec::new());
        let body = BodyConfig::default().ideal();
        let world = World::new(scene.expect("empty"), body, Pose::default(), 1);
        let mut rig = Rig::new(world.expect("free"));
        let ends = ["left", "right"].map(|name| End {
            node: rig.add_outside(name, LineConfig::new_8n1(rate)),
            port: Port(0),
        });
        rig.connect_by(kind, "link", ends[LEFT], ends[RIGHT], 1);
        rig
    }

    fn line(rig: &mut Rig) -> &mut Line {
        rig.line_mut(0, Direction::ToMaster)
    }

    fn strike(rig: &mut Rig, message: u64, damage: Damage) {
        let byte = message;
        line(rig).faults.add_strike(Strike { byte, damage });
    }

    /// Sends `messages` at once and returns when each arrives, microseconds, with its first byte.
    fn sent(rig: &mut Rig, messages: &[&[u8]]) -> Vec<(u64, u8)> {
        messages.iter().for_each(|bytes| rig.inject(LEFT, bytes));
        let mut seen = Vec::new();
        for micros in 0..20_000 {
            rig.run_until(Instant::ZERO + Duration::from_micros(micros));
            let arrived = rig.take_messages(RIGHT);
            seen.extend(arrived.iter().map(|bytes| (micros, bytes[0])));
        }
        assert!(line(rig).conserves_bytes());
        seen
    }

    /// Address, register and two bytes are 4 x 9 + 2 = 38 bit times: 380 us at 100 kHz, 95 us at
    /// 400 kHz.
    #[test]
    fn a_transaction_takes_nine_bit_times_a_byte_and_start_and_stop() {
        let mut slow = joined(LinkKind::I2c, 100_000);
        let write: &[u8] = &[0x40, 3, 1, 2];
        assert_eq!(sent(&mut slow, &[write, write]), [(380, 0x40), (760, 0x40)]);
        let mut fast = joined(LinkKind::I2c, 400_000);
        assert_eq!(sent(&mut fast, &[write]), [(95, 0x40)]);
    }

    /// A transaction without an acknowledge is lost as a whole. A slave that stretches the clock
    /// until 2 ms delays only the transaction that ended at 1140 us.
    #[test]
    fn a_transaction_is_not_acknowledged_or_stretched() {
        let mut rig = joined(LinkKind::I2c, 100_000);
        strike(&mut rig, 1, Damage::Drop);
        let window = Window {
            from: Instant::ZERO + Duration::from_micros(1000),
            until: Instant::ZERO + Duration::from_micros(2000),
        };
        let faults = &mut line(&mut rig).faults;
        faults.add(FaultId(0), Activity::from(window), Effect::Stall);
        let writes: [&[u8]; 3] = [&[1, 0, 0, 0], &[2, 0, 0, 0], &[3, 0, 0, 0]];
        assert_eq!(sent(&mut rig, &writes), [(380, 1), (2000, 3)]);
    }

    /// 100 bytes and 28 of headers are 1024 bits: 1024 us at 1 Mbit/s, then 3 ms of latency. Both
    /// arrive whole: 1400 bytes are 11424 bits.
    #[test]
    fn a_packet_arrives_whole_after_its_time_and_the_latency() {
        let mut rig = joined(LinkKind::Datagram, 1_000_000);
        line(&mut rig).latency = Duration::from_millis(3);
        let (short, long) = ([1; 100], [2; 1400]);
        let seen = sent(&mut rig, &[&short, &long]);
        assert_eq!(seen, [(4024, 1), (1024 + 11_424 + 3000, 2)]);
        let traffic = line(&mut rig).traffic();
        assert_eq!((traffic.sent, traffic.delivered), (1500, 1500));
    }

    /// Packets of 72 bytes take 800 us each. The second is lost, the third comes twice, the fourth
    /// is overtaken by the fifth.
    #[test]
    fn packets_are_lost_doubled_and_overtaken() {
        let mut rig = joined(LinkKind::Datagram, 1_000_000);
        strike(&mut rig, 1, Damage::Drop);
        strike(&mut rig, 2, Damage::Duplicate);
        strike(&mut rig, 3, Damage::Swap);
        let packets = [[1_u8; 72], [2; 72], [3; 72], [4; 72], [5; 72]];
        let packets: Vec<&[u8]> = packets.iter().map(<[u8; 72]>::as_slice).collect();
        let expected = [(800, 1), (2400, 3), (2400, 3), (4000, 5), (4000, 4)];
        assert_eq!(sent(&mut rig, &packets), expected);
        let traffic = line(&mut rig).traffic();
        assert_eq!((traffic.lost, traffic.added), (72, 72));
    }

    /// The second of three messages of 8 bytes, number 1, is duplicated. The first copy carries the
    /// report of the damage.
    #[test]
    fn a_message_that_was_struck_says_so_when_it_arrives() {
        let [left, right] = [LEFT, RIGHT].map(|node| End {
            node,
            port: Port(0),
        });
        let mut line = Line::new(left, right);
        let (byte, damage) = (1, Damage::Duplicate);
        line.faults.add_strike(Strike { byte, damage });
        let (rate, mut now) = (LineConfig::new_8n1(100_000), Instant::ZERO);
        for first in 1..=3 {
            let (kind, budget) = (LinkKind::I2c, &mut Budget::default());
            now = line.take_message(kind, now, rate, budget, &[first; 8]);
        }
        let arrived = core::iter::from_fn(|| line.deliver(now));
        let told = arrived.map(|one| {
            let strikes = one.original.map(|original| original.strikes);
            (one.bytes[0], strikes)
        });
        let struck = Some(vec![Strike { byte, damage }]);
        let expected = [(1, None), (2, struck), (2, None), (3, None)];
        assert_eq!(told.collect::<Vec<_>>(), expected);
    }

    /// Until 500 us packets take 5 ms longer: the first arrives after the second.
    #[test]
    fn a_late_packet_is_overtaken() {
        let mut rig = joined(LinkKind::Datagram, 1_000_000);
        let window = Window {
            from: Instant::ZERO,
            until: Instant::ZERO + Duration::from_micros(500),
        };
        let by = Duration::from_millis(5);
        let faults = &mut line(&mut rig).faults;
        faults.add(FaultId(0), Activity::from(window), Effect::Latency { by });
        let seen = sent(&mut rig, &[&[1; 72], &[2; 72]]);
        assert_eq!(seen, [(1600, 2), (5800, 1)]);
    }

    /// 72 bytes take 800 us. Latency and jitter add up; the jitter is the next number of the
    /// fault's own dice, up to 2 ms.
    #[test]
    fn latency_and_jitter_of_a_packet_add_up() {
        let mut rig = joined(LinkKind::Datagram, 1_000_000);
        let window = Window {
            from: Instant::ZERO,
            until: Instant::ZERO + Duration::from_millis(100),
        };
        let dice = emulators::rng::Rng::stream(3, "jitter");
        let by = Duration::from_millis(2);
        let faults = &mut line(&mut rig).faults;
        let late = Duration::from_millis(5);
        faults.add(
            FaultId(0),
            Activity::from(window),
            Effect::Latency { by: late },
        );
        let rng = Box::new(dice.clone());
        faults.add(
            FaultId(1),
            Activity::from(window),
            Effect::Jitter { by, rng },
        );
        let seen = sent(&mut rig, &[&[1; 72]]);
        let drawn = dice.clone().below(2_000_001);
        assert!(drawn > 0 && seen.len() == 1);
        assert_eq!(seen[0], (800 + 5_000 + drawn.div_ceil(1_000), 1));
    }
    /// A line of that kind, 72 bytes a message.
    fn alone() -> Line {
        let [left, right] = [LEFT, RIGHT].map(|node| End {
            node,
            port: Port(0),
        });
        Line::new(left, right)
    }

    fn take(line: &mut Line, at_us: u64) -> Instant {
        let (start, rate) = (Instant::from_micros(at_us), LineConfig::new_8n1(1_000_000));
        let budget = &mut Budget::default();
        line.take_message(LinkKind::Datagram, start, rate, budget, &[1; 72])
    }

    /// 72 bytes and their headers take 800 us, then 200 us of latency: when they arrive, the line
    /// tells when they were sent.
    #[test]
    fn a_late_message_carries_the_end_of_its_sending() {
        let mut line = alone();
        take(&mut line, 0);
        let at = Instant::from_micros;
        assert!(
            line.deliver(at(800))
                .is_some_and(|one| one.original.is_none())
        );
        line.latency = Duration::from_micros(200);
        take(&mut line, 1000);
        let original = line.deliver(at(2000)).and_then(|one| one.original);
        assert_eq!(original.map(|original| original.at), Some(at(1800)));
    }

    /// The messages of a sender whose line is played from a capture are lost, all of them.
    #[test]
    fn messages_of_a_played_line_count_as_lost() {
        let mut line = alone();
        line.is_played = true;
        assert_eq!(
            [0, 1000].map(|us| take(&mut line, us).as_micros()),
            [800, 1800]
        );
        let traffic = line.traffic();
        assert_eq!(
            (traffic.sent, traffic.lost, line.in_flight()),
            (144, 144, 0)
        );
    }

    /// The time of a fault without a delay is logged with its message. The latencies of the line, 5
    /// us, and of a fault, 20 us, add up; a later message has that of the line only.
    #[test]
    fn a_message_tells_the_faults_that_were_at_work() {
        let mut line = alone();
        let during = |line: &mut Line, from: u64, by: u64| {
            let window = Window {
                from: Instant::from_micros(from),
                until: Instant::from_micros(from + 10),
            };
            let by = Duration::from_micros(by);
            line.faults
                .add(FaultId(0), Activity::from(window), Effect::Latency { by });
        };
        during(&mut line, 0, 0);
        during(&mut line, 1_000, 20);
        take(&mut line, 0);
        line.latency = Duration::from_micros(5);
        take(&mut line, 1_000);
        take(&mut line, 2_000);
        let arrived = core::iter::from_fn(|| line.deliver(Instant::from_millis(9)));
        let told = arrived.map(|one| {
            let original = one.original.expect("a fault, or late");
            (
                one.at.as_micros(),
                original.at.as_micros(),
                original.effects.len(),
            )
        });
        let expected = [(800, 800, 1), (1_825, 1_800, 1), (2_805, 2_800, 0)];
        assert_eq!(told.collect::<Vec<_>>(), expected);
    }

    /// The second message is lost, the third one comes twice: in flight are three of 72 bytes.
    #[test]
    fn messages_in_flight_are_counted_with_their_copies() {
        let mut line = alone();
        for (byte, damage) in [(1, Damage::Drop), (2, Damage::Duplicate)] {
            line.faults.add_strike(Strike { byte, damage });
        }
        let in_flight = [0, 1_000, 2_000].map(|us| {
            take(&mut line, us);
            assert!(line.conserves_bytes());
            line.in_flight()
        });
        assert_eq!(in_flight, [72, 72, 216]);
        let traffic = line.traffic();
        assert_eq!((traffic.sent, traffic.lost, traffic.added), (216, 72, 72));
    }

    /// An I2C bus sends 9 bits a byte and 2 more, a network 8 bits for each byte and 28 of headers.
    /// The others have characters of 10 bits.
    #[test]
    fn each_kind_of_link_has_its_own_time() {
        let rate = LineConfig::new_8n1(1_000_000);
        let micros = |kind, len| message_time(kind, rate, len).as_micros();
        let times = LinkKind::ALL.map(|kind| [0, 1, 10].map(|len| micros(kind, len)));
        let characters = [0, 10, 100];
        let expected = [characters, characters, [2, 11, 92], [224, 232, 304]];
        assert_eq!(times, expected);
    }
}
