//! Conversation with a program: each request gets the next turn, or the intact reply.

use core::time::Duration;

use super::case::{Exchange, Raw, Turn};
use super::cause::Cause;
use super::player::Halt;
use super::session::Session;

/// Silence after which a request counts as complete.
const WHOLE: Duration = Duration::from_millis(3);
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
/// Maximum length of the prefix by which an unknown request is matched with a known one.
const PREFIX_MAX: usize = 16;

/// Maximum duration of a conversation, and maximum silence of the program in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub(super) lasting: Duration,
    pub(super) silence: Duration,
}

/// Executes the conversation of `raw`. `played` receives the numbers of the turns that were sent.
pub(super) fn converse(
    live: &mut Session<'_>,
    raw: &Raw,
    limits: Limits,
    played: &mut Vec<usize>,
    causes: &mut Vec<Cause>,
) -> Result<(), Halt> {
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
            let was_altered = played.last().is_some_and(|at| raw.turn[*at].is_altered);
            let reply = last
                .as_deref()
                .and_then(|request| matching(&raw.exchange, request));
            asks = match reply.filter(|_| was_altered) {
                Some(reply) => {
                    live.say(&reply.reply.0)?;
                    live.flush()?;
                    let heard = live.hear(limits.silence, WHOLE, &is_known)?;
                    let is_new = !causes.iter().any(|one| matches!(one, Cause::NoTimeout(_)));
                    if heard.is_some() && is_new {
                        let kind = &raw.turn[played[played.len() - 1]].kind;
                        causes.push(Cause::NoTimeout(format!(
                            "after the reply \"{kind}\" it sent nothing for {} s, and continued \
                             after a valid reply",
                            limits.silence.as_secs_f64()
                        )));
                    }
                    if let Some(heard) = &heard {
                        live.unhear(heard);
                    }
                    heard.is_some()
                }
                None => false,
            };
            continue;
        }
        let known = request
            .as_deref()
            .and_then(|asked| matching(&raw.exchange, asked));
        let next = next_turn(raw, &left, known, request.is_some());
        match (next, known) {
            (Some(at), _) => {
                left[at] = false;
                sound = 0;
                played.push(at);
                say(live, &raw.turn[at])?;
            }
            (None, Some(exchange)) => {
                sound += 1;
                live.say(&exchange.reply.0)?;
                live.flush()?;
            }
            (None, None) => sound += 1,
        }
        if !asks {
            live.pass(raw.gap.map_or(TURN_GAP, |gap| gap.0))?;
        }
        last = request;
    }
    live.pass(END_GAP)?;
    if !asks {
        return Ok(());
    }
    // Checks that the program continues after an intact reply.
    let reply = last
        .as_deref()
        .and_then(|asked| matching(&raw.exchange, asked));
    let Some(reply) = reply else {
        return Ok(());
    };
    live.say(&reply.reply.0)?;
    live.flush()?;
    if live.hear(limits.silence, WHOLE, &is_known)?.is_none() {
        causes.push(Cause::Hang(format!(
            "it sends no request for {} s, although its last request got a valid reply",
            limits.silence.as_secs_f64()
        )));
    }
    Ok(())
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

/// The next turn that fits the request, or any request. A program without requests gets all turns
/// in order.
fn next_turn(raw: &Raw, left: &[bool], known: Option<&Exchange>, is_asked: bool) -> Option<usize> {
    let fits = |turn: &Turn| match (&turn.to, known) {
        (None, _) => true,
        (Some(to), Some(known)) => *to == known.request,
        (Some(_), None) => !is_asked || raw.exchange.is_empty(),
    };
    let turns = raw.turn.iter().zip(left).enumerate();
    let mut open = turns.filter(|(_, (turn, left))| **left && fits(turn));
    open.next().map(|(at, _)| at)
}

/// The exchange with the request `request`, or with the longest common prefix.
fn matching<'a>(exchanges: &'a [Exchange], request: &[u8]) -> Option<&'a Exchange> {
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
    use super::super::case::Hex;
    use super::*;

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
            next_turn(&raw, &left, known.map(|at| &raw.exchange[at]), true)
        };
        assert_eq!(of([true; 3], Some(0)), Some(1));
        assert_eq!(of([true; 3], Some(1)), Some(0));
        assert_eq!(of([true; 3], None), Some(2));
        assert_eq!(of([true, false, false], Some(0)), None);
        assert_eq!(next_turn(&raw, &[true; 3], None, false), Some(0));
    }
}
