//! Evaluation of a condition over a run: for a rule at each moment, for a wait since its start.
//!
//! Conditions on the state (registers, axes, figures of the robot, the map) are sampled every 10
//! ms. Bytes, frames, contacts and log events have moments of their own, also events that a device
//! folds into one entry. Between its moments such a condition has no value.

mod answers;
mod words;

use protocols::Instant;

use super::line_watch::{LineWatch, LineWatches, Wanted};
use crate::Shared;
use crate::near;
use crate::rig::{LogMoment, LogPoint};
use crate::robots::conditions::{Known, Moment, Reading};
use crate::scenario::{Condition, EventCondition, Flaw};
use words::told;

/// An observed condition.
#[derive(Clone)]
pub(super) struct Probe {
    condition: Condition,
    node: Node,
}

#[derive(Clone)]
enum Node {
    All(Vec<Probe>),
    Any(Vec<Probe>),
    Not(Box<Probe>),
    Leaf(Leaf),
}

/// A condition without inner conditions, and its readings.
#[derive(Clone)]
struct Leaf {
    source: Source,
    /// Readings at moments since the last update, oldest first.
    moments: Vec<(Instant, Reading)>,
    /// The reading at the judged moment.
    now: Option<Reading>,
    /// For a condition on the log: knowledge about its rule.
    known: Known,
    /// For a condition on the log: whether its source has logged something.
    is_logged: bool,
    /// For a condition on the log: a logged rule of the source with a name similar to the wanted
    /// one.
    near: Option<String>,
    /// Number of moments that were lost.
    lost: u64,
    /// For a register: the message for a name that the device does not have, from the last sample.
    missing: Option<String>,
}

#[derive(Clone)]
enum Source {
    /// The state of the run.
    State,
    /// A line.
    Line(Shared<LineWatch>),
    /// The log, from this point on.
    Log(LogPoint),
    /// The contacts, from this one on.
    Contacts(u64),
}

/// Value of a condition at a moment: true, false, or unknown.
pub(super) type Truth = Option<bool>;

impl core::fmt::Debug for Probe {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_tuple("Probe").field(&self.condition).finish()
    }
}

impl Probe {
    /// A probe of `condition`. `is_once`: it stops after the condition has held once. `moment`
    /// contains the items that the condition names.
    pub(super) fn new(
        condition: &Condition,
        moment: &Moment<'_>,
        lines: &LineWatches,
        is_once: bool,
    ) -> Result<Self, Flaw> {
        let all = |parts: &[Condition]| {
            let parts = parts.iter();
            let parts = parts.map(|part| Self::new(part, moment, lines, is_once));
            parts.collect::<Result<Vec<_>, _>>()
        };
        let line = |link: &str, direction, wanted| {
            let link = moment.link(link)?;
            let watch = LineWatch::new(link, direction, wanted, is_once);
            Ok::<_, Flaw>(Source::Line(lines.add(watch)))
        };
        let source = match condition {
            Condition::All(parts) => return Ok(Self::of(condition, Node::All(all(parts)?))),
            Condition::Any(parts) => return Ok(Self::of(condition, Node::Any(all(parts)?))),
            Condition::Not(inner) => {
                let inner = Self::new(inner, moment, lines, is_once)?;
                return Ok(Self::of(condition, Node::Not(Box::new(inner))));
            }
            Condition::Bytes(bytes) => line(&bytes.link, bytes.direction, Wanted::bytes(bytes)?)?,
            Condition::Frame(frame) => {
                let wanted = Wanted::frame(frame, moment)?;
                line(&frame.link, frame.direction, wanted)?
            }
            Condition::Event(_) => Source::Log(moment.rig.log_end()),
            Condition::Contact(_) => Source::Contacts(moment.rig.world.contact_count()),
            _ => Source::State,
        };
        let known = match condition {
            Condition::Event(event) => moment.known_rule(event),
            _ => Known::Open,
        };
        let leaf = Leaf {
            source,
            moments: Vec::new(),
            now: None,
            known,
            is_logged: false,
            near: None,
            lost: 0,
            missing: None,
        };
        Ok(Self::of(condition, Node::Leaf(leaf)))
    }

    fn of(condition: &Condition, node: Node) -> Self {
        let condition = condition.clone();
        Self { condition, node }
    }

    /// The same probe on a copy of the rig; `lines` observe the copy's lines.
    pub(super) fn fork(&self, lines: &LineWatches) -> Self {
        let all = |parts: &[Self]| parts.iter().map(|part| part.fork(lines)).collect();
        let node = match &self.node {
            Node::All(parts) => Node::All(all(parts)),
            Node::Any(parts) => Node::Any(all(parts)),
            Node::Not(inner) => Node::Not(Box::new(inner.fork(lines))),
            Node::Leaf(leaf) => {
                let mut leaf = leaf.clone();
                if let Source::Line(watch) = &leaf.source {
                    let copy = watch.lock().clone();
                    leaf.source = Source::Line(lines.add(copy));
                }
                Node::Leaf(leaf)
            }
        };
        Self::of(&self.condition, node)
    }

    /// Reads the events since the last update, and the state.
    pub(super) fn look(&mut self, moment: &Moment<'_>, contacts: &[emulators::world::Contact]) {
        let Self { condition, node } = self;
        match node {
            Node::All(parts) | Node::Any(parts) => {
                parts
                    .iter_mut()
                    .for_each(|part| part.look(moment, contacts));
            }
            Node::Not(inner) => inner.look(moment, contacts),
            Node::Leaf(leaf) => leaf.look(condition, moment, contacts),
        }
    }

    /// Collects the moments of all its parts, oldest first; several parts may have the same moment.
    pub(super) fn moments(&self, into: &mut Vec<(Instant, usize)>) {
        match &self.node {
            Node::All(parts) | Node::Any(parts) => parts.iter().for_each(|part| part.moments(into)),
            Node::Not(inner) => inner.moments(into),
            Node::Leaf(leaf) => {
                // The number distinguishes frames that ended at the same time.
                let mut before: Option<(Instant, usize)> = None;
                for (at, _) in &leaf.moments {
                    let number = match before {
                        Some((last, number)) if last == *at => number + 1,
                        _ => 0,
                    };
                    before = Some((*at, number));
                    into.push((*at, number));
                }
            }
        }
    }

    /// The value at a moment; `None` for the update itself, at which momentary parts have no value.
    pub(super) fn judge(&mut self, at: Option<(Instant, usize)>) -> Truth {
        match &mut self.node {
            Node::All(parts) => {
                // Every part is judged, so that every part has a reading for the message.
                let truths: Vec<_> = parts.iter_mut().map(|part| part.judge(at)).collect();
                together(&truths, false)
            }
            Node::Any(parts) => {
                let truths: Vec<_> = parts.iter_mut().map(|part| part.judge(at)).collect();
                together(&truths, true)
            }
            Node::Not(inner) => inner.judge(at).map(|truth| !truth),
            Node::Leaf(leaf) => {
                if !matches!(leaf.source, Source::State) {
                    leaf.now = at.and_then(|at| leaf.at(at)).cloned();
                }
                leaf.now.as_ref().and_then(|reading| reading.holds)
            }
        }
    }

    /// The readings of its parts at the last judged moment.
    pub(super) fn words(&self) -> String {
        let mut words = Vec::new();
        self.add_words(&mut words);
        words.join(", ")
    }

    fn add_words(&self, into: &mut Vec<String>) {
        match &self.node {
            Node::All(parts) | Node::Any(parts) => {
                parts.iter().for_each(|part| part.add_words(into));
            }
            Node::Not(inner) => inner.add_words(into),
            Node::Leaf(leaf) => {
                if let Some(reading) = &leaf.now {
                    into.push(told(&self.condition, reading));
                }
            }
        }
    }

    /// Whether the subject of the condition has appeared: bytes on its line, its frames, log
    /// entries, a moving robot. Only then could the condition have held.
    pub(super) fn has_appeared(&self, has_moved: bool) -> bool {
        match &self.node {
            Node::All(parts) | Node::Any(parts) => {
                parts.iter().all(|part| part.has_appeared(has_moved))
            }
            Node::Not(inner) => inner.has_appeared(has_moved),
            Node::Leaf(leaf) => match (&leaf.source, &self.condition) {
                (Source::Line(watch), Condition::Frame(frame)) => match frame.field {
                    Some(_) => watch.lock().found.readings > 0,
                    None => watch.lock().found.frames > 0,
                },
                (Source::Line(watch), _) => watch.lock().found.bytes > 0,
                (Source::Log(_), _) => leaf.could_be_logged(),
                (Source::Contacts(_), _) => has_moved,
                (Source::State, _) => leaf.now.is_some(),
            },
        }
    }

    /// Whether each momentary part has appeared.
    pub(super) fn have_moments_appeared(&self, has_moved: bool) -> bool {
        match &self.node {
            Node::All(parts) | Node::Any(parts) => {
                let mut parts = parts.iter();
                parts.all(|part| part.have_moments_appeared(has_moved))
            }
            Node::Not(inner) => inner.have_moments_appeared(has_moved),
            Node::Leaf(leaf) => {
                matches!(leaf.source, Source::State) || self.has_appeared(has_moved)
            }
        }
    }

    /// Whether a part has just read a value that cannot be compared: it has another type or is not
    /// a number.
    pub(super) fn is_incomparable(&self) -> bool {
        match &self.node {
            Node::All(parts) | Node::Any(parts) => parts.iter().any(Self::is_incomparable),
            Node::Not(inner) => inner.is_incomparable(),
            Node::Leaf(leaf) => {
                let now = leaf.now.as_ref();
                now.is_some_and(|reading| reading.holds.is_none())
            }
        }
    }

    /// The reason for a missing observation, e.g. a line with other frames only, or a log without
    /// entries of the source.
    pub(super) fn silence(&self) -> Option<String> {
        match &self.node {
            Node::All(parts) | Node::Any(parts) => parts.iter().find_map(Self::silence),
            Node::Not(inner) => inner.silence(),
            Node::Leaf(leaf) => {
                if let (Source::Log(_), Condition::Event(event)) = (&leaf.source, &self.condition) {
                    return leaf.silence_of_log(event);
                }
                if let (Some(_), Condition::Register(register)) = (&leaf.missing, &self.condition) {
                    let name = register.name.as_deref().unwrap_or("a value");
                    return Some(format!("{} never showed {name}", register.device));
                }
                let (Source::Line(watch), Condition::Frame(frame)) =
                    (&leaf.source, &self.condition)
                else {
                    return None;
                };
                let watch = watch.lock();
                let (link, frames) = (&frame.link, watch.found.frames);
                Some(match frames {
                    0 => format!("no frame arrived on {link}"),
                    _ => format!(
                        "{frames} frames arrived on {link}, the last: {}",
                        watch.found.last
                    ),
                })
            }
        }
    }

    /// The first register name that its device does not have, with the known names.
    pub(super) fn missing(&self) -> Option<&str> {
        match &self.node {
            Node::All(parts) | Node::Any(parts) => parts.iter().find_map(Self::missing),
            Node::Not(inner) => inner.missing(),
            Node::Leaf(leaf) => leaf.missing.as_deref().filter(|words| !words.is_empty()),
        }
    }

    /// Whether moments of a part were lost. A forbidden event may be among the lost moments.
    pub(super) fn has_lost(&self) -> bool {
        match &self.node {
            Node::All(parts) | Node::Any(parts) => parts.iter().any(Self::has_lost),
            Node::Not(inner) => inner.has_lost(),
            Node::Leaf(leaf) => match &leaf.source {
                Source::Line(watch) => watch.lock().found.lost > 0,
                _ => leaf.lost > 0,
            },
        }
    }

    /// Whether the condition has held since its start; for a state, whether it holds now. `None` if
    /// it has no comparable value.
    pub(super) fn has_come(&self, moment: &Moment<'_>, contacts: &super::Contacts) -> Truth {
        let truths = |parts: &[Self]| -> Vec<Truth> {
            let parts = parts.iter();
            parts.map(|part| part.has_come(moment, contacts)).collect()
        };
        match &self.node {
            Node::All(parts) => together(&truths(parts), false),
            Node::Any(parts) => together(&truths(parts), true),
            Node::Not(inner) => inner.has_come(moment, contacts).map(|truth| !truth),
            Node::Leaf(leaf) => match (&leaf.source, &self.condition) {
                (Source::Line(watch), _) => {
                    let mut watch = watch.lock();
                    watch.pause(moment.rig.now());
                    Some(watch.found.has_held)
                }
                (Source::Log(since), Condition::Event(event)) => {
                    let (moments, _) = moment.rig.log_since(since);
                    Some(moments.iter().any(|one| is_event(event, one)))
                }
                (Source::Contacts(since), Condition::Contact(contact)) => {
                    let mut since = contacts.since(*since);
                    Some(since.any(|one| is_contact(contact, one)))
                }
                _ => moment.reading(&self.condition)?.holds,
            },
        }
    }
}

impl Leaf {
    fn look(
        &mut self,
        condition: &Condition,
        moment: &Moment<'_>,
        contacts: &[emulators::world::Contact],
    ) {
        let held = || Reading {
            holds: Some(true),
            value: None,
        };
        self.moments.clear();
        match (&mut self.source, condition) {
            (Source::Line(watch), _) => {
                let mut watch = watch.lock();
                watch.pause(moment.rig.now());
                self.moments = watch.take_moments();
            }
            (Source::Log(since), Condition::Event(event)) => {
                let (new, lost) = moment.rig.log_since(since);
                *since = moment.rig.log_end();
                self.lost += lost;
                let of_source = new.iter().filter(|one| is_source(event, one));
                for one in of_source {
                    self.is_logged = true;
                    if near::misspelt(&event.rule, &[one.rule]).is_some() {
                        self.near = Some(one.rule.to_owned());
                    }
                }
                let new = new.iter().filter(|one| is_event(event, one));
                self.moments.extend(new.map(|one| (one.at, held())));
            }
            (Source::Contacts(_), Condition::Contact(contact)) => {
                let new = contacts.iter().filter(|one| is_contact(contact, one));
                let reading = |one: &emulators::world::Contact| Reading {
                    value: Some(((one.own_m_s * 1000.0).round() / 1000.0).into()),
                    ..held()
                };
                self.moments.extend(new.map(|one| (one.at, reading(one))));
            }
            _ => {
                self.now = moment.reading(condition);
                self.missing = match condition {
                    Condition::Register(register) if self.now.is_none() => {
                        Some(moment.missing_value(register).unwrap_or_default())
                    }
                    _ => None,
                };
            }
        }
    }

    /// Whether an entry of the wanted rule is possible: the source is known to log this rule, or
    /// the rules of the source are unknown and it has logged something.
    fn could_be_logged(&self) -> bool {
        match self.known {
            Known::Logged => true,
            Known::NeverLogged | Known::Misspelt(_) | Known::Undeclared => false,
            Known::OfOthers => self.is_logged,
            Known::Open => self.is_logged && self.near.is_none(),
        }
    }

    /// The reason for missing log entries of the event; `None` if there is no reason to name.
    fn silence_of_log(&self, event: &EventCondition) -> Option<String> {
        let rule = &event.rule;
        let source = event.source.as_deref();
        let of = source.unwrap_or("any device");
        let meant = match (self.known, &self.near) {
            (Known::Misspelt(meant), _) => Some(meant),
            (Known::Open | Known::Undeclared, near) => near.as_deref(),
            _ => None,
        };
        match (self.could_be_logged(), meant, source) {
            (true, ..) => None,
            (_, Some(meant), _) => Some(format!(
                "{rule} is no event of {of}, did you mean \"{meant}\"?"
            )),
            (_, None, None) => Some(format!("{rule} needs a source to be observed")),
            (_, None, Some(source)) if self.known == Known::NeverLogged => {
                Some(format!("{rule} is no event that {source} is known to log"))
            }
            (_, None, Some(source)) if self.known == Known::Undeclared => Some(format!(
                "it is unknown whether the program of {source} can log {rule}: list the names of its \
                 events in device.{source}.program.events"
            )),
            (_, None, Some(source)) => Some(format!("{source} logged nothing")),
        }
    }

    fn at(&self, (at, number): (Instant, usize)) -> Option<&Reading> {
        let mut same = self.moments.iter().filter(|(when, _)| *when == at);
        same.nth(number).map(|(_, reading)| reading)
    }
}

fn is_event(wanted: &EventCondition, logged: &LogMoment<'_>) -> bool {
    logged.rule == wanted.rule && is_source(wanted, logged)
}

/// Whether the entry comes from the wanted source. A condition without a source accepts any.
fn is_source(wanted: &EventCondition, logged: &LogMoment<'_>) -> bool {
    match &wanted.source {
        Some(source) => *source == logged.source,
        None => logged.rule == wanted.rule,
    }
}

fn is_contact(
    wanted: &crate::scenario::ContactCondition,
    contact: &emulators::world::Contact,
) -> bool {
    wanted
        .faster_than_m_s
        .is_none_or(|speed| contact.own_m_s > speed)
}

/// The moments of several conditions since the last update, in order, without repetition.
pub(super) fn moments_of<'a>(probes: impl Iterator<Item = &'a Probe>) -> Vec<(Instant, usize)> {
    let mut all = Vec::new();
    probes.for_each(|probe| probe.moments(&mut all));
    all.sort_unstable();
    all.dedup();
    all
}

/// The value of several parts: `decisive` if one part has this value, its opposite if all parts
/// have the opposite.
fn together(truths: &[Truth], decisive: bool) -> Truth {
    if truths.contains(&Some(decisive)) {
        return Some(decisive);
    }
    let opposite = Some(!decisive);
    truths
        .iter()
        .all(|truth| *truth == opposite)
        .then_some(!decisive)
}

#[cfg(test)]
mod tests;
