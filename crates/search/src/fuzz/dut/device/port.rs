//! A real device at a port: one input at a time, at a limited rate, and compared with the emulated
//! device.

use core::time::Duration;
use std::collections::BTreeMap;
use std::sync::Arc;

use description::peer::{Emulated, Heard, Peer};
use description::{Description, conform};
use emulators::rng::Rng;

use super::super::super::subject::Violation;
use super::inputs::{Input, Inputs};
use super::{Bench, SEED, answers_again, can_reply, holds_frame, is_damage, parse, to_text};

/// The limits of a search at a port, and the results of earlier runs of it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PortPlan {
    /// Whether inputs may change the device's state.
    pub writes: bool,
    /// Seed of the inputs.
    pub seed: u64,
    /// Minimum time between two inputs, and between the requests before and after them.
    pub gap: Duration,
    /// Extra time for each reply.
    pub slack: Duration,
    /// Number of inputs of earlier runs.
    pub done: u64,
    /// Causes of earlier runs, with the numbers of their occurrences.
    pub known: BTreeMap<String, u64>,
}

/// The counts of a search at a port.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PortFuzzed {
    /// Inputs that were sent, also in earlier runs.
    pub inputs: u64,
    /// Inputs that were left out because they may change the device's state.
    pub left_out: u64,
    /// Inputs that were left out because another device on the line would answer.
    pub for_others: u64,
    /// Inputs that the device answered.
    pub answered: u64,
    /// Differences that a second try did not show.
    pub doubtful: u64,
    /// Number of occurrences of each cause, also in earlier runs.
    pub causes: BTreeMap<String, u64>,
}

/// The result of one input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PortStep {
    /// No law was broken, or only a known one.
    Sound,
    /// A law was broken in a new way, by the inputs in this text.
    Found(Violation, String),
    /// The device does not answer any more.
    Silent,
    /// No input without an effect could be made.
    Nothing,
}

/// Maximum number of requests that are tried before the first input.
const ASKED_MAX: usize = 50;
/// Maximum number of inputs that are drawn for one that may be sent.
const DRAWN_MAX: u32 = 2_000;
/// Times for which expected replies may be late, one for each try of an input. On a busy computer
/// the program at a pseudo-terminal, or the driver of an adapter, can stand for seconds.
const LATE: [Duration; 3] = [
    Duration::from_secs(1),
    Duration::from_secs(3),
    Duration::from_secs(9),
];
/// Number of the first requests whose replies may be late.
const PATIENT: usize = 5;
/// Time within which a device may start again after an input.
const REVIVAL: Duration = Duration::from_secs(5);

/// A request without an effect.
struct Plain {
    request: Vec<u8>,
    /// The kinds of the device's replies.
    kinds: Vec<String>,
    /// The kinds of the replies of the emulated device.
    described: Vec<String>,
}

/// A search at a port.
pub struct PortFuzz<'a> {
    description: &'a Arc<Description>,
    device: Bench<'a, &'a mut dyn Peer>,
    twin: Bench<'a, Emulated>,
    plan: PortPlan,
    inputs: Inputs,
    rng: Rng,
    plain: Plain,
    /// Requests with another reply than described, which are judged first.
    first: Vec<Input>,
    /// Whether no input so far had an effect.
    is_unchanged: bool,
    /// Whether the device does not answer any more.
    is_silent: bool,
    fuzzed: PortFuzzed,
}

impl<'a> PortFuzz<'a> {
    /// A search with the device `peer`; `None` if it answers none of the described requests that
    /// have no effect.
    ///
    /// # Errors
    /// If the port is gone, or the description has no request.
    pub fn new(
        description: &'a Arc<Description>,
        peer: &'a mut dyn Peer,
        plan: PortPlan,
    ) -> Result<Option<Self>, String> {
        let inputs = Inputs::of(description, plan.writes);
        let mut asks = description.asks();
        can_reply(description, asks.len())?;
        asks.retain(|ask| !ask.changes && description.is_harmless(&ask.bytes));
        if inputs.is_empty() || asks.is_empty() {
            let name = description.name();
            return Err(format!(
                "{name} has no request without an effect, expected one to observe the device"
            ));
        }
        // The others hold bytes that a device behind damaged ones could take for a write.
        asks.sort_by_key(|ask| !description.may_follow_damage(&ask.bytes));
        let mut device = Bench::new(description, peer)?;
        device.time += plan.slack;
        device.gap = plan.gap;
        let mut twin = Bench::new(description, conform::emulated(description, SEED))?;
        let (mut plain, mut first) = (None, Vec::new());
        for (number, ask) in asks.into_iter().take(ASKED_MAX).enumerate() {
            let input = Input::request(ask.bytes);
            let expected = twin.say(&input.pieces)?;
            let late = match number < PATIENT {
                true => LATE[0],
                false => device.time,
            };
            let count = description.reply_kinds(&expected).len();
            let heard = device.ask(description, &input.bytes(), (count, late))?;
            let heard = [heard, expected];
            let [mut kinds, mut described] = heard.map(|heard| description.reply_kinds(&heard));
            kinds.sort();
            described.sort();
            if kinds.is_empty() || described.is_empty() {
                continue;
            }
            let is_described = kinds == described;
            let request = input.bytes();
            if !is_described {
                first.push(input);
            }
            if is_described || plain.is_none() {
                plain = Some(Plain {
                    request,
                    kinds,
                    described,
                });
            }
            if is_described {
                break;
            }
        }
        // A later run sends other inputs than the earlier ones.
        let inputs_of_run = match plan.done {
            0 => "port.inputs".to_owned(),
            done => format!("port.inputs.{done}"),
        };
        Ok(plain.map(|plain| Self {
            rng: Rng::stream(plan.seed, &inputs_of_run),
            fuzzed: PortFuzzed {
                inputs: plan.done,
                causes: plan.known.clone(),
                ..PortFuzzed::default()
            },
            is_unchanged: true,
            is_silent: false,
            description,
            device,
            twin,
            plan,
            inputs,
            plain,
            first,
        }))
    }

    /// The counts so far.
    pub const fn fuzzed(&self) -> &PortFuzzed {
        &self.fuzzed
    }

    /// Sends the next input.
    ///
    /// # Errors
    /// If the port is gone.
    pub fn step(&mut self) -> Result<PortStep, String> {
        if self.is_silent {
            return Ok(PortStep::Silent);
        }
        let next = self.first.pop().or_else(|| self.draw());
        let Some(input) = next else {
            return Ok(PortStep::Nothing);
        };
        self.is_unchanged &= self.description.is_harmless(&input.bytes());
        let judged = self.confirmed(&input)?;
        self.settle()?;
        let again = self.answers_again();
        if again.is_err() {
            self.device.wait(REVIVAL)?;
            self.is_silent = self.answers_again().is_err();
        }
        // After an input with an effect, for example on its address, it need not answer.
        let again = again.or_else(|fault| match self.is_unchanged {
            true => Err(fault),
            false => Ok(()),
        });
        // A device that hangs replies nothing else either: the first law says why.
        Ok(match again.and(judged) {
            Err(fault) => self.found(fault, &input),
            Ok(()) if self.is_silent => PortStep::Silent,
            Ok(()) => PortStep::Sound,
        })
    }

    /// After an input with an effect: lets both devices start again, and replaces the emulated one
    /// if it is in a state in which it does not answer.
    fn settle(&mut self) -> Result<(), String> {
        if self.is_unchanged {
            return Ok(());
        }
        let boot = self.description.boot_time();
        self.device.wait(boot)?;
        self.twin.wait(boot)?;
        let Plain {
            request, described, ..
        } = &self.plain;
        if answers_again(self.description, &mut self.twin, request, described).is_err() {
            let new = conform::emulated(self.description, SEED);
            self.twin = Bench::new(self.description, new)?;
        }
        Ok(())
    }

    /// Judges an input, up to three times. Only a difference that each try shows is one.
    fn confirmed(&mut self, input: &Input) -> Result<Result<(), Violation>, String> {
        let mut first: Option<Violation> = None;
        for late in LATE {
            match (self.judge(input, late)?, &first) {
                (Ok(()), None) => return Ok(Ok(())),
                (Err(fault), None) => first = Some(fault),
                (Err(fault), Some(first)) if fault.cause == first.cause => {}
                _ => {
                    self.fuzzed.doubtful += 1;
                    return Ok(Ok(()));
                }
            }
            // A reply that comes still later must not count for the next try.
            self.device.wait(late)?;
            self.settle()?;
        }
        Ok(first.map_or(Ok(()), Err))
    }

    /// One of three requests is answered as usual.
    fn answers_again(&mut self) -> Result<(), Violation> {
        let Plain { request, kinds, .. } = &self.plain;
        let broken = |error: String| Violation::new("device-works", error);
        for late in LATE {
            let of = self.description;
            let heard = self.device.ask(of, request, (kinds.len(), late));
            let found = self.description.reply_kinds(&heard.map_err(broken)?);
            if kinds.iter().all(|kind| found.contains(kind)) {
                return Ok(());
            }
            self.device.wait(late).map_err(broken)?;
        }
        let detail = format!(
            "it does not answer {} requests {request:02X?} with {}",
            LATE.len(),
            kinds.join(", ")
        );
        Err(Violation::new("answers-again", detail))
    }

    /// Sends the inputs in `text` and judges the replies.
    ///
    /// # Errors
    /// If the port is gone, or the text is wrong.
    pub fn repeat(&mut self, text: &str) -> Result<Result<(), Violation>, String> {
        for input in parse(text)? {
            let bytes = input.bytes();
            if !self.plan.writes && !self.is_harmless(&bytes) {
                return Err("the input may change the device's state: expected --writes".to_owned());
            }
            self.is_unchanged &= self.description.is_harmless(&bytes);
            if let Err(fault) = self.confirmed(&input)? {
                return Ok(Err(fault));
            }
            self.settle()?;
            let again = self.answers_again();
            if again.is_err() {
                return Ok(again);
            }
        }
        Ok(Ok(()))
    }

    /// Whether an input and the requests behind it have no effect.
    fn is_harmless(&self, bytes: &[u8]) -> bool {
        self.description
            .is_harmless_before(bytes, &self.plain.request)
    }

    /// An input that may be sent.
    fn draw(&mut self) -> Option<Input> {
        for _ in 0..DRAWN_MAX {
            let input = self.inputs.next(&mut self.rng);
            let bytes = input.bytes();
            if bytes.is_empty() {
                continue;
            }
            if self.description.is_for_others(&bytes) {
                self.fuzzed.for_others += 1;
            } else if self.plan.writes || self.is_harmless(&bytes) {
                return Some(input);
            } else {
                self.fuzzed.left_out += 1;
            }
        }
        None
    }

    /// Sends an input to the device and to the emulated one, and compares their replies.
    fn judge(&mut self, input: &Input, late: Duration) -> Result<Result<(), Violation>, String> {
        self.fuzzed.inputs += 1;
        let bytes = input.bytes();
        let expected = self.twin.say(core::slice::from_ref(&bytes))?;
        let mut expected = self.description.reply_kinds(&expected);
        let (of, count) = (self.description, expected.len());
        let heard = self.device.ask(of, &bytes, (count, late))?;
        let mut kinds = of.reply_kinds(&heard);
        self.fuzzed.answered += u64::from(!kinds.is_empty());
        let damage = is_damage(self.description, input, &kinds);
        // Some devices find frames by their length where a silence should separate them.
        let is_open = self.description.ends_with_silence()
            && self.description.whole(&bytes).is_err()
            && holds_frame(self.description, &input.pieces);
        if damage.is_err() || is_open {
            return Ok(damage);
        }
        kinds.sort();
        expected.sort();
        if kinds == expected {
            return Ok(Ok(()));
        }
        let told = |kinds: &[String]| match kinds {
            [] => "nothing".to_owned(),
            kinds => kinds.join(", "),
        };
        let (found, wanted) = (told(&kinds), told(&expected));
        Ok(Err(Violation::new(
            format!("replies-as-described: {found} instead of {wanted}"),
            format!(
                "after \"{}\" it replies {found}, expected {wanted}",
                input.kind
            ),
        )))
    }

    fn found(&mut self, fault: Violation, input: &Input) -> PortStep {
        let count = self.fuzzed.causes.entry(fault.cause.clone()).or_default();
        *count += 1;
        match *count {
            1 => PortStep::Found(fault, to_text(core::slice::from_ref(input))),
            _ => PortStep::Sound,
        }
    }
}

impl<P: Peer> Bench<'_, P> {
    /// Sends bytes and receives replies, of which the `expected` ones may be `late`.
    fn ask(
        &mut self,
        of: &Description,
        bytes: &[u8],
        (expected, late): (usize, Duration),
    ) -> Result<Heard, String> {
        self.pace()?;
        let (speaker, peer) = (&mut self.speaker, &mut self.peer);
        if expected == 0 {
            return speaker.exchange(peer, bytes, self.time, &mut |_| false);
        }
        let mut left = expected;
        let mut is_last = |frame: &_| {
            left = left.saturating_sub(usize::from(!of.is_unasked(frame)));
            left == 0
        };
        let most = late.max(self.time);
        let mut heard = speaker.exchange(peer, bytes, most, &mut is_last)?;
        let more = speaker.exchange_now(peer, &[], self.time, &mut |_| false)?;
        heard.frames.extend(more.frames);
        Ok(heard)
    }
}
