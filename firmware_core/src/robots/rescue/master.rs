use protocols::{Instant, LineConfig, LineEvent, Port, avr, panel, pcui, xv11};

use super::{Phase, Rescue, WHEELS_WAIT};
use crate::{Master, Work};

impl Master for Rescue {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        if self.has_ended() {
            return;
        }
        match port {
            Self::LIDAR => {
                self.lidar.receive(now, bytes);
                self.pc.pass_on_raw_lidar(bytes);
            }
            Self::BASE => {
                self.drive.receive(now, bytes);
                self.attend_at = Instant::ZERO;
            }
            Self::RADIO if self.radio_setup.is_some() => {
                if let Some(setup) = &mut self.radio_setup {
                    setup.receive(now, bytes);
                }
                self.attend_at = Instant::ZERO;
            }
            Self::RADIO if self.switches.pc_link => {
                let mut input = bytes;
                while let Some(frame) = self.pc.receive(now, &mut input) {
                    self.obey(now, &frame);
                }
                self.attend_at = Instant::ZERO;
            }
            Self::RADIO => self.pc.receive_while_off(bytes),
            Self::DISPLAY => {
                if let Some(hit) = self.screen.receive(now, bytes) {
                    self.touched(now, hit);
                    self.attend_at = Instant::ZERO;
                }
            }
            _ => {}
        }
        if now >= self.attend_at {
            self.attend(now);
        }
    }

    fn line_event(&mut self, port: Port, _now: Instant, event: LineEvent) {
        self.attend_at = Instant::ZERO;
        match event {
            LineEvent::Break
            | LineEvent::FramingError
            | LineEvent::ParityError
            | LineEvent::Overrun => {
                self.counters.line_errors = self.counters.line_errors.saturating_add(1);
            }
            LineEvent::Opened | LineEvent::Closed => match port {
                Self::LIDAR => self.lidar.line_broke(),
                Self::RADIO => self.pc.line_broke(),
                _ => {}
            },
        }
    }

    fn poll(&mut self, now: Instant) {
        if self.has_ended() {
            return;
        }
        if now >= self.attend_at {
            self.attend(now);
        }
        if let Phase::Matched { since } = self.phase {
            self.mapper.search_time(now - since);
            self.navigate(now);
            self.phase = Phase::Waiting;
        }
        if self.phase == Phase::Waiting && self.lidar.has_turn() {
            self.phase = Phase::Reading { since: now };
            self.drive.read_wheels(now);
        }
        if let Phase::Reading { since } = self.phase {
            let is_read = self.drive.odometry.updated_at() >= Some(self.lidar.turn_end());
            if !self.lidar.has_turn() {
                self.phase = Phase::Waiting;
            } else if is_read || self.drive.is_silent() || now >= since + WHEELS_WAIT {
                self.map_turn();
                self.phase = Phase::Matched { since };
            }
        }
        // A program blocked by its lidar does nothing else (XV-08).
        if !self.lidar.is_blocked() {
            self.attend_at = self.next_attention();
        }
        self.refresh_screen(now);
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        match port {
            _ if self.has_ended() => 0,
            Self::BASE => self.drive.transmit(buf),
            Self::RADIO => match &mut self.radio_setup {
                Some(setup) => setup.transmit(buf),
                None => self.pc.transmit(buf),
            },
            Self::DISPLAY => self.screen.transmit(buf),
            Self::MOTOR if !buf.is_empty() => self.motor_duty.take().map_or(0, |duty| {
                buf[0] = duty;
                1
            }),
            _ => 0,
        }
    }

    fn may_send(&self, port: Port) -> bool {
        match port {
            Self::BASE => self.drive.has_output(),
            Self::RADIO => match &self.radio_setup {
                Some(setup) => setup.has_output(),
                None => self.pc.has_output(),
            },
            Self::DISPLAY => self.screen.has_output(),
            Self::MOTOR => self.motor_duty.is_some(),
            _ => false,
        }
    }

    fn poll_at(&self) -> Option<Instant> {
        if self.has_ended() {
            return None;
        }
        Some(match self.phase {
            Phase::Matched { .. } => Instant::ZERO,
            Phase::Waiting if self.lidar.has_turn() => Instant::ZERO,
            Phase::Reading { since } => {
                let is_read = self.drive.odometry.updated_at() >= Some(self.lidar.turn_end());
                if is_read {
                    Instant::ZERO
                } else {
                    self.attend_at.min(since + WHEELS_WAIT)
                }
            }
            Phase::Waiting => self.attend_at,
        })
    }

    fn line_config(&self, port: Port) -> LineConfig {
        if let (Self::RADIO, Some(setup)) = (port, &self.radio_setup) {
            return setup.line();
        }
        LineConfig::new_8n1(match port {
            Self::BASE => avr::BAUD,
            Self::RADIO => pcui::BAUD,
            Self::DISPLAY => panel::BAUD,
            _ => xv11::BAUD,
        })
    }

    fn take_work(&mut self) -> Work {
        core::mem::take(&mut self.work)
    }
}
