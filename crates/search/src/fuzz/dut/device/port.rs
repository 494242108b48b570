//! A real device at a port: one input at a time, at a limited rate, and compared with the emulated
//! device.

use core::time::Duration;
use std::collections::BTreeMap;
use std::sync::Arc;

use description::peer::{Emulated, Heard, Peer};
use description::{Description, conform};
use emulators::rng::Rng;
use protocols::Instant;

use super::super::super::subject::Violation;
use super::inputs::{Input, Inputs};
use super::{Bench, SEED, answers_again, is_damage, parse, to_text};

/// The limits of a search at a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortPlan {
    /// Whether inputs may change the device's state.
    pub writes: bool,
    /// Seed of the inputs.
    pub seed: u64,
    /// Minimum time between two inputs.
    pub gap: Duration,
    /// Extra time for each reply.
    pub slack: Duration,
}

/// The counts of a search at a port.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PortFuzzed {
    /// Inputs that were sent.
    pub inputs: u64,
    /// Inputs that were left out because they may change the device's state.
    pub left_out: u64,
    /// Inputs that the device answered.
    pub answered: u64,
    /// Differences that a second try did not show.
    pub doubtful: u64,
    /// Number of occurrences of each cause.
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

/// Maximum number of inputs that are drawn for one that may be sent.
const DRAWN_MAX: u32 = 2_000;
/// Time for which expected replies may be late.
const LATE_MAX: Duration = Duration::from_secs(1);
/// Time within which a device may start again after an input.
const REVIVAL: Duration = Duration::from_secs(5);

/// A search at a port.
pub struct PortFuzz<'a> {
    description: &'a Arc<Description>,
    device: Bench<'a, &'a mut dyn Peer>,
    twin: Bench<'a, Emulated>,
    plan: PortPlan,
    inputs: Inputs,
    rng: Rng,
    /// A request without an effect, and the kinds of its replies.
    plain: (Vec<u8>, Vec<String>),
    next_at: Instant,
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
        if inputs.is_empty() {
            return Err(format!(
                "{} has no request{}, expected one to fuzz",
                description.name(),
                if plan.writes {
                    ""
                } else {
                    " without an effect (--writes)"
                }
            ));
        }
        let mut device = Bench::new(description, peer)?;
        device.time += plan.slack;
        let mut twin = Bench::new(description, conform::emulated(description, SEED))?;
        for ask in description.asks().iter().filter(|ask| !ask.changes) {
            let request = ask.bytes.clone();
            let [heard, other] = [
                device.say(core::slice::from_ref(&request))?,
                twin.say(core::slice::from_ref(&request))?,
            ];
            let [kinds, described] = [heard, other].map(|heard| description.reply_kinds(&heard));
            if !kinds.is_empty() && !described.is_empty() {
                return Ok(Some(Self {
                    next_at: device.peer.now(),
                    rng: Rng::stream(plan.seed, "port.inputs"),
                    plain: (request, kinds),
                    fuzzed: PortFuzzed::default(),
                    description,
                    device,
                    twin,
                    plan,
                    inputs,
                }));
            }
        }
        Ok(None)
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
        let Some(input) = self.draw() else {
            return Ok(PortStep::Nothing);
        };
        let judged = match self.judge(&input)? {
            Err(first) => match self.judge(&input)? {
                Err(again) if again.cause == first.cause => Err(again),
                _ => {
                    self.fuzzed.doubtful += 1;
                    Ok(())
                }
            },
            sound => sound,
        };
        if let Err(fault) = judged {
            return Ok(self.found(fault, &input));
        }
        let (request, kinds) = &self.plain;
        if answers_again(self.description, &mut self.twin, request, kinds).is_err() {
            return Ok(PortStep::Silent);
        }
        match answers_again(self.description, &mut self.device, request, kinds) {
            Ok(()) => Ok(PortStep::Sound),
            Err(fault) => {
                let step = self.found(fault, &input);
                self.device.wait(REVIVAL)?;
                let (request, kinds) = &self.plain;
                let is_silent =
                    answers_again(self.description, &mut self.device, request, kinds).is_err();
                match step {
                    PortStep::Sound if is_silent => Ok(PortStep::Silent),
                    step => Ok(step),
                }
            }
        }
    }

    /// Sends the inputs in `text` once and judges the replies.
    ///
    /// # Errors
    /// If the port is gone, or the text is wrong.
    pub fn repeat(&mut self, text: &str) -> Result<Result<(), Violation>, String> {
        for input in parse(text)? {
            if !self.plan.writes && !self.description.is_harmless(&input.bytes()) {
                return Err("the input may change the device's state: expected --writes".to_owned());
            }
            if let Err(fault) = self.judge(&input)? {
                return Ok(Err(fault));
            }
            let (request, kinds) = &self.plain;
            let again = answers_again(self.description, &mut self.device, request, kinds);
            if again.is_err() {
                return Ok(again);
            }
        }
        Ok(Ok(()))
    }

    /// An input that may be sent.
    fn draw(&mut self) -> Option<Input> {
        for _ in 0..DRAWN_MAX {
            let input = self.inputs.next(&mut self.rng);
            if input.bytes().is_empty() {
                continue;
            }
            if self.plan.writes || self.description.is_harmless(&input.bytes()) {
                return Some(input);
            }
            self.fuzzed.left_out += 1;
        }
        None
    }

    /// Sends an input to the device and to the emulated one, and compares their replies.
    fn judge(&mut self, input: &Input) -> Result<Result<(), Violation>, String> {
        let now = self.device.peer.now();
        if now < self.next_at {
            self.device.wait(self.next_at - now)?;
        }
        self.next_at = self.device.peer.now() + self.plan.gap;
        self.fuzzed.inputs += 1;
        let bytes = input.bytes();
        let expected = self.twin.say(core::slice::from_ref(&bytes))?;
        let heard = self.ask(&bytes, expected.frames.len())?;
        let [mut kinds, mut expected] =
            [heard, expected].map(|heard| self.description.reply_kinds(&heard));
        self.fuzzed.answered += u64::from(!kinds.is_empty());
        let damage = is_damage(self.description, input, &kinds);
        if damage.is_err() {
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

    /// Sends bytes; a busy host may deliver the `expected` replies late.
    fn ask(&mut self, bytes: &[u8], expected: usize) -> Result<Heard, String> {
        let Bench {
            peer,
            speaker,
            time,
        } = &mut self.device;
        let mut left = expected;
        let mut is_last = |_: &_| {
            left = left.saturating_sub(1);
            left == 0
        };
        let most = if expected == 0 {
            *time
        } else {
            LATE_MAX.max(*time)
        };
        let mut heard = speaker.exchange(peer, bytes, most, &mut is_last)?;
        if expected > 0 {
            let more = speaker.exchange_now(peer, &[], *time, &mut |_| false)?;
            heard.frames.extend(more.frames);
        }
        Ok(heard)
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
