use protocols::pcui::message::{Message, Mode, Order, WaypointList};
use protocols::{Instant, pcui};

use super::{FOR_EVER, ORDER_HOLDS, Rescue, SET_POINT_MAX};

/// Orders of the PC.
impl Rescue {
    /// Executes a frame from the PC.
    pub(super) fn obey(&mut self, now: Instant, frame: &pcui::Frame) {
        match frame.message() {
            Ok(Message::Waypoints(list)) => self.take_waypoints(now, list),
            Ok(Message::Order(order)) => self.take_order(now, order),
            Ok(_) | Err(_) => self.pc.count_meaningless(),
        }
    }

    fn take_waypoints(&mut self, now: Instant, list: WaypointList<'_>) {
        let refused = self.waypoints.replace(list.iter());
        let refused = u32::try_from(refused).unwrap_or(u32::MAX);
        self.counters.refused_waypoints = self.counters.refused_waypoints.saturating_add(refused);
        self.pc.echo_waypoints();
        self.follow_waypoints(now);
    }

    /// Starts to drive if there are waypoints, stops if there are none any more.
    pub(super) fn follow_waypoints(&mut self, now: Instant) {
        match self.mode {
            Mode::Stop | Mode::Exploration if !self.waypoints.is_empty() => {
                self.set_mode(now, Mode::Waypoint);
            }
            Mode::Waypoint if self.waypoints.is_empty() => {
                let explores = self.own().explores_without_goal;
                let mode = if explores {
                    Mode::Exploration
                } else {
                    Mode::Stop
                };
                self.set_mode(now, mode);
            }
            _ => {}
        }
    }

    fn take_order(&mut self, now: Instant, order: Order) {
        self.ordered_at = now;
        let is_passing = order.mode == Mode::Manual && self.own().forgets_manual;
        if order.mode != self.mode && !is_passing {
            self.set_mode(now, order.mode);
        }
        if order.mode == Mode::Manual && !self.drive.is_silent() {
            let set_point = order
                .set_point
                .map(|wheel| wheel.clamp(-SET_POINT_MAX, SET_POINT_MAX));
            let holds = if self.order_ends() {
                ORDER_HOLDS
            } else {
                FOR_EVER
            };
            self.drive.command(now, set_point, now + holds);
        }
    }
}
