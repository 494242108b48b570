//! Messages of the PC to the robot, and handling of received ones.

use protocols::Instant;
use protocols::pcui::FRAME_MAX;
use protocols::pcui::diagnosis::Condition;
use protocols::pcui::message::{self, NO_WAYPOINT, Waypoint};

use super::record::News;
use super::wish::{Due, Wish};
use super::{Connection, Pc};
use crate::device::{EventKind, earliest};

impl Pc {
    /// Sends everything due now.
    pub(super) fn say(&mut self, now: Instant) {
        if matches!(self.connection, Connection::Connected(_)) {
            self.say_waypoints(now);
            self.say_order(now);
        }
    }

    fn say_waypoints(&mut self, now: Instant) {
        let Some(wish) = &mut self.waypoints else {
            return;
        };
        match wish.take_due(now) {
            Due::Nothing => {}
            Due::Say => {
                let mut frame = [0; FRAME_MAX];
                let known = self
                    .record
                    .waypoints
                    .as_ref()
                    .map_or(&[][..], |(_, list)| list);
                let len = encode_list(&wish.what, known, &mut frame);
                self.write(now, &frame[..len]);
            }
            Due::GiveUp => {
                let (count, tries) = (wish.what.len(), wish.tries());
                let detail = format!("{count} waypoints were not confirmed in {tries} tries");
                let rule = "waypoints-not-confirmed";
                self.log.violation(now, rule, detail, &[]);
            }
        }
    }

    fn say_order(&mut self, now: Instant) {
        let Some(wish) = &mut self.order else {
            return;
        };
        match wish.take_due(now) {
            Due::Nothing => {}
            Due::Say => {
                let mut frame = [0; FRAME_MAX];
                let len = message::encode_order(&wish.what, &mut frame).expect("twenty bytes");
                self.write(now, &frame[..len]);
            }
            Due::GiveUp => {
                let (mode, tries) = (wish.what.mode, wish.tries());
                let detail = format!("{mode:?} was not reported after {tries} tries");
                self.log.violation(now, "order-not-confirmed", detail, &[]);
            }
        }
    }

    pub(super) fn idle(&mut self, now: Instant) {
        let mut news = Vec::new();
        self.record.idle(now, |item| news.push(item));
        self.hear(now, &news);
    }

    pub(super) fn hear(&mut self, now: Instant, news: &[News]) {
        for item in news {
            self.connect(now);
            match item {
                News::MapProperties | News::Row | News::Nothing => {}
                News::Condition => self.note_condition(now),
                News::Victims => {
                    let detail = format!("{} victims", self.record.victims.len());
                    self.log.note(now, "victims", detail);
                }
                News::Message => {
                    let message = self.record.message.as_ref();
                    let detail = message.map(|(_, text)| text.clone()).unwrap_or_default();
                    self.log.note(now, "robot-message", detail);
                }
                News::MapSize => {
                    let map = self.record.map.as_ref().expect("its size is known");
                    let detail = format!("{} x {} cells", map.width, map.height);
                    self.log.note(now, "map-size", detail);
                }
                News::MapComplete => self.log.note(now, "map-complete", String::new()),
                News::Waypoints => self.compare_waypoints(now),
                News::State => self.compare_mode(now),
                News::BadSize => {
                    let kind = EventKind::Violation;
                    let detail = || "an invalid map size".to_owned();
                    self.log.repeated(now, kind, "bad-message", detail);
                }
                News::BadMessage(error) => {
                    let kind = EventKind::Violation;
                    self.log
                        .repeated(now, kind, "bad-message", || error.to_string());
                }
                News::BadRow(error) => {
                    let kind = EventKind::Violation;
                    self.log
                        .repeated(now, kind, "bad-row", || error.to_string());
                }
            }
        }
    }

    /// Writes the robot's report about itself to the log.
    fn note_condition(&mut self, now: Instant) {
        let Some((_, told)) = self.record.diagnosis else {
            return;
        };
        let conditions: Vec<&str> = told.conditions.iter().map(Condition::text).collect();
        let detail = format!("search {}; {}", told.search.text(), conditions.join(", "));
        self.log.note(now, "robot-says", detail);
    }

    /// The robot renumbers its waypoints, so only the positions are compared.
    fn compare_waypoints(&mut self, now: Instant) {
        let (Some(wish), Some((_, echo))) = (&mut self.waypoints, &self.record.waypoints) else {
            return;
        };
        let echo = echo.iter().map(|waypoint| waypoint.position_mm);
        if echo.eq(wish.what.iter().copied()) && wish.confirm(now) {
            let detail = format!("{} waypoints, sent {} times", wish.what.len(), wish.tries());
            self.log.note(now, "waypoints-confirmed", detail);
        }
    }

    fn compare_mode(&mut self, now: Instant) {
        let (Some(wish), Some((_, state))) = (&mut self.order, &self.record.state) else {
            return;
        };
        if state.mode == wish.what.mode && wish.confirm(now) {
            let detail = format!("{:?}, sent {} times", state.mode, wish.tries());
            self.log.note(now, "order-confirmed", detail);
        }
    }

    /// Time of the next message.
    pub(super) fn say_at(&self) -> Option<Instant> {
        let Connection::Connected(_) = self.connection else {
            return None;
        };
        let waypoints = self.waypoints.as_ref().and_then(Wish::due_at);
        let order = self.order.as_ref().and_then(Wish::due_at);
        earliest([waypoints, order])
    }

    /// Time at which all orders were confirmed; the beginning if there were none.
    pub(super) fn confirmed_at(&self) -> Option<Instant> {
        let waypoints = match &self.waypoints {
            Some(wish) => wish.confirmed_at()?,
            None => Instant::ZERO,
        };
        let order = match &self.order {
            Some(wish) => wish.confirmed_at()?,
            None => Instant::ZERO,
        };
        Some(waypoints.max(order))
    }
}

/// Writes `list` in the robot's format, numbered and chained in order; returns the length of the
/// frame.
///
/// A waypoint that the robot has reported keeps the robot's number; new ones get numbers that the
/// robot does not know.
fn encode_list(list: &[[i16; 2]], known: &[Waypoint], frame: &mut [u8; FRAME_MAX]) -> usize {
    let mut known: Vec<&Waypoint> = known.iter().collect();
    let mut fresh = known
        .iter()
        .map(|waypoint| waypoint.id.saturating_add(1))
        .max();
    let mut previous = NO_WAYPOINT;
    let numbered: Vec<Waypoint> = list
        .iter()
        .map(|&position_mm| {
            let told = known
                .iter()
                .position(|told| told.position_mm == position_mm);
            let id = told.map_or_else(
                || {
                    let id = fresh.unwrap_or(0);
                    fresh = Some(id.saturating_add(1));
                    id
                },
                |index| known.remove(index).id,
            );
            let waypoint = Waypoint {
                position_mm,
                layer: 0,
                id,
                previous,
            };
            previous = id;
            waypoint
        })
        .collect();
    message::encode_waypoints(numbered.into_iter(), frame)
        .expect("the length was checked with the script")
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocols::Decode;
    use protocols::pcui::{Decoder, Message};

    fn numbered(list: &[[i16; 2]], known: &[Waypoint]) -> Vec<(i16, i16)> {
        let mut frame = [0; FRAME_MAX];
        let len = encode_list(list, known, &mut frame);
        let frame = Decoder::default().push(&frame[..len]).next();
        let frame = frame.expect("whole").expect("valid");
        let Ok(Message::Waypoints(list)) = frame.message() else {
            panic!("no list");
        };
        list.iter().map(|one| (one.id, one.previous)).collect()
    }

    /// Seed report, chapter on waypoints: a waypoint inserted between two others leaves their
    /// numbers unchanged. The robot sent 7 and 9; two waypoints at one position are different ones.
    #[test]
    fn a_waypoint_put_between_two_leaves_them_their_numbers() {
        let told = |id, position_mm| Waypoint {
            position_mm,
            id,
            ..Waypoint::default()
        };
        let known = [told(7, [1, 1]), told(9, [3, 3])];
        let list = [[1, 1], [2, 2], [3, 3], [1, 1]];
        let expected = [(7, NO_WAYPOINT), (10, 7), (9, 10), (11, 9)];
        assert_eq!(numbered(&list, &known), expected);
        assert_eq!(numbered(&list[..2], &[]), [(0, NO_WAYPOINT), (1, 0)]);
    }
}
