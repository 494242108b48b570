//! Input of the program: lines, frames and messages of its ports.

use core::time::Duration;

use alloc::vec::Vec;

use protocols::perception::{Marker, Message};
use protocols::tty::InputMode;
use protocols::{Decode as _, Instant, car_board, odometer};
use rosc::{OscMessage, OscPacket, OscType};

use super::{Apollo13, Board, CAMERA_AHEAD_M, FRONT_AHEAD_M, MISFITS_MAX, STUCK_M};
use crate::ackermann::{CarPose, Motion};
use crate::particles::Localiser;
use crate::robots::apollo13::wall::Side;
use crate::robots::apollo13::witness::{Finding, Told};

/// Maximum valid ultrasonic range, metres, as published by the fielded program.
const ULTRASOUND_MAX_M: f64 = 3.0;
/// Distance by which a silent odometer has counted less than the board, more than by chance,
/// metres: three pulses.
const MISSED_M: f64 = 0.08;
/// Minimum time between scans entered into the floor; the fielded costmap did it each 200 ms.
const SEE_EVERY: Duration = Duration::from_millis(100);
/// Minimum ultrasonic range ahead, metres, with which columns without a depth count as open floor.
const OPEN_M: f64 = 0.60;

/// Minimum fit of a scan at the car's true pose, unless a box that is on no map fills the picture.
const FIT_MIN: f64 = 0.35;
/// Number of unfitting scans after which some guesses are placed elsewhere, and the offsets:
/// metres, metres, radians. First for a failed gyroscope; 25 cm of path later for a carried car.
const SEARCHES: [(u8, [f64; 3]); 2] = [(5, [0.2, 0.2, 0.5]), (20, [1.0, 1.0, 0.3])];
/// Share of the guesses that are placed elsewhere.
const SEARCHED: f64 = 0.05;

impl Apollo13 {
    pub(super) fn hear_board(&mut self, bytes: &[u8]) {
        let mode = match self.config.defects.reads_cr_as_nl {
            true => InputMode::CrToNl,
            false => InputMode::Raw,
        };
        let mut frames = Vec::new();
        for byte in bytes.iter().map(|byte| mode.read(*byte)) {
            match &mut self.board {
                Board::Fielded(decoder) => frames.extend(decoder.push(byte)),
                Board::Sound(decoder) => {
                    for outcome in decoder.push(&[byte]) {
                        match outcome {
                            Ok(frame) => frames.push(frame),
                            Err(_) => self.counters.bad_frames += 1,
                        }
                    }
                }
            }
        }
        self.board_heard = Some(self.now);
        frames
            .into_iter()
            .for_each(|frame| self.take_readings(frame.readings()));
    }

    /// Releases a received frame after a quiet line.
    pub(super) fn let_board_idle(&mut self) {
        let is_quiet = |heard| self.now - heard >= car_board::IDLE_GAP;
        if !self.board_heard.is_some_and(is_quiet) {
            return;
        }
        self.board_heard = None;
        let Board::Sound(decoder) = &mut self.board else {
            return;
        };
        decoder.idle();
        let frames: Vec<_> = decoder.push(&[]).collect();
        for outcome in frames {
            match outcome {
                Ok(frame) => self.take_readings(frame.readings()),
                Err(_) => self.counters.bad_frames += 1,
            }
        }
    }

    fn take_readings(&mut self, readings: car_board::Readings) {
        self.counters.frames += 1;
        if self.is_stuck(readings) {
            return;
        }
        self.board_read = Some(self.now);
        self.take_pulses(readings.hall);
        self.battery_mv = readings.battery_mv;
        let words = [readings.front_cm, readings.right_cm, readings.left_cm];
        for (slot, word) in self.ultrasound_m.iter_mut().zip(words) {
            // 0: nothing new.
            if word > 0 {
                let range_m = f64::from(word) / 100.0;
                *slot = (range_m <= ULTRASOUND_MAX_M).then_some(range_m);
            }
        }
        if let (Some(range_m), true) = (self.ultrasound_m[0], readings.front_cm > 0) {
            let sensor = self.pose().shifted(FRONT_AHEAD_M);
            self.floor.hear(self.now, sensor, range_m);
        }
        self.steer_along_wall(readings);
    }

    /// Whether the board has reported the same readings over a distance in which its pulses should
    /// have changed.
    fn is_stuck(&mut self, readings: car_board::Readings) -> bool {
        let at = self.odometry.pose();
        match self.same {
            Some((same, since)) if same == readings => {
                let way = since.motion_to(at);
                libm::hypot(way.ahead_m, way.left_m) > STUCK_M
            }
            _ => {
                self.same = Some((readings, at));
                false
            }
        }
    }

    fn steer_along_wall(&mut self, readings: car_board::Readings) {
        let (Some(wall), Some((side, _))) = (&mut self.wall, self.config.wall) else {
            return;
        };
        let word = match side {
            Side::Left => readings.left_cm,
            Side::Right => readings.right_cm,
        };
        if word == 0 {
            return;
        }
        let before = self.wall_heard.replace(self.now);
        let passed_s = before.map_or(0.067, |before| (self.now - before).as_secs_f64());
        self.wall_angle_rad = wall.update(f64::from(word) / 100.0, passed_s);
    }

    pub(super) fn hear_odometer(&mut self, bytes: &[u8]) {
        let lines: Vec<_> = self.lines.push(bytes).flatten().collect();
        for line in lines {
            let content = line.content();
            // A terminal driver that converts CR to LF makes each second line empty.
            if content.is_empty() {
                continue;
            }
            let is_taken = !self.config.defects.sums_exactly || odometer::passes_exact_sum(content);
            let reading = match self.config.dialect {
                Some(dialect) => dialect.read(content).ok().filter(|_| is_taken),
                None => odometer::Raw::read(content)
                    .ok()
                    .map(|raw| self.raw_lines.read(&raw)),
            };
            match reading {
                Some(reading) => {
                    self.counters.lines += 1;
                    self.take_line(reading);
                }
                None => self.counters.bad_lines += 1,
            }
        }
    }

    fn take_line(&mut self, reading: odometer::Reading) {
        let before = self.pose();
        // The odometer's clock falls back at a reset.
        let is_reset = reading.time_s < self.odometer_s;
        let has_missed = self.watch.is_silent(self.now) && self.has_missed_way(reading.distance_m);
        self.watch.hear(self.now, is_reset);
        // Ignore a gyroscope whose offset was measured while the car turned.
        if is_reset || has_missed || self.watch.is_misled() {
            self.bridge();
            self.odometry.begin_anew();
            self.gyro.begin_anew();
        } else {
            // The odometer kept counting while its lines were lost, and counts better than the
            // board.
            self.odometry.clone_from(&self.at_line.0);
        }
        self.odometer_s = reading.time_s;
        let way_m = self.odometry.update(reading.distance_m, reading.yaw_rad);
        self.steered = self.steered.then(self.by_board.arc(way_m));
        self.turn_as_steered(reading);
        self.at_line = (self.odometry.clone(), self.by_board.pose_at(self.now));
        self.gates.moved(before, self.pose());
    }

    /// Whether a silent odometer has counted less than the board since its last line: during the
    /// gyroscope's calibration it does not read its encoder.
    fn has_missed_way(&self, travel_m: f64) -> bool {
        let (odometry, board) = &self.at_line;
        let by_board = board.motion_to(self.by_board.pose_at(self.now));
        odometry.counted_m(travel_m).abs() + MISSED_M
            < libm::hypot(by_board.ahead_m, by_board.left_m)
    }

    /// Replaces the turn of a stuck gyroscope by that of the steering. The other dialects round the
    /// rate too coarsely to detect a stuck one.
    fn turn_as_steered(&mut self, reading: odometer::Reading) {
        if self.config.dialect != Some(odometer::Dialect::Fixed) {
            return;
        }
        let turn_rad = self.gyro.hear(reading, self.by_board.steering_rad());
        if turn_rad != 0.0 {
            self.odometry.bridge(Motion {
                turn_rad,
                ..Motion::default()
            });
        }
    }

    /// Takes pulses of the board, which bridge gaps of the odometer.
    fn take_pulses(&mut self, pulses: u16) {
        if self.by_board.hear(self.now, pulses) {
            self.watch.roll(self.now);
        }
        let before = self.pose();
        match self.watch.is_silent(self.now) {
            true => {
                self.bridge();
                self.witness.begin(self.told());
            }
            false => self.compare(),
        }
        self.gates.moved(before, self.pose());
    }

    /// Notes the command sent to the board: it gives the direction of the following pulses.
    pub(super) fn note_command(&mut self) {
        let was_backwards = self.by_board.is_backwards();
        self.by_board.command(self.drive);
        if self.by_board.is_backwards() != was_backwards {
            self.witness.turn_round(self.told());
        }
    }

    /// Compares the motions of the odometer and the board, which must agree.
    fn compare(&mut self) {
        let finding = self.witness.compare(self.told());
        self.counters.doubts += u64::from(finding.is_some());
        match finding {
            Some(Finding::Way(told, other)) => {
                self.odometry.bridge(told.inverse());
                self.odometry.bridge(other);
                self.at_line = (self.odometry.clone(), self.by_board.pose());
                self.witness.begin(self.told());
            }
            Some(Finding::Turn(told, other)) => {
                self.doubt_turn(told, other);
            }
            None => {}
        }
    }

    fn told(&self) -> Told {
        Told {
            now: self.now,
            odometer: self.odometry.pose(),
            board: self.by_board.pose(),
            steered: self.steered,
            is_backwards: self.by_board.is_backwards(),
        }
    }

    /// Applies the board's motion since the last line.
    fn bridge(&mut self) {
        let (odometry, board) = &self.at_line;
        let motion = board.motion_to(self.by_board.pose_at(self.now));
        self.odometry.clone_from(odometry);
        self.odometry.bridge(motion);
    }

    pub(super) fn see(&mut self, message: &[u8]) {
        match Message::decode(message) {
            Ok(Message::DepthRow(row)) => {
                self.sight.take_row(&row);
                self.take_sight();
            }
            Ok(Message::Scan(scan)) => {
                self.sight.take_scan(&scan);
                self.take_sight();
            }
            Ok(Message::Marker(marker)) => self.take_marker(marker),
            Err(_) => self.counters.bad_messages += 1,
        }
    }

    /// Uses the camera's scan: corrects the car's pose and enters obstacles.
    fn take_sight(&mut self) {
        self.counters.scans += 1;
        if self.sight.has_reading() || !self.is_open_ahead() {
            self.camera.see(self.now);
        }
        if self.survey.is_some() {
            self.sight.put_points(CAMERA_AHEAD_M, &mut self.scan);
            return self.survey_sight();
        }
        let at = self.odometry.pose();
        let is_due = |localiser: &Localiser| localiser.is_due(at);
        let is_new = self.localiser.as_ref().is_some_and(is_due);
        let is_old = |seen: Instant| self.now - seen >= SEE_EVERY;
        let is_to_be_entered = self.seen.is_none_or(is_old);
        if !is_new && !is_to_be_entered {
            return;
        }
        self.sight.put_points(CAMERA_AHEAD_M, &mut self.scan);
        let beams = self.sight.beams(self.is_open_ahead());
        if let Some(localiser) = &mut self.localiser
            && localiser.update(at, &beams)
        {
            let pose = localiser.estimate().pose;
            self.correct(pose);
            self.judge_fit();
        }
        if is_to_be_entered {
            self.seen = Some(self.now);
            let camera = self.pose().shifted(CAMERA_AHEAD_M);
            self.floor.see(camera, &beams);
        }
    }

    /// Counts unfitting scans: after a while the car may be elsewhere.
    fn judge_fit(&mut self) {
        let Some(localiser) = &mut self.localiser else {
            return;
        };
        let was_lost = self.misfits >= MISFITS_MAX;
        self.misfits = match localiser.fit() < FIT_MIN {
            true => (self.misfits + 1).min(MISFITS_MAX),
            false => self.misfits.saturating_sub(2),
        };
        self.counters.lost += u64::from(!was_lost && self.misfits == MISFITS_MAX);
        let search = SEARCHES
            .iter()
            .rev()
            .find(|(misfits, _)| self.misfits >= *misfits);
        if let Some((_, sigma)) = search {
            localiser.search(SEARCHED, *sigma);
        }
    }

    /// Whether the floor ahead is open: no obstacle is nearer than the camera's minimum range.
    fn is_open_ahead(&self) -> bool {
        self.ultrasound_m[0].is_none_or(|range_m| range_m > OPEN_M)
    }

    fn take_marker(&mut self, marker: Marker) {
        // The camera's axes: to the right, down, ahead.
        let [right, _, ahead] = marker.place_mm.map(|mm| f64::from(mm) / 1e3);
        let place = self.pose().shifted(CAMERA_AHEAD_M).then(Motion {
            ahead_m: ahead,
            left_m: -right,
            turn_rad: 0.0,
        });
        self.gates.see(marker.id.into(), [place.x_m, place.y_m]);
        // A marker's post may be lower than the camera, so the camera must not clear it.
        let places = self.gates.markers().map(|(_, place)| place);
        self.floor.stand(places);
    }

    pub(super) fn hear_phone(&mut self, packet: &[u8]) {
        match rosc::decoder::decode_udp(packet) {
            Ok(([], packet)) => self.take_packet(packet, 0),
            // Bytes after a packet count as well: a datagram holds one packet.
            _ => self.counters.bad_packets += 1,
        }
    }

    fn take_packet(&mut self, packet: OscPacket, depth: u8) {
        match packet {
            OscPacket::Message(message) => match self.take_message(&message) {
                true => self.counters.packets += 1,
                false => self.counters.bad_packets += 1,
            },
            // Bundles may contain bundles, but no real client nests them deeply.
            OscPacket::Bundle(bundle) if depth < 8 => {
                for inner in bundle.content {
                    self.take_packet(inner, depth + 1);
                }
            }
            OscPacket::Bundle(_) => self.counters.bad_packets += 1,
        }
    }

    /// Takes a message: a control of the phone, or an order that in the seed is given by mouse on
    /// the PC. Such an order is a goal or a pose: x and y in metres and a heading in radians.
    fn take_message(&mut self, message: &OscMessage) -> bool {
        let values: Option<Vec<f32>> = message.args.iter().map(number).collect();
        let Some(values) = values else {
            return false;
        };
        let pose = |values: &[f32]| match values {
            [x, y, heading] if values.iter().all(|value| value.is_finite()) => Some(CarPose {
                x_m: f64::from(*x),
                y_m: f64::from(*y),
                heading_rad: crate::ackermann::wrapped(f64::from(*heading)),
            }),
            _ => None,
        };
        match (message.addr.as_str(), &values[..]) {
            ("/goal", []) => self.set_goal(None),
            ("/goal", values) => match pose(values) {
                // A repeated goal: clients repeat it because packets are lost.
                Some(goal) if self.pilot.is_after(goal) => {}
                Some(goal) => self.set_goal(Some(goal)),
                None => return false,
            },
            ("/pose", values) => match pose(values) {
                Some(pose) => self.set_pose(pose),
                None => return false,
            },
            (address, []) => return self.arbiter.hear(self.now, address, 0.0),
            (address, [value, ..]) if value.is_finite() => {
                return self.arbiter.hear(self.now, address, *value);
            }
            _ => return false,
        }
        true
    }
}

/// A number of a message, of any type.
fn number(value: &OscType) -> Option<f32> {
    #[expect(clippy::cast_possible_truncation, reason = "controls need few digits")]
    match value {
        OscType::Float(value) => Some(*value),
        OscType::Double(value) => Some(*value as f32),
        OscType::Int(value) => Some(*value as f32),
        OscType::Bool(value) => Some(f32::from(u8::from(*value))),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
