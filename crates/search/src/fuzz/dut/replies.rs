//! Replies to the requests of a program in a conversation: of the described device, recorded ones,
//! and recorded ones with the fields that the request determines, such as a counter.

use std::collections::BTreeMap;
use std::sync::Arc;

use description::peer::{Emulated, Peer as _, Speaker};
use description::{Described, Description, From, Place};
use protocols::{Decode as _, Instant};

use super::case::{Damage, Exchange, Hex, Raw, Turn};
use super::harness::Harness;
use super::learn::Lesson;

/// Seed of the described device.
const SEED: u64 = 1;
/// Maximum number of steps of the device between two requests.
const STEPS_MAX: u32 = 100_000;

/// A reply of the device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Reply {
    pub(super) bytes: Vec<u8>,
    /// Whether an intact device replies the same to the request.
    pub(super) is_own: bool,
}

/// The replies of a conversation.
pub(super) struct Replies<'a> {
    raw: &'a Raw,
    lesson: Option<Arc<Lesson>>,
    /// The described devices on the wire.
    devices: Vec<(Arc<Description>, Emulated)>,
    /// The messages in the recorded requests, if a device describes them.
    kinds: Vec<Option<Vec<String>>>,
    /// Number of uses of each recorded request.
    used: BTreeMap<Vec<u8>, usize>,
    /// The requests so far with their own replies.
    pub(super) made: Vec<Exchange>,
}

impl<'a> Replies<'a> {
    /// The replies to the program of `harness` in the conversation `raw`.
    pub(super) fn new(harness: &Harness<'_>, raw: &'a Raw) -> Self {
        Self::with(raw, harness.lessons.borrow().get(&raw.link).cloned())
    }

    fn with(raw: &'a Raw, lesson: Option<Arc<Lesson>>) -> Self {
        let described = lesson.as_ref().map_or(&[][..], |lesson| lesson.described());
        let is_alone = described.len() < 2;
        let device = |of: &Arc<Description>| (of.clone(), emulated(of, is_alone));
        let all = raw.exchange.iter();
        let kinds = all.map(|one| requests(described, &one.request.0));
        Self {
            kinds: kinds.collect(),
            raw,
            devices: described.iter().map(device).collect(),
            lesson: lesson.clone(),
            used: BTreeMap::new(),
            made: Vec::new(),
        }
    }

    /// The reply to `request` at `now`, which is empty for a request without a reply; `None`: no
    /// reply is known.
    pub(super) fn reply(&mut self, request: &[u8], now: Instant) -> Option<Reply> {
        let own = self
            .of_device(request, now)
            .or_else(|| self.recorded(request))
            .or_else(|| self.lesson.as_ref()?.fitted(request));
        if let Some(bytes) = own {
            self.made.push(Exchange {
                request: Hex(request.to_vec()),
                reply: Hex(bytes.clone()),
            });
            let is_own = true;
            return Some(Reply { bytes, is_own });
        }
        let like = matching(&self.raw.exchange, request)?;
        let (bytes, is_own) = (like.reply.0.clone(), false);
        Some(Reply { bytes, is_own })
    }

    /// The reply of the described devices; `None` if there is none, or if none of them knows the
    /// request.
    fn of_device(&mut self, request: &[u8], now: Instant) -> Option<Vec<u8>> {
        let (mut reply, mut is_known) = (Vec::new(), false);
        // Each device on the wire gets the request, and at most the addressed one replies.
        for (of, device) in &mut self.devices {
            if now > device.now() {
                device.pass(now - device.now(), STEPS_MAX);
            }
            let time = of.reply_time();
            let heard = Speaker::new(of).exchange_now(device, request, time, &mut |_| false);
            let Ok(heard) = heard else { continue };
            let frames = heard.frames.iter().map(|(_, frame)| frame);
            let frames = frames.filter(|frame| !of.is_unasked(frame));
            reply.extend(frames.flat_map(|frame| frame.bytes.to_vec()));
            is_known |= requests(core::slice::from_ref(of), request).is_some();
        }
        (is_known || !reply.is_empty()).then_some(reply)
    }

    /// The next recorded reply to exactly this request; the last one repeats.
    fn recorded(&mut self, request: &[u8]) -> Option<Vec<u8>> {
        let all = self.raw.exchange.iter();
        let all: Vec<_> = all.filter(|one| one.request.0 == request).collect();
        let last = all.len().checked_sub(1)?;
        let used = self.used.entry(request.to_vec()).or_default();
        let one = all[last.min(*used)];
        *used += 1;
        Some(one.reply.0.clone())
    }

    /// Whether `request` was recorded.
    pub(super) fn is_recorded(&self, request: &[u8]) -> bool {
        self.raw.exchange.iter().any(|one| one.request.0 == request)
    }

    /// `reply` with a wrong checksum, see [`Lesson::damaged`].
    pub(super) fn damaged(&self, seed: u32, reply: &[u8]) -> Option<Vec<u8>> {
        self.lesson.as_ref()?.damaged(seed, reply)
    }

    /// The recorded requests of the same kind as `request`.
    pub(super) fn alike(&self, request: &[u8]) -> Vec<&'a Hex> {
        let all = self.raw.exchange.iter().map(|one| &one.request);
        let lesson = self.lesson.as_ref();
        let described = lesson.map_or(&[][..], |lesson| lesson.described());
        if let Some(kind) = requests(described, request) {
            let kinds = all.zip(&self.kinds);
            let alike = kinds.filter(|(_, other)| other.as_ref() == Some(&kind));
            return alike.map(|(other, _)| other).collect();
        }
        let is_like = |other: &[u8]| lesson.is_some_and(|lesson| lesson.is_like(other, request));
        let alike = all.filter(|other| other.0 == request || is_like(&other.0));
        let alike: Vec<_> = alike.collect();
        match (alike.is_empty(), matching(&self.raw.exchange, request)) {
            (true, Some(like)) => vec![&like.request],
            _ => alike,
        }
    }

    /// `turn` in place of `reply` to `request`: its change applied to this reply.
    pub(super) fn changed(&self, turn: &Turn, request: &[u8], reply: Option<&Reply>) -> Turn {
        let is_exact = turn.to.as_ref().is_some_and(|to| to.0 == request);
        if turn.to.is_none() || is_exact && self.devices.is_empty() {
            return turn.clone();
        }
        let is_own = reply.is_some_and(|reply| reply.is_own);
        let to = Some(Hex(request.to_vec()));
        match (turn.seed, &self.lesson, reply) {
            (Some(seed), Some(lesson), Some(reply)) => {
                let turn = lesson.changed(seed, &reply.bytes);
                let is_altered = turn.is_altered || !is_own;
                Turn {
                    to,
                    is_altered,
                    ..turn
                }
            }
            _ => Turn {
                is_altered: turn.is_altered || !is_exact,
                to,
                ..turn.clone()
            },
        }
    }
}

/// A described device, alone on its wire or beside others.
fn emulated(of: &Arc<Description>, is_alone: bool) -> Emulated {
    let place = Place {
        name: of.name().to_owned(),
        seed: SEED,
        address: None,
        is_alone,
    };
    Emulated::new(Box::new(Described::new(of.clone(), place)), Described::UART)
}

/// The names of the messages in a request, by the first description with which it holds any and
/// nothing else.
fn requests(described: &[Arc<Description>], request: &[u8]) -> Option<Vec<String>> {
    described.iter().find_map(|of| requests_of(of, request))
}

fn requests_of(of: &Description, request: &[u8]) -> Option<Vec<String>> {
    let mut cutter = of.cutter_of(From::Host);
    let mut found: Vec<_> = cutter.push(request).collect();
    cutter.idle();
    found.extend(cutter.push(&[]));
    let found: Result<Vec<_>, _> = found.into_iter().collect();
    let found = found.ok().filter(|found| !found.is_empty())?;
    let name = |frame| {
        let (message, _) = of.message(frame, From::Host)?;
        Some(message.name().to_owned())
    };
    found.iter().map(name).collect()
}

/// The conversation as it was held, for a repetition.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Held {
    /// The turns that were sent.
    pub turns: Vec<Turn>,
    /// The requests with their own replies.
    pub exchanges: Vec<Exchange>,
    /// The experiment with damaged replies.
    pub damage: Option<Damage>,
}

impl Held {
    /// `raw` with the turns and replies of this conversation. If it had no turn, the turns of `raw`
    /// stay: a case without turns would not wait for requests of the program.
    pub(super) fn of(&self, raw: &Raw) -> Raw {
        let is_made =
            |one: &&Exchange| !self.exchanges.iter().any(|new| new.request == one.request);
        let others = raw.exchange.iter().filter(is_made).cloned();
        let mut exchange: Vec<Exchange> = Vec::new();
        for one in &self.exchanges {
            let known = self.exchanges.iter();
            let mut known = known.filter(|other| other.request == one.request);
            let is_same = known.all(|other| other.reply == one.reply);
            if !(is_same && exchange.contains(one)) {
                exchange.push(one.clone());
            }
        }
        exchange.extend(others);
        let turn = match self.turns.is_empty() {
            true => raw.turn.clone(),
            false => self.turns.clone(),
        };
        Raw {
            turn,
            exchange,
            damage: self.damage.clone().or_else(|| raw.damage.clone()),
            ..raw.clone()
        }
    }
}

/// Maximum length of the prefix by which an unknown request is matched with a known one.
const PREFIX_MAX: usize = 16;

/// The exchange with the request `request`, or with the longest common prefix.
pub(super) fn matching<'a>(exchanges: &'a [Exchange], request: &[u8]) -> Option<&'a Exchange> {
    let shared = |one: &Exchange| {
        let pairs = one.request.0.iter().zip(request).take(PREFIX_MAX);
        pairs.take_while(|(known, heard)| known == heard).count()
    };
    let same = exchanges.iter().find(|one| one.request.0 == request);
    let like = || {
        let all = exchanges.iter().filter(|one| shared(one) > 0);
        // The first of the exchanges with the longest prefix.
        all.rev().max_by_key(|one| shared(one))
    };
    same.or_else(like)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fuzz::dut::constants::Constants;
    use crate::learn::{DescribedFormat, FrameFormat, Gathered, Spoken};

    /// A device that repeats the counter of a request; the sums are worked out by hand.
    const DEVICE: &str = r#"
        name = "counter"
        about = "x"
        latency = "5ms"
        line = { baud = 9600 }
        frame = { sync = [0x55], size = 4, checksum = "sum8" }
        message = [
          { name = "ask", from = "host", fields = [{ type = "u8", value = 1 }, { name = "tag", type = "u8" }] },
          { name = "stop", from = "host", fields = [{ type = "u8", value = 2 }, { name = "tag", type = "u8" }] },
          { name = "answer", from = "device", fields = [{ type = "u8", value = 0x81 }, { name = "tag", type = "u8" }] },
        ]
        on = [{ message = "ask", reply = "answer" }]
        "#;

    /// A request with another counter than the recorded one gets its own reply, intact or changed;
    /// a request without a reply gets none; an unknown one gets that of the most similar one.
    #[test]
    fn a_described_device_replies_to_requests_that_were_not_recorded() {
        let of = Description::parse("counter", DEVICE, &|_| Err(String::new())).expect("sound");
        let (asked, told) = ([0x55, 1, 1, 0x57], [0x55, 0x81, 1, 0xD7]);
        let mut gathered = Gathered::default();
        let spoken = |is_program, at, bytes: &[u8]| Spoken {
            is_program,
            at,
            bytes: bytes.to_vec(),
        };
        gathered.conversation(&[spoken(true, 0, &asked), spoken(false, 10_000_000, &told)]);
        let seeds = gathered.learned(Some(DescribedFormat::of(&of)));
        let lesson = Lesson::with(seeds, vec![of], Constants::default());
        let raw = Raw {
            exchange: lesson.exchanges(),
            ..Raw::default()
        };
        let lesson = Arc::new(lesson);
        let mut replies = Replies::with(&raw, Some(lesson.clone()));
        let mut now = Instant::from_secs(5);
        let mut reply = |request: &[u8]| {
            now += core::time::Duration::from_secs(1);
            replies.reply(request, now)
        };
        let own = |bytes: &[u8]| Reply {
            bytes: bytes.to_vec(),
            is_own: true,
        };
        let later = [0x55, 1, 7, 0x5D];
        let expected = own(&[0x55, 0x81, 7, 0xDD]);
        assert_eq!(reply(&later), Some(expected.clone()));
        assert_eq!(reply(&[0x55, 2, 7, 0x5E]), Some(own(&[])));
        let other = reply(&[0x55, 9, 7, 0x65]).expect("the similar one's");
        assert_eq!((&*other.bytes, other.is_own), (&told[..], false));
        assert_eq!(replies.alike(&later), [&Hex(asked.to_vec())]);
        assert!(replies.alike(&[0x55, 2, 7, 0x5E]).is_empty());
        let damaged = |seed| replies.damaged(seed, &told).expect("it has a checksum");
        for damaged in (0..20).map(damaged) {
            let wrong = told
                .iter()
                .zip(&damaged)
                .filter(|(one, other)| one != other);
            assert_eq!(
                (damaged.len(), wrong.count()),
                (told.len(), 1),
                "{damaged:?}"
            );
        }
        assert_eq!(replies.damaged(0, &[]), None);
        let turn = Turn {
            to: Some(Hex(asked.to_vec())),
            ..lesson.changed(3, &told)
        };
        let changed = replies.changed(&turn, &later, Some(&expected));
        assert_eq!(changed.say, lesson.changed(3, &expected.bytes).say);
        assert_eq!(changed.to, Some(Hex(later.to_vec())));
        // A repetition has the recorded conversation alone.
        let held = Held {
            turns: vec![changed],
            exchanges: replies.made.clone(),
            damage: None,
        };
        let raw = held.of(&raw);
        assert_eq!(Held::default().of(&raw).turn, raw.turn);
        let mut again = Replies::with(&raw, None);
        assert_eq!(again.reply(&later, now), Some(expected));
        assert_eq!(again.alike(&later), [&Hex(later.to_vec())]);
    }

    /// Two devices of one description on a wire, at addresses 1 and 2; both take address 0, and no
    /// one replies to it. Each replies with its address; the sums are worked out by hand.
    #[test]
    fn the_addressed_one_of_several_devices_replies() {
        let text = DEVICE
            .replace("baud = 9600", "baud = 9600, address = 1")
            .replace(
                "on = [{ message = \"ask\", reply = \"answer\" }]",
                "on = [{ message = \"ask\", when = \"tag == own_address\", reply = \"answer\" }]",
            );
        let of = Description::parse("counter", &text, &|_| Err(String::new())).expect("sound");
        let other = of.with_address(2).expect("it has an address");
        let described = vec![of, other];
        let format = DescribedFormat::of_wire(&described, From::Device).expect("devices");
        assert_eq!(FrameFormat::in_words(&format), "as counter is described");
        let seeds = Gathered::default().learned(Some(format));
        let lesson = Lesson::with(seeds, described, Constants::default());
        let raw = Raw::default();
        let mut replies = Replies::with(&raw, Some(Arc::new(lesson)));
        let mut now = Instant::from_secs(5);
        let mut reply = |request: &[u8]| {
            now += core::time::Duration::from_secs(1);
            replies.reply(request, now).map(|reply| reply.bytes)
        };
        assert_eq!(reply(&[0x55, 1, 1, 0x57]), Some(vec![0x55, 0x81, 1, 0xD7]));
        assert_eq!(reply(&[0x55, 1, 2, 0x58]), Some(vec![0x55, 0x81, 2, 0xD8]));
        assert_eq!(reply(&[0x55, 1, 0, 0x56]), Some(Vec::new()));
        assert_eq!(reply(&[0x55, 9, 0, 0x5E]), None);
    }
}
