//! Converts the keys of a fault into its effect and times.

use core::time::Duration;

use emulators::rng::Rng;

use super::{FaultKind, FaultPlace, FaultSpec, Flaw};
use crate::rig::fault::{
    Activity, BAUD_MAX, BAUD_MIN, Damage, DamageKind, Effect, FaultId, HostDamage, Rate, Spells,
    Strike, Trigger,
};
use crate::scenario::Span;

/// Default length of a burst, bytes.
const BURST_LEN: u16 = 4;
/// Default maximum length of a truncation, bytes.
const TRUNCATE_LEN: u16 = 4096;
/// Default buffer of a receiver, bytes: a UART without FIFO stores one byte in addition to the
/// arriving one.
const FIFO_LEN: u16 = 2;
/// Longest delay of a byte.
const BY_MAX: Duration = Duration::from_secs(3600);
/// Shortest time from one active period of a fault to the next.
const EVERY_MIN: Duration = Duration::from_micros(100);

impl FaultSpec {
    /// Checks that the kind of fault supports its keys and that none is missing.
    ///
    /// # Errors
    /// The first wrong or missing key.
    pub fn check(&self) -> Result<(), Flaw> {
        let kind = self.kind;
        if let Some(key) = self.given().find(|key| !kind.has(key)) {
            let own = kind.place().keys().iter().chain(kind.own_keys());
            let expected: Vec<&str> = own.copied().collect();
            let message = format!(
                "has no effect on {}, expected {} or a time",
                kind.name(),
                expected.join(", ")
            );
            return Err(Flaw::new(key, message));
        }
        let given = |wanted: &str| self.given().any(|key| key == wanted);
        if let Some(key) = kind.place().keys().iter().find(|key| !given(key)) {
            return Err(Flaw::new(
                key,
                format!("is missing, {} needs it", kind.name()),
            ));
        }
        let idle = [
            (self.len == Some(0), "len", "is 0, expected 1 to 65535"),
            (
                kind == FaultKind::Wrong && self.factor == Some(1.0),
                "factor",
                "is 1, which changes no value, expected another one",
            ),
            (
                kind == FaultKind::Burst && self.value == Some(0),
                "value",
                "is 0, which changes no bit; expected 1 to 255",
            ),
            (
                self.lasting.is_some_and(|lasting| lasting.0.is_zero()),
                "lasting",
                "is 0, expected a longer time",
            ),
            (
                self.devices.as_ref().is_some_and(Vec::is_empty),
                "devices",
                "is empty, expected the names of devices",
            ),
        ];
        match idle.into_iter().find(|(is_idle, ..)| *is_idle) {
            Some((_, key, message)) => Err(Flaw::new(key, message)),
            None => self.check_time(),
        }
    }

    /// Checks that the fault has one end.
    ///
    /// # Errors
    /// If it has two: the earlier one would end it.
    pub(in crate::scenario) fn check_end(&self) -> Result<(), Flaw> {
        match (self.until, self.lasting, self.every) {
            (Some(until), Some(lasting), None) => {
                let message = format!(
                    "is {lasting} beside until = \"{until}\", expected one of them; with every, \
                     lasting is the duration of each repetition"
                );
                Err(Flaw::new("lasting", message))
            }
            _ => Ok(()),
        }
    }

    fn check_time(&self) -> Result<(), Flaw> {
        let name = self.kind.name();
        self.check_end()?;
        if self.window().is_empty() {
            let message = "is not after its start, expected a later time";
            let key = if self.until.is_some() {
                "until"
            } else {
                "lasting"
            };
            return Err(Flaw::new(key, message));
        }
        let events = [
            self.at_byte.is_some(),
            self.at_frame.is_some(),
            self.when.is_some(),
            self.begins_when.is_some(),
        ];
        if events.into_iter().filter(|&given| given).count() > 1 {
            let message = "expected one of at_byte, at_frame, when and begins_when";
            return Err(Flaw::new("when", message));
        }
        if events.contains(&true) && (self.from.is_some() || self.until.is_some()) {
            let message = "is impossible for a fault that waits for an event, expected lasting";
            let key = if self.from.is_some() { "from" } else { "until" };
            return Err(Flaw::new(key, message));
        }
        if (events[0] || events[1]) && !self.is_on_line_only() {
            let message = format!("has no effect on {name}, expected a time or when");
            let key = if events[0] { "at_byte" } else { "at_frame" };
            return Err(Flaw::new(key, message));
        }
        if let Some(when) = &self.when {
            let condition = when.condition()?;
            condition
                .check()
                .map_err(|flaw| Flaw::new("when", flaw.message))?;
        }
        for (key, condition) in self.conditions() {
            let flawed = |flaw: Flaw| Flaw::new(key, format!("{}: {}", flaw.key, flaw.message));
            condition.check().map_err(flawed)?;
        }
        if self.ends_when.is_some() && self.byte.is_some() {
            let message = "has no effect on the damage of one byte, expected a rate or no end";
            return Err(Flaw::new("ends_when", message));
        }
        match (self.every, self.lasting) {
            (Some(every), Some(lasting)) if EVERY_MIN <= every.0 && lasting <= every => {}
            (Some(_), None) => {
                let message = "is missing, every needs it: the duration of each repetition";
                return Err(Flaw::new("lasting", message));
            }
            (Some(every), Some(lasting)) => {
                let least = lasting.max(Span(EVERY_MIN));
                let message = format!("is {every}, expected at least {least}");
                return Err(Flaw::new("every", message));
            }
            (None, _) if matches!(self.kind, FaultKind::Clog | FaultKind::Intermittent) => {
                return Err(Flaw::new("every", format!("is missing, {name} needs it")));
            }
            (None, _) if self.count.is_some() && self.rate.is_none() => {
                let message =
                    "expected a rate or every: it limits their damaged bytes or repetitions";
                return Err(Flaw::new("count", message));
            }
            _ => {}
        }
        Ok(())
    }

    /// Whether the fault is a wrong rate of exactly `baud`, without a deviation.
    pub fn is_at_rate(&self, baud: u32) -> bool {
        let is_zero = |value: Option<f64>| value.is_none_or(|value| value == 0.0);
        self.kind == FaultKind::WrongBaud
            && self.baud == Some(baud)
            && is_zero(self.ppm)
            && is_zero(self.ppm_per_s)
    }

    /// Whether the fault only acts on the bytes of its line.
    pub fn is_on_line_only(&self) -> bool {
        use FaultKind::{Break, Swizzle, Unplugged};
        self.kind.place() == FaultPlace::Line && !matches!(self.kind, Break | Swizzle | Unplugged)
    }

    /// The name of its random stream.
    pub fn dice(&self, id: FaultId) -> String {
        self.stream.clone().unwrap_or_else(|| format!("fault.{id}"))
    }

    /// Times at which the fault is active; `id` and `seed` select its random stream.
    pub fn activity(&self, id: FaultId, seed: u64) -> Activity {
        let spells = self.every.map(|every| Spells {
            every: every.0,
            lasting: self.lasting.unwrap_or_default().0,
            count: if self.rate.is_some() {
                None
            } else {
                self.count
            },
            dice: (self.kind == FaultKind::Clog).then(|| (seed, self.dice(id))),
        });
        let byte = self.at_byte.map(Trigger::Byte);
        Activity {
            window: self.window(),
            spells,
            trigger: byte.or(self.at_frame.map(Trigger::Frame)),
        }
    }

    /// Effect of the fault on the byte that it selects, if it selects one.
    ///
    /// # Errors
    /// If a detail is missing or makes no sense.
    pub fn strike(&self) -> Result<Option<Strike>, Flaw> {
        let Some(byte) = self.byte else {
            return match (self.kind, self.bit) {
                (FaultKind::Flip, Some(_)) => {
                    let message =
                        "has no effect without byte: other flips choose the bit by chance";
                    Err(Flaw::new("bit", message))
                }
                _ => Ok(None),
            };
        };
        if let Some(key) = self
            .given()
            .find(|key| super::kind::TIME_KEYS.contains(key))
        {
            let message = "has no effect on a fault of one byte, expected none";
            return Err(Flaw::new(key, message));
        }
        let damage = match (self.damage()?, self.bit, self.value) {
            (DamageKind::Flip, Some(bit @ 0..8), _) => Damage::Flip { bit },
            (DamageKind::Flip, ..) => {
                return Err(Flaw::new("bit", "a flip of one byte needs its bit, 0 to 7"));
            }
            (DamageKind::Insert, _, Some(value)) => Damage::Insert { value },
            (DamageKind::Insert, ..) => {
                return Err(Flaw::new(
                    "value",
                    "an insertion at one byte needs its value",
                ));
            }
            (DamageKind::Burst { .. }, _, Some(0)) => {
                return Err(Flaw::new(
                    "value",
                    "is 0, which changes no bit; expected 1 to 255",
                ));
            }
            (DamageKind::Burst { len }, _, mask) => Damage::Burst {
                len,
                mask: mask.unwrap_or(0xFF),
            },
            (DamageKind::Drop, ..) => Damage::Drop,
            (DamageKind::Duplicate, ..) => Damage::Duplicate,
            (DamageKind::Truncate { len }, ..) => Damage::Truncate { len },
            (DamageKind::Swap, ..) => Damage::Swap,
            (DamageKind::ParityError, ..) => Damage::ParityError,
            (DamageKind::Idle { by }, ..) => Damage::Idle { by },
        };
        Ok(Some(Strike { byte, damage }))
    }

    fn damage(&self) -> Result<DamageKind, Flaw> {
        let len = |or: u16| match self.len.unwrap_or(or) {
            0 => Err(Flaw::new("len", "is 0, expected 1 to 65535 bytes")),
            len => Ok(len),
        };
        Ok(match self.kind {
            FaultKind::Flip => DamageKind::Flip,
            FaultKind::Insert => DamageKind::Insert,
            FaultKind::Duplicate => DamageKind::Duplicate,
            FaultKind::Burst => DamageKind::Burst {
                len: len(BURST_LEN)?,
            },
            FaultKind::Truncate => DamageKind::Truncate {
                len: len(TRUNCATE_LEN)?,
            },
            FaultKind::Swap => DamageKind::Swap,
            FaultKind::ParityError => DamageKind::ParityError,
            FaultKind::Idle => DamageKind::Idle {
                by: self.needed_by()?,
            },
            _ => DamageKind::Drop,
        })
    }

    fn needed_by(&self) -> Result<Duration, Flaw> {
        match self.by {
            Some(Span(by)) if by <= BY_MAX => Ok(by),
            Some(by) => {
                let message = format!("is {by}, expected at most an hour");
                Err(Flaw::new("by", message))
            }
            None => {
                let message = format!("is missing, {} needs a time", self.kind.name());
                Err(Flaw::new("by", message))
            }
        }
    }

    /// Effect of the fault on the line, except on one selected byte; `id` and `seed` choose its
    /// random stream.
    ///
    /// # Errors
    /// If a key is missing or out of range.
    pub fn effect(&self, id: FaultId, seed: u64) -> Result<Option<Effect>, Flaw> {
        let rng = || Box::new(Rng::stream(seed, &self.dice(id)));
        let effect = match self.kind {
            kind if kind.is_strike() => match (self.rate, self.byte) {
                (Some(chance), None) if (0.0..=1.0).contains(&chance) => Effect::Strikes {
                    kind: self.damage()?,
                    chance,
                    left: self.count,
                    rng: rng(),
                },
                (Some(chance), None) => {
                    let message = format!("is {chance}, expected a chance per byte from 0 to 1");
                    return Err(Flaw::new("rate", message));
                }
                (None, Some(_)) => return Ok(None),
                _ => {
                    let message = "expected either a rate or the number of a byte";
                    return Err(Flaw::new("rate", message));
                }
            },
            FaultKind::StripNul => Effect::Host(HostDamage::StripNul),
            FaultKind::CrToLf => Effect::Host(HostDamage::CrToLf),
            FaultKind::EatXonXoff => Effect::Host(HostDamage::EatXonXoff),
            FaultKind::ClearBit7 => Effect::Host(HostDamage::ClearBit7),
            FaultKind::Echo => Effect::Echo,
            FaultKind::Cut | FaultKind::Unplugged | FaultKind::Break => Effect::Cut,
            FaultKind::Stall | FaultKind::Clog => Effect::Stall,
            FaultKind::Overrun => Effect::Overrun {
                fifo: self.fifo.unwrap_or(FIFO_LEN).into(),
            },
            FaultKind::ShortRead => Effect::ShortRead {
                len: self.len.unwrap_or(1).max(1).into(),
            },
            FaultKind::Latency | FaultKind::Delayed => Effect::Latency {
                by: self.needed_by()?,
            },
            FaultKind::Jitter => Effect::Jitter {
                by: self.needed_by()?,
                rng: rng(),
            },
            FaultKind::WrongBaud => Effect::WrongBaud(self.wrong_rate()?),
            _ => return Ok(None),
        };
        Ok(Some(effect))
    }

    fn wrong_rate(&self) -> Result<Rate, Flaw> {
        let finite = |key, value: Option<f64>| match value.unwrap_or(0.0) {
            value if value.abs() <= 1e6 => Ok(value),
            value => {
                let message = format!("is {value}, expected -1000000 to 1000000");
                Err(Flaw::new(key, message))
            }
        };
        let rate = Rate {
            baud: self.baud,
            ppm: finite("ppm", self.ppm)?,
            ppm_per_s: finite("ppm_per_s", self.ppm_per_s)?,
        };
        match self.baud {
            Some(baud) if !(BAUD_MIN..=BAUD_MAX).contains(&baud) => {
                let message = format!("is {baud}, expected {BAUD_MIN} to {BAUD_MAX}");
                Err(Flaw::new("baud", message))
            }
            None if self.ppm.is_none() && self.ppm_per_s.is_none() => Err(Flaw::new(
                "baud",
                "is missing, expected baud, ppm or ppm_per_s",
            )),
            None if rate.ppm == 0.0 && rate.ppm_per_s == 0.0 => Err(Flaw::new(
                "ppm",
                "is 0, which changes no rate, expected another value",
            )),
            _ => Ok(rate),
        }
    }
}
