//! Conversation with a program: each request gets the next turn, or the intact reply.

use core::time::Duration;

use super::case::{Hex, Raw, Turn};
use super::cause::Cause;
use super::damage;
use super::player::Halt;
use super::replies::Replies;
use super::session::{Session, WHOLE};

/// Pause between two chunks of a turn.
const PIECE_GAP: Duration = Duration::from_millis(5);
/// Usual pause after a turn if the program sends no requests: some programs separate frames by
/// silence.
const TURN_GAP: Duration = Duration::from_millis(25);
/// Pause after the last turn, in which the program processes it.
const END_GAP: Duration = Duration::from_millis(100);
/// Number of consecutive intact replies after which a case ends: the program does not request the
/// rest.
const SOUND_MAX: usize = 24;

/// Maximum duration of a conversation, and maximum silence of the program in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub(super) lasting: Duration,
    pub(super) silence: Duration,
}

/// Executes the conversation of `raw` with the intact `replies`.
pub(super) fn converse(
    live: &mut Session<'_>,
    raw: &Raw,
    limits: Limits,
    replies: &mut Replies<'_>,
    causes: &mut Vec<Cause>,
) -> Result<(), Halt> {
    if let Some(damage) = raw.damage.as_ref().filter(|_| raw.asks) {
        damage::try_replies(live, damage, &raw.link, limits.silence, replies, causes)?;
    }
    let until = live.now() + limits.lasting;
    let mut left: Vec<bool> = vec![true; raw.turn.len()];
    let (mut asks, mut sound) = (raw.asks, 0);
    let mut last: Option<Vec<u8>> = None;
    let is_known = |heard: &[u8]| raw.exchange.iter().any(|one| one.request.0 == heard);
    while live.now() < until && sound < SOUND_MAX && left.contains(&true) {
        let request = match asks {
            true => live.hear(limits.silence, WHOLE, &is_known)?,
            false => None,
        };
        if asks && request.is_none() {
            let turn = live.held.turns.last().filter(|turn| turn.is_altered);
            let (turn, asked) = (turn.cloned(), last.clone());
            let reply = asked.and_then(|asked| replies.reply(&asked, live.now()));
            asks = match (reply, turn) {
                (Some(reply), Some(turn)) => {
                    let heard = goes_on_after(live, &reply.bytes, limits, &is_known)?;
                    if heard {
                        waits_for_ever(&turn, limits, causes);
                    }
                    heard
                }
                _ => false,
            };
            continue;
        }
        answer(
            live,
            raw,
            replies,
            request.as_deref(),
            &mut left,
            &mut sound,
        )?;
        if !asks {
            live.pass(raw.gap.map_or(TURN_GAP, |gap| gap.0))?;
        }
        last = request;
    }
    match asks {
        false => live.pass(END_GAP),
        true => farewell(live, raw, limits, replies, last, causes),
    }
}

/// Checks that the program continues after an intact reply to its next request, or to its `last`
/// one.
fn farewell(
    live: &mut Session<'_>,
    raw: &Raw,
    limits: Limits,
    replies: &mut Replies<'_>,
    last: Option<Vec<u8>>,
    causes: &mut Vec<Cause>,
) -> Result<(), Halt> {
    let is_known = |heard: &[u8]| raw.exchange.iter().any(|one| one.request.0 == heard);
    // The next request shows that the program has processed the last turn.
    let request = live.hear(limits.silence, WHOLE, &is_known)?;
    let is_silent = request.is_none();
    let Some(asked) = request.or(last) else {
        return Ok(());
    };
    let Some(reply) = replies.reply(&asked, live.now()) else {
        return Ok(());
    };
    live.is_altered |= !reply.is_own;
    let turn = live.held.turns.last().filter(|turn| turn.is_altered);
    let turn = turn.filter(|_| is_silent).cloned();
    match (goes_on_after(live, &reply.bytes, limits, &is_known)?, turn) {
        (true, Some(turn)) => waits_for_ever(&turn, limits, causes),
        // A program may ignore the reply to a similar request, and wait where none is due.
        (false, _) if reply.is_own && !reply.bytes.is_empty() => {
            causes.push(Cause::Hang(format!(
                "it sends no request for {} s, although its last request got a valid reply",
                limits.silence.as_secs_f64()
            )));
        }
        _ => {}
    }
    Ok(())
}

/// Sends the next turn, or the intact reply to `request`. An unsolicited turn does not take the
/// place of a reply.
fn answer(
    live: &mut Session<'_>,
    raw: &Raw,
    replies: &mut Replies<'_>,
    request: Option<&[u8]>,
    left: &mut [bool],
    sound: &mut usize,
) -> Result<(), Halt> {
    let now = live.now();
    let reply = request.and_then(|asked| replies.reply(asked, now));
    let alike = request.map_or_else(Vec::new, |asked| replies.alike(asked));
    let next = next_turn(raw, left, &alike, request.is_some());
    *sound = if next.is_some() { 0 } else { *sound + 1 };
    let mut is_replaced = false;
    if let Some(at) = next {
        left[at] = false;
        live.played.push(at);
        let turn = &raw.turn[at];
        let turn = match request {
            Some(asked) => replies.changed(turn, asked, reply.as_ref()),
            None => turn.clone(),
        };
        is_replaced = turn.to.is_some();
        live.is_altered |= turn.is_altered;
        live.held.turns.push(turn.clone());
        say(live, &turn)?;
    }
    // A device that never replied owes no reply.
    let is_owed = request.is_some() && !raw.exchange.is_empty() && !is_replaced;
    live.is_altered |= is_owed && !reply.as_ref().is_some_and(|reply| reply.is_own);
    if let Some(reply) = reply.filter(|_| !is_replaced) {
        live.say(&reply.bytes)?;
        live.flush()?;
    }
    Ok(())
}

/// Whether the program sends a request after `reply`.
fn goes_on_after(
    live: &mut Session<'_>,
    reply: &[u8],
    limits: Limits,
    is_known: &dyn Fn(&[u8]) -> bool,
) -> Result<bool, Halt> {
    live.say(reply)?;
    live.flush()?;
    let heard = live.hear(limits.silence, WHOLE, is_known)?;
    if let Some(heard) = &heard {
        live.unhear(heard);
    }
    Ok(heard.is_some())
}

/// Adds the cause of a program that continued only after a valid reply in place of `turn`.
fn waits_for_ever(turn: &Turn, limits: Limits, causes: &mut Vec<Cause>) {
    if causes.iter().any(|one| matches!(one, Cause::NoTimeout(_))) {
        return;
    }
    causes.push(Cause::NoTimeout(format!(
        "after the reply \"{}\" it sent nothing for {} s, and continued after a valid reply",
        turn.kind,
        limits.silence.as_secs_f64()
    )));
}

fn say(live: &mut Session<'_>, turn: &Turn) -> Result<(), Halt> {
    for (number, piece) in turn.say.iter().enumerate() {
        if number > 0 {
            live.pass(PIECE_GAP)?;
        }
        live.say(&piece.0)?;
        live.flush()?;
    }
    Ok(())
}

/// The next turn for one of the requests `alike`, or for any request. A program without requests
/// gets all turns in order.
fn next_turn(raw: &Raw, left: &[bool], alike: &[&Hex], is_asked: bool) -> Option<usize> {
    let fits = |turn: &Turn| match &turn.to {
        None => true,
        Some(_) if alike.is_empty() => !is_asked || raw.exchange.is_empty(),
        Some(to) => alike.contains(&to),
    };
    let turns = raw.turn.iter().zip(left).enumerate();
    let mut open = turns.filter(|(_, (turn, left))| **left && fits(turn));
    open.next().map(|(at, _)| at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fuzz::dut::case::Exchange;
    use crate::fuzz::dut::replies::matching;

    fn exchange(request: &[u8]) -> Exchange {
        Exchange {
            request: Hex(request.to_vec()),
            reply: Hex(b"r".to_vec()),
        }
    }

    #[test]
    fn a_request_that_is_not_known_is_matched_by_its_beginning() {
        let known = [exchange(b"ab1"), exchange(b"abc"), exchange(b"x")];
        let of = |request: &[u8]| matching(&known, request).map(|one| one.request.0.clone());
        assert_eq!(of(b"abc"), Some(b"abc".to_vec()));
        assert_eq!(of(b"ab7"), Some(b"ab1".to_vec()));
        assert_eq!(of(b"q"), None);
    }

    #[test]
    fn a_turn_for_another_request_waits_until_that_comes() {
        let turn = |to: Option<&[u8]>| Turn {
            to: to.map(|to| Hex(to.to_vec())),
            ..Turn::default()
        };
        let raw = Raw {
            exchange: vec![exchange(b"a"), exchange(b"b")],
            turn: vec![turn(Some(b"b")), turn(Some(b"a")), turn(None)],
            ..Raw::default()
        };
        let of = |left: [bool; 3], known: Option<usize>| {
            let known = known.map(|at| &raw.exchange[at].request);
            next_turn(&raw, &left, known.as_slice(), true)
        };
        assert_eq!(of([true; 3], Some(0)), Some(1));
        assert_eq!(of([true; 3], Some(1)), Some(0));
        assert_eq!(of([true; 3], None), Some(2));
        assert_eq!(of([true, false, false], Some(0)), None);
        assert_eq!(next_turn(&raw, &[true; 3], &[], false), Some(0));
    }
}
