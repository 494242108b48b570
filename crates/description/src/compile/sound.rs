//! Checks of a whole description: the device can answer, and its messages are distinguishable.

use super::Compiler;
use crate::behaviour::Trigger;
use crate::description::Description;
use crate::expr::{Expr, Nothing};
use crate::field::{self, Field, Kind, Size};
use crate::framing::Framing;
use crate::message::Message;
use crate::schema::message::From;
use crate::value::Record;

/// Number of examples that are used to distinguish messages.
const EXAMPLES: u64 = 12;

impl Compiler<'_> {
    /// Records errors in the description as a whole.
    pub(super) fn check(&mut self, description: &Description) {
        self.check_that_it_acts(description);
        self.check_messages(description);
    }

    fn check_that_it_acts(&mut self, description: &Description) {
        if description.protocol.is_some() || description.program.is_some() {
            return;
        }
        let acts = !description.on.is_empty()
            || !description.every.is_empty()
            || !description.after.is_empty();
        if !acts {
            let message = "the device can never answer, expected [[on]], [[every]], [[after]] or \
                [program]";
            self.wrong("name", message);
        }
        // Later entries never see the messages of a catch-all entry.
        let mut taken: Vec<Trigger> = Vec::new();
        for (index, on) in description.on.iter().enumerate() {
            let is_taken = taken.contains(&on.trigger)
                || (taken.contains(&Trigger::AnyMessage)
                    && matches!(on.trigger, Trigger::Message(_)));
            if is_taken {
                let message = "is never reached: an earlier entry without \"when\" takes all of it, expected \
                    this one before it";
                self.wrong(format!("on[{index}]"), message);
            }
            if on.deed.when.is_none() {
                taken.push(on.trigger);
            }
        }
    }

    /// Records an error for each message that is always mistaken for an earlier one, or that does
    /// not decode to the values that were encoded.
    fn check_messages(&mut self, description: &Description) {
        let messages = &description.messages;
        for (index, message) in messages.iter().enumerate() {
            let mut random = xorshift(index as u64 + 1);
            let mut shadows = Vec::new();
            let mut is_shadowed = true;
            for _ in 0..EXAMPLES {
                let values = message.example(&mut |below| random() % below.max(1));
                let body = message.encode(&values).bytes;
                if let Some(problem) = self.misread(description, message, &values, &body) {
                    self.wrong(format!("message[{index}]"), problem);
                    return;
                }
                let earlier = messages[..index].iter().find(|other| {
                    let same_end = [From::Host, From::Device]
                        .into_iter()
                        .any(|from| message.is_from(from) && other.is_from(from));
                    same_end && other.frame == message.frame && other.decode(&body).is_some()
                });
                match earlier {
                    Some(earlier) => shadows.push(earlier.name.clone()),
                    None => is_shadowed = false,
                }
            }
            if is_shadowed && let Some(earlier) = shadows.first() {
                let text = format!(
                    "is ambiguous: all of it is taken for \"{earlier}\", expected a constant that \
                     tells them apart, or the more general message last"
                );
                self.wrong(format!("message[{index}]"), text);
            }
        }
    }

    /// The reason why an example does not decode to its own values, if it does not.
    fn misread(
        &self,
        description: &Description,
        message: &Message,
        values: &Record,
        body: &[u8],
    ) -> Option<String> {
        if message.decode(body).is_none() {
            // A condition or size that depends on the state can fail here and be valid in the
            // device.
            let is_pure = message.encode(&Nothing).failed.is_empty();
            return is_pure.then(|| {
                format!(
                    "cannot be decoded from its own bytes, expected other fields: {} becomes {body:02X?}",
                    crate::value::Value::Record(values.clone())
                )
            });
        }
        let framing = &description.frames.0[message.frame];
        match framing.frame(body) {
            None => Some(match framing.room(body) {
                Some(room) if room != body.len() => format!(
                    "does not fit its frame: its fields have {} bytes, the frame has room for \
                     {room}; expected fields of {room} bytes or another size of the frame{}",
                    body.len(),
                    around_body(framing)
                ),
                _ => format!(
                    "does not fit its frame: its fields have {} bytes; expected fields that the \
                     length and the checksums of the frame can cover, in at most {} bytes{}",
                    body.len(),
                    framing.max,
                    unlimited_size(message.fields(), message.fields())
                        .map(|name| format!(": give \"{name}\" limits, it is a size of others"))
                        .unwrap_or_default()
                ),
            }),
            Some(frame) => match framing.body(&frame).as_deref() == Some(body) {
                true => None,
                false if framing.shares_length() => Some(
                    "writes over the length field; \"mask\" leaves only some of its bits to the \
                     message: expected a field of the same size at the same offset, with 0 in the \
                     bits of the length"
                        .to_owned(),
                ),
                false => Some(format!(
                    "is decoded from its frame as other bytes, expected another frame: \
                     {frame:02X?}"
                )),
            },
        }
    }
}

/// The bytes of a frame that are not fields, as an addition to a message.
fn around_body(framing: &Framing) -> &'static str {
    match framing.holes.is_empty() && framing.trailer == 0 {
        true => "",
        false => ". Sync bytes, the length and checksums are not fields, but its size counts them",
    }
}

/// A field of `all` without limits that is the size or count of one of `fields`.
fn unlimited_size<'a>(fields: &'a [Field], all: &'a [Field]) -> Option<&'a str> {
    fields.iter().find_map(|field| {
        let own = match &field.kind {
            Kind::Str(size) | Kind::Bytes(size) | Kind::Pad(size) => Some(size),
            _ => None,
        };
        let sizes = own.into_iter().chain(&field.repeat);
        let names = sizes.filter_map(Size::expr).flat_map(Expr::names);
        let mut unlimited = names.filter(|name| {
            let sizer = field::find(all, name);
            sizer.is_some_and(|sizer| sizer.limits.is_none() && sizer.constant.is_none())
        });
        unlimited.next().or_else(|| match &field.kind {
            Kind::Group(inner) => unlimited_size(inner, all),
            _ => None,
        })
    })
}

/// A small generator with a fixed seed, so that a file always gets the same result.
fn xorshift(seed: u64) -> impl FnMut() -> u64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    }
}
