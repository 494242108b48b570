//! The conformance test of a node program.

use core::time::Duration;

use protocols::{Instant, LineEvent};

use crate::VERSION;
use crate::error::{Ending, NodeError};
use crate::host::{END_MAX, Host};
use crate::message::{Form, Greeting, Input, Item, Output, Reply};
use crate::process::last_words;
use crate::spec::NodeSpec;

/// The result of one part of the test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// The program keeps this part of the contract.
    Pass,
    /// The program breaks this part of the contract.
    Fail,
    /// The program does not offer this feature.
    NotOffered,
}

/// One part of the test.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Its name in kebab case.
    pub name: &'static str,
    /// The result.
    pub mark: Mark,
    /// An explanation.
    pub detail: String,
}

/// The answers to a script of exchanges.
type Answers = Vec<Reply>;

/// The result of one part of the test: the reason for a failure, an observation, or that the
/// feature is not offered.
type Tried = Result<Result<String, String>, String>;

/// The results of a whole run of the script.
struct Seen {
    greeting: Greeting,
    /// The answers, or the reason why the run stopped.
    answers: Result<Answers, String>,
    /// Whether the program ended without an error, and the number of bytes behind its last answer.
    end: Result<usize, String>,
}

/// Tests the program of `spec`; `sent` holds input from the other end, for each port.
pub fn findings(spec: &NodeSpec, sent: &[Vec<u8>]) -> Vec<Finding> {
    let script = script(spec, sent);
    let seen = match see(spec, &script) {
        Ok(seen) => seen,
        // A program without a valid greeting fails all other parts.
        Err(detail) => return vec![finding("greeting", Err(detail))],
    };
    let expected = seen.answers.as_ref().map_err(String::clone);
    let with = |part: &dyn Fn(&Answers) -> Tried| match expected {
        // Runs without any output are equal for every program.
        Ok(answers) if answers.iter().all(|reply| reply.items.is_empty()) => {
            part(answers).map(|seen| seen.and_then(|_| Err(SILENT.to_owned())))
        }
        Ok(answers) => part(answers),
        Err(ref error) => Err(error.clone()),
    };
    vec![
        finding("greeting", greeting(&seen.greeting)),
        finding("wrong-version", wrong_version(spec)),
        finding("exchanges", with(&exchanges)),
        finding("chunked-input", with(&|seen| chunked(spec, &script, seen))),
        finding("same-every-run", with(&|seen| same(spec, &script, seen))),
        finding("faults", faults(spec, &seen.greeting.faults)),
        finding(
            "save-and-load",
            match seen.greeting.save {
                true => with(&|_| save(spec, &script)),
                false => Ok(Err("it does not offer \"save\"".to_owned())),
            },
        ),
        finding("end", end(&seen)),
        finding("end-of-input", end_of_input(spec)),
        finding("json", with(&|seen| json(spec, &script, seen))),
    ]
}

fn finding(name: &'static str, tried: Tried) -> Finding {
    let (mark, detail) = match tried {
        Ok(Ok(detail)) => (Mark::Pass, detail),
        Ok(Err(detail)) => (Mark::NotOffered, detail),
        Err(detail) => (Mark::Fail, detail),
    };
    Finding { name, mark, detail }
}

/// The reason why parts of the test prove nothing.
const SILENT: &str = "the program said nothing; give it something with --send";

/// Executes the script once, to its end.
fn see(spec: &NodeSpec, script: &[Step]) -> Result<Seen, String> {
    let mut host = start(spec)?;
    let greeting = host.greeting().clone();
    let answers = play(&mut host, script);
    let excess = host.excess();
    let ended = match answers {
        Ok(_) => host.end(),
        Err(_) => Ok(()),
    };
    let said = host.last_words();
    let end = match (&answers, &ended) {
        (Err(error), _) | (_, Err(error)) => Err(told(error, &said)),
        (Ok(_), Ok(())) => Ok(excess),
    };
    Ok(Seen {
        greeting,
        answers: answers.map_err(|error| told(&error, &said)),
        end,
    })
}

/// An exchange: its time and its inputs.
type Step = (Instant, Vec<Item<Input>>);

const SECOND: Duration = Duration::from_secs(1);
/// Maximum number of exchanges that a program requests between two steps.
const OWN_MAX: usize = 1_000;

/// The actions of a driver: opens each port, sends data byte by byte and at once, is silent, closes
/// the port.
fn script(spec: &NodeSpec, sent: &[Vec<u8>]) -> Vec<Step> {
    let mut now = Instant::ZERO;
    let mut steps: Vec<Step> = vec![(now, Vec::new())];
    let every: Vec<u8> = (0..=255).collect();
    let words: Vec<Vec<u8>> = match sent {
        [] => vec![b"\r\n".to_vec(), b"?\r\n".to_vec(), every],
        sent => sent.to_vec(),
    };
    for (port, known) in (0..).zip(&spec.ports) {
        let item = |at, what| Item { port, at, what };
        now += SECOND;
        steps.push((now, vec![item(now, Input::Line(LineEvent::Opened))]));
        for said in &words {
            now += SECOND;
            for byte in said {
                now += known.line.byte_time();
                steps.push((now, vec![item(now, Input::Bytes(vec![*byte]))]));
            }
            now += SECOND + known.line.bytes_time(said.len() as u64);
            steps.push((now, vec![item(now, Input::Bytes(said.clone()))]));
        }
        now += SECOND;
        steps.push((now, vec![item(now, Input::Line(LineEvent::Break))]));
        now += SECOND;
        steps.push((now, vec![item(now, Input::Line(LineEvent::Closed))]));
    }
    for (number, _) in (0..).zip(&spec.quantities) {
        now += SECOND;
        let value = Item {
            port: number,
            at: now,
            what: Input::Quantity(1.5),
        };
        steps.push((now, vec![value]));
    }
    steps
}

/// Executes `steps`, and the exchanges that the program requests between them.
fn play(host: &mut Host, steps: &[Step]) -> Result<Answers, NodeError> {
    let mut answers = Answers::new();
    let mut next = None;
    for (now, items) in steps {
        for _ in 0..OWN_MAX {
            let Some(at) = next.filter(|at| at < now) else {
                break;
            };
            let reply = host.exchange(at, &[])?;
            // If the program requests the current time again, the next exchange is a nanosecond
            // later.
            next = reply
                .next
                .map(|next| next.max(at + Duration::from_nanos(1)));
            answers.push(reply);
        }
        let reply = host.exchange(*now, items)?;
        next = reply
            .next
            .map(|next| next.max(*now + Duration::from_nanos(1)));
        answers.push(reply);
    }
    Ok(answers)
}

fn start(spec: &NodeSpec) -> Result<Host, String> {
    Host::start_as(spec, Form::Binary, VERSION).map_err(|(error, said)| told(&error, &said))
}

fn with_words(what: &str, said: &str) -> String {
    let words = last_words(said).map(|line| format!("; its last words: {line}"));
    format!("{what}{}", words.unwrap_or_default())
}

/// A failure with the program's last output.
fn told(error: &NodeError, said: &str) -> String {
    with_words(&format!("it {error}"), said)
}

fn played(spec: &NodeSpec, steps: &[Step]) -> Result<(Host, Answers), String> {
    let mut host = start(spec)?;
    let answers = play(&mut host, steps);
    let answers = answers.map_err(|error| told(&error, &host.last_words()))?;
    Ok((host, answers))
}

/// A program that was ended by a signal has crashed, whatever the test expected.
fn by_itself(how: Ending, said: &str) -> Result<(), String> {
    match how.signal() {
        None => Ok(()),
        Some(_) => Err(with_words(
            &format!("it is ended by a signal ({how}), expected it to exit by itself"),
            said,
        )),
    }
}

fn greeting(greeting: &Greeting) -> Tried {
    let list = |names: &[String]| match names {
        [] => "none".to_owned(),
        names => names.join(", "),
    };
    Ok(Ok(format!(
        "version {VERSION}, save {}, faults: {}, outputs: {}",
        greeting.save,
        list(&greeting.faults),
        list(&greeting.outputs)
    )))
}

fn wrong_version(spec: &NodeSpec) -> Tried {
    match Host::start_as(spec, Form::Binary, VERSION + 1) {
        Err((NodeError::Exited { how, .. }, said)) => {
            by_itself(how, &said)?;
            Ok(Ok(format!("it exits ({how})")))
        }
        Err((NodeError::Version { found }, _)) => Err(format!(
            "it answers version {} with version {found}, expected its own version, {VERSION}",
            VERSION + 1
        )),
        Err((error, said)) => Err(told(&error, &said)),
        Ok(mut host) => match host.exchange(Instant::ZERO, &[]) {
            Ok(_) => Err(format!(
                "it continues with a rig of version {}, which it cannot know, expected it to exit",
                VERSION + 1
            )),
            Err(NodeError::Exited { how, .. }) => {
                by_itself(how, &host.last_words())?;
                Ok(Ok(format!("it says version {VERSION} and exits")))
            }
            Err(error) => Err(told(&error, &host.last_words())),
        },
    }
}

fn exchanges(answers: &Answers) -> Tried {
    let bytes = answers.iter().flat_map(|reply| &reply.items);
    let bytes = bytes.map(|item| match &item.what {
        Output::Bytes(bytes) => bytes.len(),
        _ => 0,
    });
    let bytes: usize = bytes.sum();
    Ok(Ok(format!(
        "{} answered, {bytes} bytes sent",
        answers.len()
    )))
}

fn chunked(spec: &NodeSpec, script: &[Step], whole: &Answers) -> Tried {
    let mut host = start(spec)?;
    host.write_in_pieces();
    let pieces = play(&mut host, script);
    let pieces = pieces.map_err(|error| told(&error, &host.last_words()))?;
    alike(whole, &pieces, "requests that come byte by byte")?;
    Ok(Ok(
        "requests that come byte by byte have the same answers".to_owned()
    ))
}

fn alike(one: &Answers, other: &Answers, what: &str) -> Result<(), String> {
    let pairs = one.iter().zip(other);
    let differs = pairs.clone().position(|(one, other)| one != other);
    let differs = differs.or((one.len() != other.len()).then_some(one.len().min(other.len())));
    match differs {
        None => Ok(()),
        Some(number) => Err(format!(
            "{what} have other answers from exchange {number} on, expected the same: does it look \
             at a clock, or draw random numbers that do not come from the seed?"
        )),
    }
}

fn same(spec: &NodeSpec, script: &[Step], one: &Answers) -> Tried {
    let (_, other) = played(spec, script)?;
    alike(one, &other, "two runs with the same requests")?;
    Ok(Ok(format!("two runs have the same {} answers", one.len())))
}

fn faults(spec: &NodeSpec, names: &[String]) -> Tried {
    if names.is_empty() {
        return Ok(Err("it supports no faults".to_owned()));
    }
    let mut now = Instant::ZERO;
    let mut steps: Vec<Step> = vec![(now, Vec::new())];
    for name in names {
        for (begins, figure) in [
            (true, None),
            (false, None),
            (true, Some(2.0)),
            (false, None),
        ] {
            now += SECOND;
            let fault = Input::Fault {
                name: name.clone(),
                begins,
                figure,
            };
            let item = Item {
                port: 0,
                at: now,
                what: fault,
            };
            steps.push((now, vec![item]));
        }
    }
    played(spec, &steps)?;
    Ok(Ok(format!("{} begin and end", names.join(", "))))
}

fn save(spec: &NodeSpec, script: &[Step]) -> Tried {
    let (first, second) = script.split_at(script.len() / 2);
    let (mut host, _) = played(spec, first)?;
    let state = host.save();
    let state = state.map_err(|error| told(&error, &host.last_words()))?;
    let expected = play(&mut host, second);
    let expected = expected.map_err(|error| told(&error, &host.last_words()))?;
    let mut other = start(spec)?;
    let found = other.load(&state).and_then(|()| play(&mut other, second));
    let found = found.map_err(|error| told(&error, &other.last_words()))?;
    alike(
        &expected,
        &found,
        "a program that continues and one that loads its state",
    )?;
    let len = state.len();
    Ok(Ok(format!(
        "a fresh process continues from {len} bytes with the same answers"
    )))
}

fn end(seen: &Seen) -> Tried {
    match &seen.end {
        Err(error) => Err(error.clone()),
        Ok(0) => Ok(Ok("it exits with code 0".to_owned())),
        Ok(excess) => Err(format!(
            "{excess} bytes follow its last answer, expected none"
        )),
    }
}

/// A rig that is killed sends no end message; its programs must exit nevertheless.
fn end_of_input(spec: &NodeSpec) -> Tried {
    let mut host = start(spec)?;
    match host.hang_up() {
        Some(how) => {
            by_itself(how, &host.last_words())?;
            Ok(Ok("it exits when its standard input is closed".to_owned()))
        }
        None => Err(format!(
            "it continues for {} s after its standard input was closed, expected it to exit: it \
             would outlive a killed rig",
            END_MAX.as_secs()
        )),
    }
}

fn json(spec: &NodeSpec, script: &[Step], expected: &Answers) -> Tried {
    let mut host = match Host::start_as(spec, Form::Json, VERSION) {
        Ok(host) => host,
        Err((NodeError::Exited { how, .. }, said)) => {
            by_itself(how, &said)?;
            return Ok(Err("it supports only the binary form".to_owned()));
        }
        Err((error, said)) => return Err(told(&error, &said)),
    };
    let found = play(&mut host, script);
    let found = found.map_err(|error| told(&error, &host.last_words()))?;
    alike(expected, &found, "the two forms")?;
    Ok(Ok(
        "the readable form (JSON) has the same answers".to_owned()
    ))
}
