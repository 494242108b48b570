//! Checks that the robot stops when a link that it needs falls silent.

use core::time::Duration;
use std::sync::Arc;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::Calm;
use super::eyes::Eyes;
use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::robots::{Instruments, Need};
use crate::scenario::FaultSpec;

/// Time to brake: the wheels of the built-in robots stand after 0.3 s.
const BRAKES: Duration = Duration::from_millis(500);
/// Maximum speed of a resting robot, m/s and rad/s: noise of the drive train.
const REST_M_S: f64 = 0.03;
const REST_RAD_S: f64 = 0.15;
/// Time within which commands have reached the drive's device. Without them, while a fault acts on
/// the drive, the program cannot stop the robot; `motors-stop-after-silence` covers that case.
const COMMANDS: Duration = Duration::from_millis(300);

/// The robot rests after a link that it needs has been silent for too long.
pub struct RestsAfterSilence {
    watched: Vec<Watched>,
    /// Turns of the lidar that show a distance.
    eyes: Option<Eyes>,
    instruments: Option<Arc<dyn Instruments>>,
    drive: Vec<String>,
    /// Whether a fault acts on the drive.
    calm: Calm,
    within: Duration,
    commanded: Heard,
    /// Last time with a set-point other than 0.
    driven_at: Instant,
    has_moved: bool,
}

/// Time of the last bytes.
#[derive(Clone, Copy, Debug)]
struct Heard {
    delivered: u64,
    at: Instant,
}

impl Heard {
    const NEVER: Self = Self {
        delivered: 0,
        at: Instant::ZERO,
    };

    /// Updates the count at `now`; returns the time since the last bytes.
    fn take(&mut self, now: Instant, delivered: u64) -> Duration {
        if delivered != self.delivered {
            (self.delivered, self.at) = (delivered, now);
        }
        now - self.at
    }
}

#[derive(Clone, Debug)]
struct Watched {
    need: Need,
    heard: Heard,
    /// Time since which the robot moves although it must not, while commands reach its drive.
    moving_since: Option<Instant>,
    /// Whether the robot needed the link when its silence began: a robot may change its mode then.
    was_needed: bool,
    /// Time since which the robot is in a mode that needs the link.
    needed_since: Option<Instant>,
    /// Number of silences during which the robot had time to stop, and whether the current one
    /// counts.
    silences: u64,
    is_counted: bool,
    broken: Option<(Instant, Duration)>,
}

impl RestsAfterSilence {
    /// Observes a robot that must rest when a link in `needs` has been silent for the time
    /// `within`. `drive` are the links that carry the commands to its drive; `calm` knows the times
    /// in which no fault acts on them.
    pub fn new(needs: Vec<Need>, drive: Vec<String>, calm: Calm, within: Duration) -> Self {
        let watched = needs.into_iter().map(|need| Watched {
            need,
            heard: Heard::NEVER,
            moving_since: None,
            was_needed: false,
            needed_since: None,
            silences: 0,
            is_counted: false,
            broken: None,
        });
        Self {
            watched: watched.collect(),
            eyes: None,
            instruments: None,
            drive,
            calm,
            within,
            commanded: Heard::NEVER,
            driven_at: Instant::ZERO,
            has_moved: false,
        }
    }

    /// Also treats a lidar as silent if its turns show no distance.
    #[must_use]
    pub fn with_eyes(mut self, rig: &mut Rig, instruments: &Arc<dyn Instruments>) -> Self {
        self.eyes = Eyes::open(rig, &**instruments);
        self.instruments = Some(Arc::clone(instruments));
        self
    }

    /// Number of bytes that the robot received on `link`. For the link of its lidar, the number of
    /// turns with a distance, if such turns are known.
    fn heard_on(&self, rig: &Rig, link: &str) -> u64 {
        let eyes = self.eyes.as_ref().filter(|eyes| eyes.link() == link);
        let turns = eyes.map(Eyes::turns).filter(|turns| *turns > 0);
        let bytes = || delivered(rig, link, Direction::ToMaster);
        turns.map_or_else(bytes, |turns| match self.may_see_nothing(rig) {
            true => turns + bytes(),
            false => turns + eyes.map_or(0, Eyes::damaged),
        })
    }

    /// Whether the robot is nearer to an obstacle than its scanner measures.
    fn may_see_nothing(&self, rig: &Rig) -> bool {
        let instruments = self.instruments.as_ref();
        let below = instruments.and_then(|instruments| instruments.blind_below_m());
        below.is_some_and(|below| rig.world.clearance_up_to(below) < below)
    }
}

/// Time in which a robot whose set-points are 0 may roll out: a board without supply does not
/// brake.
const ROLLS_OUT: Duration = Duration::from_secs(2);

/// Whether the robot moves by itself: a person who touches it may push it while its set-points are
/// 0.
pub(super) fn moves_itself(look: &Look<'_>) -> bool {
    let world = &look.rig.world;
    let is_moving = world.speed().abs() > REST_M_S || world.turn_rate().abs() > REST_RAD_S;
    is_moving && !is_pushed(look)
}

/// Whether something touches the robot while its set-points are 0.
pub(super) fn is_pushed(look: &Look<'_>) -> bool {
    look.rig.world.is_touching() && !look.is_driven()
}

fn delivered(rig: &Rig, link: &str, direction: Direction) -> u64 {
    let link = rig.link(link);
    link.map_or(0, |link| link.line(direction).traffic().delivered)
}

impl Checker for RestsAfterSilence {
    fn observe(&mut self, look: &Look<'_>) {
        let (rig, now) = (look.rig, look.rig.now());
        let sent = self.drive.iter();
        let sent = sent.map(|link| delivered(rig, link, Direction::ToDevice));
        let unreached = self.commanded.take(now, sent.sum());
        let is_reached = self.drive.is_empty() || unreached < COMMANDS || self.calm.is(now);
        let is_moving = moves_itself(look);
        self.has_moved |= is_moving;
        let is_driven = look.axes.is_empty() || look.is_driven();
        if is_driven {
            self.driven_at = now;
        }
        let is_moving = is_moving && (is_driven || now - self.driven_at > ROLLS_OUT);
        let mode = rig.program().map(|program| program.mode());
        let heard = self.watched.iter();
        let heard: Vec<u64> = heard
            .map(|one| self.heard_on(rig, &one.need.link))
            .collect();
        for (one, count) in self.watched.iter_mut().zip(heard) {
            let silence = one.heard.take(now, count);
            let limit = self.within.max(one.need.stops_after) + BRAKES;
            let is_silent = silence > limit;
            let is_needed = one.need.is_needed(mode);
            if silence <= BRAKES {
                one.was_needed = is_needed;
            }
            let is_judged = is_silent && is_reached && (is_needed || one.was_needed);
            let is_observed = is_judged && self.has_moved;
            one.silences += u64::from(is_observed && !one.is_counted);
            one.is_counted = is_silent && (one.is_counted || is_observed);
            // A robot that begins to need a silent link has the same time to stop.
            let needed_since = one.needed_since.filter(|_| is_needed);
            let needed_since = *one.needed_since.insert(needed_since.unwrap_or(now));
            let has_had_time = now - needed_since > limit;
            let is_wrong = is_silent && has_had_time && is_moving && is_reached && is_needed;
            if !is_wrong {
                one.moving_since = None;
                continue;
            }
            let since = *one.moving_since.get_or_insert(now);
            if now - since >= COMMANDS && one.broken.is_none() {
                one.broken = Some((now, silence));
            }
        }
    }

    fn verdict(&self) -> Check {
        let name = "rests-after-silence";
        if self.watched.is_empty() {
            let detail = "the robot names no link that it needs; set rests_without";
            return Check::not_observed(name, detail);
        }
        let broken = self.watched.iter().find_map(|one| Some((one, one.broken?)));
        let silences: u64 = self.watched.iter().map(|one| one.silences).sum();
        let observed = self.watched.iter().filter(|one| one.silences > 0);
        let links: Vec<&str> = observed.map(|one| &*one.need.link).collect();
        let detail = match broken {
            Some((one, (at, silence))) => format!(
                "still moving at {at} s, {:.1} s after the last byte of {}",
                silence.as_secs_f64(),
                one.need.link
            ),
            None if silences == 0 => "no silence of a link that the moving robot needs".to_owned(),
            None => format!(
                "at rest in each of {silences} silences of {}",
                links.join(", ")
            ),
        };
        let check = Check::new(name, broken.is_none(), detail);
        check.if_observed(silences > 0)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        self.calm.renew(faults, rig);
    }

    fn fork(&self, rig: &mut Rig) -> Option<Box<dyn Checker>> {
        let eyes = self.eyes.as_ref().zip(self.instruments.as_ref());
        Some(Box::new(Self {
            watched: self.watched.clone(),
            eyes: eyes.and_then(|(eyes, instruments)| eyes.fork(rig, &**instruments)),
            instruments: self.instruments.clone(),
            drive: self.drive.clone(),
            calm: self.calm.clone(),
            ..*self
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_silence_begins_with_the_last_bytes() {
        let at = Instant::from_millis;
        let mut heard = Heard::NEVER;
        let silences = [(100, 0), (200, 5), (300, 5), (400, 6), (900, 6)];
        let silences = silences.map(|(millis, count)| heard.take(at(millis), count).as_millis());
        assert_eq!(silences, [100, 0, 100, 0, 500]);
    }
}
