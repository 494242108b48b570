//! The steps of a case.

use core::time::Duration;
use std::path::Path;

use protocols::Instant;

use super::answers;
use super::case::{Answered, Case, Known, Pair, Raw};
use super::cause::Cause;
use super::coverage::Reached;
use super::dialogue::{self, Limits};
use super::harness::{Harness, HarnessError, Spent};
use super::player::Halt;
use super::replies::{Held, Replies};
use super::session::Session;
use super::speech::{Shape, Speech};
use engine::codec::wire::{Piece, Stream};
use engine::rig::Logged;
use engine::run::Run;
use engine::run::check::Status;
use engine::scenario::{Scenario, TextSpec};
use realtime::LATE;
use realtime::clock::{Clock as _, WallClock};

/// The result of a case.
#[derive(Clone, Debug)]
pub struct TrialOutcome {
    /// Causes of the failure.
    pub causes: Vec<Cause>,
    /// The standard error output of the program.
    pub said: String,
    /// The scenario as it ran; random faults are replaced by the bytes that they hit.
    pub ran: Scenario,
    /// The program's behaviour in the last part of the case.
    pub known: Known,
    /// Whether the rig was too late to judge results that depend on time.
    pub was_late: bool,
    /// The program's coverage up to each pause of the traffic, if it counts it.
    pub reached: Vec<Reached>,
    /// Numbers of the played turns.
    pub played: Vec<usize>,
    /// The conversation as it was held.
    pub held: Held,
    /// An error that the program reported on purpose before it ended.
    pub reported: Option<Cause>,
    /// Whether the program has sent any byte.
    pub has_spoken: bool,
}

/// Maximum time for an answer to a frame.
const WINDOW: Duration = Duration::from_millis(60);
/// Silence after a partial frame: much longer than any gap within a frame.
const CUT_SILENCE: Duration = Duration::from_secs(1);
/// Number of requests after a frame that the program lost.
const CUT_ASKED: usize = 32;
/// Minimum virtual time of a conversation: some programs send one request per second.
const DIALOGUE: Duration = Duration::from_secs(120);
/// Virtual time that a program may wait for a missing reply.
const SILENCE: Duration = Duration::from_secs(10);

/// A link and its traffic.
pub(super) struct Talk<'a> {
    speech: &'a Speech,
    /// Kinds of unsolicited frames of the program.
    pub(super) chatter: Shape,
}

impl<'a> Talk<'a> {
    /// A link without unsolicited frames.
    pub(super) const fn new(speech: &'a Speech) -> Self {
        let chatter = Shape::new();
        Self { speech, chatter }
    }

    fn of(raw: &Raw, speech: &'a Speech) -> Self {
        let chatter = raw.chatter.iter().map(|hex| hex.0.clone()).collect();
        Self { speech, chatter }
    }

    /// The kind of the program's answer to `bytes`.
    pub(super) fn ask(&self, live: &mut Session<'_>, bytes: &[u8]) -> Result<Shape, Halt> {
        let heard = live.ask(bytes, WINDOW)?;
        Ok(&self.speech.shape(&heard, bytes) - &self.chatter)
    }

    /// Whether the program answers the damaged frame like the intact one, and does not answer
    /// noise. The result must be the same twice, and after another answered frame: an unsolicited
    /// frame may report the last frame that the program accepted.
    fn is_taken(&self, live: &mut Session<'_>, raw: &Raw, pair: &Pair) -> Result<bool, Halt> {
        if self.ask(live, &pair.damaged.0)?.is_empty() {
            return Ok(false);
        }
        let others = raw.answered.iter().map(|answered| &answered.frame);
        let other = others.into_iter().find(|frame| **frame != pair.good);
        for _ in 0..2 {
            if let Some(other) = other {
                self.ask(live, &other.0)?;
            }
            let to_noise = self.ask(live, &pair.noise.0)?;
            let to_damaged = self.ask(live, &pair.damaged.0)?;
            let to_good = self.ask(live, &pair.good.0)?;
            if to_damaged.is_empty() || to_damaged == to_noise || to_damaged != to_good {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Whether the program loses the frame after a partial frame and a silence, twice, although it
    /// answers later frames.
    fn loses_next(&self, live: &mut Session<'_>, raw: &Raw, cut: &[u8]) -> Result<bool, Halt> {
        let Some(asked) = raw.answered.first() else {
            return Ok(false);
        };
        for _ in 0..2 {
            live.say(cut)?;
            live.flush()?;
            live.pass(CUT_SILENCE)?;
            if self.is_answered(live, asked)? {
                return Ok(false);
            }
            let mut is_answered = false;
            for _ in 0..CUT_ASKED {
                is_answered = self.is_answered(live, asked)?;
                if is_answered {
                    break;
                }
            }
            if !is_answered {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Whether the program answers as before.
    fn is_answered(&self, live: &mut Session<'_>, asked: &Answered) -> Result<bool, Halt> {
        let kinds = self.ask(live, &asked.frame.0)?;
        Ok(asked.kinds.iter().any(|kind| kinds.contains(&kind.0)))
    }
}

/// Executes `case`, then checks that the program is alive. `causes` receives all failures, even if
/// the program ended.
pub(super) fn act(
    harness: &Harness<'_>,
    live: &mut Session<'_>,
    case: &Case,
    speech: &Speech,
    causes: &mut Vec<Cause>,
) -> Result<(), Halt> {
    let alive = harness.alive;
    let Some(raw) = &case.told.raw else {
        live.pass(case.told.lasting.0)?;
        causes.extend(settle(live, &case.told.known, None, alive)?);
        return Ok(());
    };
    let talk = Talk::of(raw, speech);
    for pair in &raw.pair {
        if talk.is_taken(live, raw, pair)? {
            let (pair, link) = (pair.clone(), raw.link.clone());
            causes.push(Cause::Accepts { pair, link });
            break;
        }
    }
    if !raw.learned.is_empty()
        && let Some(pair) = answers::taken(live, raw)?
    {
        let link = raw.link.clone();
        causes.push(Cause::Accepts { pair, link });
    }
    if let Some(cut) = &raw.cut
        && talk.loses_next(live, raw, &cut.0)?
    {
        causes.push(Cause::NoTimeout(format!(
            "on {}, after the first {} bytes of a frame and {} s of silence it takes the next \
             frame for the rest of it",
            raw.link,
            cut.0.len(),
            CUT_SILENCE.as_secs_f64()
        )));
    }
    if !raw.turn.is_empty() {
        return hold_dialogue(harness, live, case, causes);
    }
    // The stream was already parsed once when the case was read.
    let stream = Stream::parse(&raw.stream).unwrap_or_default();
    // Coverage before this point does not come from the traffic.
    live.note_reached(harness);
    live.take_reached();
    for piece in stream.pieces() {
        match piece {
            Piece::Bytes(bytes) => live.say(bytes)?,
            Piece::Idle => {
                match raw.gap {
                    Some(gap) => {
                        live.flush()?;
                        live.pass(gap.0)?;
                    }
                    None => live.pause()?,
                }
                live.note_reached(harness);
            }
        }
    }
    live.pause()?;
    causes.extend(settle(live, &case.told.known, Some((&talk, raw)), alive)?);
    Ok(())
}

/// Executes the conversation of `case`, then checks that the program is alive.
fn hold_dialogue(
    harness: &Harness<'_>,
    live: &mut Session<'_>,
    case: &Case,
    causes: &mut Vec<Cause>,
) -> Result<(), Halt> {
    let Some(raw) = &case.told.raw else {
        return Ok(());
    };
    let is_virtual = harness.supervision.is_some();
    let [lasting, silence] = [case.told.lasting.0, harness.alive];
    let limits = match is_virtual {
        true => Limits {
            lasting: lasting.max(DIALOGUE),
            silence: silence.max(SILENCE),
        },
        false => Limits { lasting, silence },
    };
    let mut replies = Replies::new(harness, raw);
    let held = dialogue::converse(live, raw, limits, &mut replies, causes);
    live.held.exchanges = replies.made;
    // Bytes of the program that were not taken are requests without a reply.
    let owes_replies = !(raw.asks && raw.exchange.is_empty());
    live.is_altered |= owes_replies && !live.take_heard().is_empty();
    held?;
    causes.extend(settle(live, &case.told.known, None, harness.alive)?);
    Ok(())
}

/// Checks that the program is alive: it reads its input, sends where it always sent, and answers
/// known requests. Requests are repeated, because a program that waits for the rest of a partial
/// frame consumes them.
pub(super) fn settle(
    live: &mut Session<'_>,
    known: &Known,
    asked: Option<(&Talk<'_>, &Raw)>,
    alive: Duration,
) -> Result<Option<Cause>, Halt> {
    let (from, mut count) = (live.now(), 0);
    let mut answers = asked.is_none_or(|(_, raw)| raw.answered.is_empty());
    loop {
        let now = live.known(from);
        let unread: Vec<_> = known.reads.difference(&now.reads).cloned().collect();
        let silent: Vec<_> = known.speaks.difference(&now.speaks).cloned().collect();
        if unread.is_empty() && silent.is_empty() && answers {
            return Ok(None);
        }
        if live.now() - from >= alive {
            return Ok(Some(Cause::Hang(in_words(
                &unread, &silent, answers, alive,
            ))));
        }
        match asked {
            Some((talk, raw)) if !answers => {
                let asked = &raw.answered[count % raw.answered.len()];
                answers = talk.is_answered(live, asked)?;
                count += 1;
            }
            _ => live.look()?,
        }
    }
}

fn in_words(unread: &[String], silent: &[String], answers: bool, alive: Duration) -> String {
    let mut words = Vec::new();
    if !unread.is_empty() {
        words.push(format!("it does not read {}", unread.join(", ")));
    }
    if !silent.is_empty() {
        words.push(format!("it sends nothing on {}", silent.join(", ")));
    }
    if !answers {
        words.push("it answers nothing that it used to answer".to_owned());
    }
    let seconds = alive.as_secs_f64();
    format!("for {seconds} s {}", words.join(", "))
}

/// Runs `case`; `speech` is the format of its raw link. `recording` receives a capture of all
/// bytes.
pub fn run(
    harness: &Harness<'_>,
    case: &Case,
    speech: &Speech,
    recording: &Path,
) -> Result<TrialOutcome, HarnessError> {
    let clock = WallClock::start();
    let (mut live, opened) = Session::begin(harness, case, recording)?;
    let started = clock.now() - Instant::ZERO;
    let from = live.now();
    let mut causes = Vec::new();
    let acted = opened.and_then(|()| act(harness, &mut live, case, speech, &mut causes));
    let lasted = live.now() - from;
    let outcome = conclude(harness, live, case, acted, causes)?;
    let spent = harness.spent.get();
    harness.spent.set(Spent {
        starts: spent.starts + started,
        wall: spent.wall + (clock.now() - Instant::ZERO),
        rig: spent.rig + lasted,
    });
    Ok(outcome)
}

/// Ends the program after `case`, which ended with `acted`, and judges it.
pub(super) fn conclude(
    harness: &Harness<'_>,
    live: Session<'_>,
    case: &Case,
    acted: Result<(), Halt>,
    causes: Vec<Cause>,
) -> Result<TrialOutcome, HarnessError> {
    let is_altered = match &case.told.raw {
        None => harness.is_mute || !case.scenario.fault.is_empty(),
        // Without its device, no request of the program gets a reply.
        Some(raw) if raw.turn.is_empty() => {
            let has_pairs = !raw.pair.is_empty() || !raw.learned.is_empty();
            raw.chunks() > 0 || has_pairs || live.has_spoken()
        }
        Some(raw) => live.is_altered || !raw.learned.is_empty(),
    };
    let mut outcome = judge(harness, live, acted, causes, is_altered)?;
    if case.told.known.ends {
        outcome.causes.retain(|cause| *cause != Cause::Ended);
    }
    Ok(outcome)
}

/// Ends the program and adds its failures to `causes`. `is_altered` says whether any input since
/// its start was altered or missing: the rest of a frame with a wrong length may be parsed as the
/// header of a much later frame.
pub(super) fn judge(
    harness: &Harness<'_>,
    mut live: Session<'_>,
    acted: Result<(), Halt>,
    mut causes: Vec<Cause>,
    is_altered: bool,
) -> Result<TrialOutcome, HarnessError> {
    let (known, has_spoken) = (live.known(live.now()), live.has_spoken());
    let was_late = live.late() > LATE;
    if acted.is_err() {
        live.note_reached(harness);
    }
    let reached = live.take_reached();
    let played = core::mem::take(&mut live.played);
    let held = core::mem::take(&mut live.held);
    let mut reported = None;
    let fault = live.fault();
    let (said, run) = live.end(harness);
    match acted {
        Ok(()) => {}
        Err(Halt::Ended(ended)) => {
            let cause = Cause::of_end(ended, &said, fault);
            match cause.is_reported() && !harness.errors.counts(is_altered) {
                true => reported = Some(cause),
                false => causes.push(cause),
            }
        }
        Err(Halt::Lost(how)) => causes.push(Cause::PortLost(how)),
        Err(Halt::Spins(who)) => causes.push(Cause::Spins(who)),
        Err(Halt::Guest(error)) => return Err(error.into()),
        Err(Halt::Interrupted) => return Err(HarnessError::Interrupted),
    }
    let ran = run.case();
    let counts = |cause: &Cause| {
        (harness.is_strict || !cause.is_about_time()) && !(was_late && cause.may_be_lateness())
    };
    let opens: Vec<&str> = known.opens.iter().map(String::as_str).collect();
    causes.extend(broken(run, &opens).into_iter().filter(counts));
    Ok(TrialOutcome {
        causes,
        said,
        ran,
        known,
        was_late,
        reached,
        played,
        held,
        reported,
        has_spoken,
    })
}

/// Broken rules, each once, and failed checks. Violations at a device do not count if the program
/// opened no port through which it can reach the device; `opens` lists its ports. A master whose
/// requests are damaged or have no reader yet gets no replies, and a device without any command
/// knows no request.
fn broken(run: Run, opens: &[&str]) -> Vec<Cause> {
    let mut causes: Vec<Cause> = Vec::new();
    let events = run.rig.events().iter();
    let case = run.case();
    let opened_at = |device: &str| {
        let mut opened = run.rig.events().iter();
        let opened = opened.find(|one| one.source == device && one.event.rule == "port-opened");
        opened.map(|one| one.event.at)
    };
    let is_judged = |one: &&Logged| {
        let Some(spec) = case.device.get(&one.source) else {
            return true;
        };
        match spec.kind() {
            "master" => {
                let is_struck = case.fault.iter().any(|fault| fault.is_at(&one.source));
                let is_early = opened_at(&one.source).is_none_or(|opened| one.event.at < opened);
                !is_struck && !is_early
            }
            "text" => {
                let knows_any = spec
                    .settings::<TextSpec>()
                    .is_none_or(|it| !it.command.is_empty());
                knows_any || one.event.rule != "unknown-request"
            }
            _ => true,
        }
    };
    let is_its_own =
        |one: &&Logged| one.is_violation() && run.rig.reaches(opens, &one.source) && is_judged(one);
    for logged in events.filter(is_its_own) {
        let cause = Cause::Rule {
            device: logged.source.clone(),
            rule: logged.event.rule.to_owned(),
            detail: format!("{} s, {}", logged.event.at, logged.event.detail),
        };
        if causes.iter().all(|known| known.key() != cause.key()) {
            causes.push(cause);
        }
    }
    let checks = run.judge().checks.into_iter();
    causes.extend(
        checks
            .filter(|check| check.status == Status::Fail)
            .map(|check| Cause::Check {
                name: check.name,
                detail: check.detail,
            }),
    );
    causes
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use protocols::Instant;

    use super::*;
    use engine::robots::{self, Dut, PcEnd};
    use engine::scenario::Scenario;

    /// Broken rules in a run without a client, as far as a program that opened `opens` can be
    /// responsible.
    fn rules(opens: &[&str]) -> Vec<String> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/empty-room.toml");
        rules_of(Scenario::read(&path).expect("sound"), opens, 30, b"")
    }

    /// Broken rules in a run of 1 s with these devices; `sent` are the bytes of a program at their
    /// first port.
    fn rules_of_devices(devices: &str, opens: &[&str], sent: &[u8]) -> Vec<String> {
        let head = "schema = 1\nname = \"t\"\nrobot = \"none\"\nduration = \"1s\"\n";
        let read = Scenario::from_text(&format!("{head}{devices}"));
        rules_of(read.expect("sound"), opens, 1, sent)
    }

    fn rules_of(
        (scenario, source): (Scenario, engine::scenario::Source),
        opens: &[&str],
        seconds: u64,
        sent: &[u8],
    ) -> Vec<String> {
        let wired = robots::wire(&scenario, &source, Dut::External, PcEnd::Scripted);
        let wired = wired.expect("can be wired");
        let node = wired.open_ends.first().map(|end| end.node);
        let mut run = Run::with_rig(scenario, wired.rig, wired.instruments);
        run.rig.inject(node.expect("has a port"), sent);
        run.go_on_until(Instant::from_secs(seconds));
        let rule = |cause| match cause {
            Cause::Rule { rule, .. } => Some(rule),
            _ => None,
        };
        broken(run, opens).into_iter().filter_map(rule).collect()
    }

    /// U5: the scenario's PC reports that its waypoints are not confirmed. Only the program that
    /// opened the radio is responsible for that.
    #[test]
    fn u5_a_rule_is_broken_only_by_who_can_reach_its_device() {
        let rule = "waypoints-not-confirmed".to_owned();
        assert!(rules(&["radio"]).contains(&rule), "{:?}", rules(&["radio"]));
        assert_eq!(rules(&["lidar"]), [""; 0]);
        assert_eq!(rules(&[]), [""; 0]);
    }

    /// A device that knows no request cannot miss one, and a master is not answered before the
    /// program has its port open.
    #[test]
    fn a_rule_is_not_broken_where_nothing_could_keep_it() {
        let text =
            |commands: &str| format!("[device.it.text]\nbaud = 9600\ncommand = [{commands}]\n");
        let known = text("{ request = \"ping\", reply = \"pong\" }");
        assert_eq!(
            rules_of_devices(&known, &["it"], b"pnig\r\n"),
            ["unknown-request"]
        );
        assert_eq!(rules_of_devices(&text(""), &["it"], b"pnig\r\n"), [""; 0]);
        let master = "[device.plc.master]\ndescription = \"modbus-meter\"\n\
                      requests = [\"read voltage\"]\nperiod = \"100ms\"\n";
        assert_eq!(rules_of_devices(master, &["plc"], b""), [""; 0]);
    }
}
