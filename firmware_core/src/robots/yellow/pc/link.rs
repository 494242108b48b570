//! The PC's side of the telemetry link: received messages, sent commands, repeated requests.

use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec::Vec;
use core::time::Duration;

use protocols::telemetry::message::{State, Telecommand, Telemetry};
use protocols::telemetry::{self, Decoder, Frame};
use protocols::{Decode, Instant};

use super::Failure;
use super::config::{PcConfig, Sending};
use crate::local_map::Segment;
use crate::pose::{Point, Pose, normalised};

/// Time without a frame after which the robot counts as silent; it sends each 200 ms. YE13: known
/// within 1 s.
const SILENT: Duration = Duration::from_millis(900);
/// Idle time after which a partial frame is discarded: no byte of a frame comes so late.
const QUIET: Duration = Duration::from_millis(100);
/// Longest telecommand with all its fields, and the frame around it.
const COMMAND_MAX: usize = 256;
const FRAME_MAX: usize = 2 * COMMAND_MAX + 8;
/// Maximum number of bytes that wait for the wire.
const OUT_MAX: usize = 16_384;
/// Maximum number of commands that wait for a frame.
const QUEUE_MAX: usize = 64;
/// Time per byte in the fielded program.
const BYTE_PAUSE: Duration = Duration::from_millis(1);

/// A message of the robot.
#[derive(Clone, Debug)]
pub(super) struct Heard {
    pub(super) at: Instant,
    /// Number of the message, from 1.
    pub(super) number: u64,
    pub(super) message: Box<Telemetry>,
}

impl Heard {
    /// The robot's own report of its state.
    pub(super) fn state(&self) -> Option<State> {
        self.message.state
    }

    /// The robot's reported pose.
    pub(super) fn pose(&self) -> Option<Pose> {
        pose_of(&self.message)
    }
}

/// The robot's pose of a message, in our units.
fn pose_of(message: &Telemetry) -> Option<Pose> {
    let pose = message.odometry.as_ref()?.pose;
    let pose = Pose::new(pose.x * 1_000.0, pose.y * 1_000.0, pose.alpha);
    let is_sound = pose.x_mm.is_finite() && pose.y_mm.is_finite() && pose.heading.is_finite();
    is_sound.then_some(pose)
}

/// A pose in the link's units.
pub(super) fn wire_pose(pose: Pose) -> telemetry::message::Pose {
    telemetry::message::Pose {
        x: pose.x_mm / 1_000.0,
        y: pose.y_mm / 1_000.0,
        alpha: pose.heading,
    }
}

/// A scan of the robot, with its pose.
#[derive(Clone, Debug)]
pub(super) struct Sight {
    number: u64,
    pub(super) pose: Pose,
    pub(super) lines: Vec<Segment>,
}

/// Minimum correction that is sent.
const CORRECTION_MM: f32 = 5.0;
const CORRECTION_RAD: f32 = 0.005;

impl Sight {
    /// A test's scan from `pose`.
    #[cfg(test)]
    pub(super) const fn of(pose: Pose, lines: Vec<Segment>) -> Self {
        Self {
            number: 0,
            pose,
            lines,
        }
    }

    /// Whether the robot's true `pose` differs enough from its believed one to be sent.
    pub(super) fn is_off(&self, pose: Pose) -> bool {
        let shift = pose.position().distance_mm(self.pose.position());
        let turn = normalised(pose.heading - self.pose.heading).abs();
        shift >= CORRECTION_MM || turn >= CORRECTION_RAD
    }
}

/// Kind of a command for the fielded program's queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// A request of a state, of lines or of another pose.
    Request,
    /// A goal or speeds.
    Drive,
}

/// Counters of the link.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Counts {
    pub(super) frames: u64,
    pub(super) bad_frames: u64,
    pub(super) bad_messages: u64,
    pub(super) commands: u64,
    pub(super) resends: u64,
    pub(super) requests: u64,
    pub(super) lost_in_queue: u64,
    pub(super) silences: u64,
}

/// The PC's end of the link.
#[derive(Clone, Debug)]
pub(super) struct Link {
    sending: Sending,
    decoder: Decoder,
    last_byte: Instant,
    heard: Option<Heard>,
    sight: Option<Sight>,
    is_silent: bool,
    queue: VecDeque<Telecommand>,
    out: VecDeque<u8>,
    /// Number of bytes of `out` that may be sent.
    released: usize,
    next_byte: Instant,
    pub(super) counts: Counts,
}

impl Link {
    pub(super) fn new(config: &PcConfig) -> Self {
        Self {
            sending: config.sending,
            decoder: Decoder::new(config.framing),
            last_byte: Instant::ZERO,
            heard: None,
            sight: None,
            is_silent: false,
            queue: VecDeque::new(),
            out: VecDeque::new(),
            released: 0,
            next_byte: Instant::ZERO,
            counts: Counts::default(),
        }
    }

    /// The last message.
    pub(super) const fn heard(&self) -> Option<&Heard> {
        self.heard.as_ref()
    }

    /// The number of the last message, 0 without one.
    pub(super) fn number(&self) -> u64 {
        self.heard.as_ref().map_or(0, |heard| heard.number)
    }

    /// The last message, if it came after the one of `number`.
    pub(super) fn heard_since(&self, number: u64) -> Option<&Heard> {
        self.heard.as_ref().filter(|heard| heard.number > number)
    }

    /// The last lines.
    pub(super) const fn sight(&self) -> Option<&Sight> {
        self.sight.as_ref()
    }

    /// The last lines, if they came after the message of `number`.
    pub(super) fn sight_since(&self, number: u64) -> Option<&Sight> {
        self.sight.as_ref().filter(|sight| sight.number > number)
    }

    /// Whether the robot has sent messages before, but none recently.
    pub(super) const fn is_silent(&self) -> bool {
        self.is_silent
    }

    /// Whether requests are sent only once.
    pub(super) const fn asks_once(&self) -> bool {
        self.sending.ask_once
    }

    pub(super) fn receive(&mut self, now: Instant, bytes: &[u8]) {
        if self.decoder.pending() > 0 && now - self.last_byte > QUIET {
            self.decoder.idle();
        }
        self.last_byte = now;
        let mut input = bytes;
        while let Some(outcome) = self.decoder.step(&mut input) {
            match outcome {
                Ok(frame) => self.take(now, &frame),
                Err(_) => self.counts.bad_frames += 1,
            }
        }
    }

    fn take(&mut self, now: Instant, frame: &Frame) {
        self.counts.frames += 1;
        let Ok(message) = Telemetry::decode(frame.payload()) else {
            self.counts.bad_messages += 1;
            return;
        };
        let number = self.number() + 1;
        if let (Some(lines), Some(pose)) = (&message.lines, pose_of(&message)) {
            let point = |end: telemetry::message::Pose| Point::new(end.x, end.y);
            let lines = lines.iter();
            let lines = lines.map(|line| Segment::new(point(line.start), point(line.end)));
            self.sight = Some(Sight {
                number,
                pose,
                lines: lines.filter(|line| line.length_mm().is_finite()).collect(),
            });
        }
        self.is_silent = false;
        self.heard = Some(Heard {
            at: now,
            number,
            message: Box::new(message),
        });
        if self.sending.one_per_frame
            && let Some(command) = self.queue.pop_front()
        {
            self.write(&command);
        }
    }

    /// Performs due actions.
    pub(super) fn poll(&mut self, now: Instant) {
        self.decoder.read_done();
        let quiet = self.heard.as_ref().map(|heard| now - heard.at);
        if !self.is_silent && quiet.is_some_and(|quiet| quiet >= SILENT) {
            self.is_silent = true;
            self.counts.silences += 1;
        }
        if !self.sending.one_per_frame {
            while let Some(command) = self.queue.pop_front() {
                self.write(&command);
            }
        }
        if !self.sending.byte_per_ms {
            self.released = self.out.len();
        } else if now >= self.next_byte && self.released < self.out.len() {
            self.released += 1;
            self.next_byte = now + BYTE_PAUSE;
        }
    }

    pub(super) fn poll_at(&self) -> Option<Instant> {
        let silence = self.heard.as_ref().map(|heard| heard.at + SILENT);
        let byte = (self.released < self.out.len()).then_some(self.next_byte);
        let silence = silence.filter(|_| !self.is_silent);
        silence.into_iter().chain(byte).min()
    }

    /// Sends a command, or queues it as the fielded program does.
    pub(super) fn send(&mut self, now: Instant, kind: Kind, command: Telecommand) {
        self.counts.commands += 1;
        if self.sending.requests_clear_queue && kind == Kind::Request {
            self.counts.lost_in_queue += self.queue.len() as u64;
            self.queue.clear();
        }
        if self.queue.len() == QUEUE_MAX {
            self.counts.lost_in_queue += 1;
            return;
        }
        let timestamp_ms = u32::try_from(now.as_millis()).unwrap_or(u32::MAX);
        self.queue.push_back(Telecommand {
            timestamp_ms,
            ..command
        });
    }

    fn write(&mut self, command: &Telecommand) {
        let mut payload = [0; COMMAND_MAX];
        let mut frame = [0; FRAME_MAX];
        let written = command.encode(&mut payload).ok();
        let framed = written.and_then(|len| telemetry::encode(&payload[..len], &mut frame).ok());
        match framed.filter(|len| self.out.len() + len <= OUT_MAX) {
            Some(len) => self.out.extend(&frame[..len]),
            None => self.counts.lost_in_queue += 1,
        }
    }

    pub(super) fn transmit(&mut self, buf: &mut [u8]) -> usize {
        let count = buf.len().min(self.released);
        for (slot, byte) in buf.iter_mut().zip(self.out.drain(..count)) {
            *slot = byte;
        }
        self.released -= count;
        count
    }
}

/// A command that is repeated until its effect is seen.
#[derive(Clone, Debug)]
pub(super) struct Request {
    command: Telecommand,
    /// Number of the last message before the first sending.
    since: u64,
    wait: Duration,
    due: Option<Instant>,
    sent: u32,
}

/// Maximum number of times that a request is sent: with 30 % of commands lost, one in 17 millions
/// fails.
const SENT_MAX: u32 = 14;
/// Timeout of an answer: it comes with the next message, within 200 ms and the time of its bytes.
const ANSWER: Duration = Duration::from_millis(700);
/// Timeout of a change of state: drivers take 500 ms to switch on or off, and the next message
/// reports it.
const SWITCHED: Duration = Duration::from_millis(1_200);

impl Request {
    /// A request that the next message answers.
    pub(super) const fn new(link: u64, command: Telecommand) -> Self {
        Self {
            command,
            since: link,
            wait: ANSWER,
            due: None,
            sent: 0,
        }
    }

    /// A request of another state.
    pub(super) const fn of_state(link: u64, command: Telecommand) -> Self {
        let mut request = Self::new(link, command);
        request.wait = SWITCHED;
        request
    }

    /// A request to rest.
    pub(super) fn to_rest(link: &Link) -> Self {
        let state = Some(State::Off);
        let command = Telecommand {
            state,
            ..Telecommand::default()
        };
        Self::of_state(link.number(), command)
    }

    /// The number of the last message before the first sending.
    pub(super) const fn since(&self) -> u64 {
        self.since
    }

    /// Whether the request was sent.
    pub(super) const fn is_sent(&self) -> bool {
        self.sent > 0
    }

    /// Sends the request, and repeats it when no answer came in time.
    pub(super) fn poll(&mut self, now: Instant, link: &mut Link) -> Result<(), Failure> {
        if self.due.is_some_and(|due| now < due || link.asks_once()) {
            return Ok(());
        }
        if self.sent == SENT_MAX {
            return Err(Failure::NoAnswer);
        }
        link.counts.requests += u64::from(self.sent == 0);
        link.counts.resends += u64::from(self.sent > 0);
        link.send(now, Kind::Request, self.command);
        self.sent += 1;
        self.due = Some(now + self.wait);
        Ok(())
    }
}

/// A request that sets the robot's pose.
#[derive(Clone, Debug)]
pub(super) struct Tell {
    pose: Pose,
    request: Request,
}

/// Tolerance of the confirmed pose: the robot rests meanwhile, so it reports the pose that it was
/// sent.
const TOLD_MM: f32 = 20.0;
const TOLD_RAD: f32 = 0.02;

impl Tell {
    pub(super) fn new(link: &Link, pose: Pose) -> Self {
        let command = Telecommand {
            corrected_pose: Some(wire_pose(pose)),
            ..Telecommand::default()
        };
        Self {
            pose,
            request: Request::new(link.number(), command),
        }
    }

    /// Runs one step; returns whether the robot has confirmed the pose.
    pub(super) fn step(&mut self, now: Instant, link: &mut Link) -> Result<bool, Failure> {
        let heard = link.heard_since(self.request.since());
        let told = heard.and_then(Heard::pose).is_some_and(|pose| {
            let near = pose.position().distance_mm(self.pose.position()) < TOLD_MM;
            near && normalised(pose.heading - self.pose.heading).abs() < TOLD_RAD
        });
        if self.request.is_sent() && (told || link.asks_once()) {
            return Ok(true);
        }
        self.request.poll(now, link)?;
        Ok(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    fn link(sending: Sending) -> Link {
        Link::new(&PcConfig {
            sending,
            ..PcConfig::default()
        })
    }

    fn rest() -> Telecommand {
        Telecommand {
            state: Some(State::Off),
            ..Telecommand::default()
        }
    }

    /// A message of the robot from (1.5, -0.25) m.
    fn telemetry(number: u64, heading: f32) -> Heard {
        let mut message = Telemetry::default();
        let odometry = telemetry::message::Odometry {
            pose: telemetry::message::Pose {
                x: 1.5,
                y: -0.25,
                alpha: heading,
            },
            ..Default::default()
        };
        message.odometry = Some(odometry);
        Heard {
            at: at(1_000),
            number,
            message: Box::new(message),
        }
    }

    #[test]
    fn what_was_heard_is_counted_from_one() {
        let mut link = link(Sending::default());
        assert_eq!((link.number(), link.heard().is_none()), (0, true));
        link.heard = Some(telemetry(5, 0.5));
        assert_eq!(link.number(), 5);
        assert!(link.heard_since(4).is_some() && link.heard_since(5).is_none());
        link.sight = Some(Sight {
            number: 5,
            pose: Pose::default(),
            lines: Vec::new(),
        });
        assert!(link.sight_since(4).is_some() && link.sight_since(5).is_none());
        let pose = link.heard().and_then(Heard::pose).expect("it says so");
        assert_eq!((pose.x_mm, pose.y_mm, pose.heading), (1_500.0, -250.0, 0.5));
        assert_eq!(telemetry(1, f32::NAN).pose(), None);
        let told = wire_pose(pose);
        assert_eq!((told.x, told.y, told.alpha), (1.5, -0.25, 0.5));
    }

    /// Nine tenths of a second after its last message the robot counts as silent, once.
    #[test]
    fn a_robot_is_silent_after_900_ms() {
        let mut link = link(Sending::default());
        link.poll(at(5_000));
        assert_eq!((link.is_silent(), link.poll_at()), (false, None));
        link.heard = Some(telemetry(1, 0.0));
        assert_eq!(link.poll_at(), Some(at(1_900)));
        link.poll(at(1_899));
        assert!(!link.is_silent());
        link.poll(at(1_900));
        link.poll(at(2_500));
        assert_eq!(
            (link.is_silent(), link.counts.silences, link.poll_at()),
            (true, 1, None)
        );
    }

    /// A correction of 5 mm or 5 mrad is sent, also across half a turn.
    #[test]
    fn small_corrections_are_not_told() {
        let half = core::f32::consts::PI - 0.001_6;
        let sight = Sight {
            number: 1,
            pose: Pose::new(100.0, 200.0, half),
            lines: Vec::new(),
        };
        let is_off = |x, y, heading| sight.is_off(Pose::new(x, y, heading));
        assert!(!is_off(104.9, 200.0, half) && is_off(105.1, 200.0, half));
        assert!(!is_off(103.0, 203.0, half) && is_off(104.0, 196.0, half));
        assert!(!is_off(100.0, 200.0, -half) && is_off(100.0, 200.0, 0.003 - half));
        assert!(is_off(100.0, 200.0, half - 0.006) && !is_off(100.0, 200.0, half - 0.004));
    }

    /// Commands beyond the room on the wire are lost and counted.
    #[test]
    fn commands_that_do_not_fit_are_counted() {
        let mut link = link(Sending::default());
        link.write(&rest());
        let len = link.out.len();
        assert!(len > 0);
        let fit = OUT_MAX / len;
        (1..fit + 3).for_each(|_| link.write(&rest()));
        assert_eq!((link.out.len(), link.counts.lost_in_queue), (fit * len, 3));
        link.poll(at(1));
        let mut buf = [0; OUT_MAX];
        assert_eq!(
            (link.transmit(&mut buf[..10]), link.released),
            (10, fit * len - 10)
        );
        assert_eq!(
            (link.transmit(&mut buf), link.released, link.out.len()),
            (fit * len - 10, 0, 0)
        );
        // 64 commands may wait for a frame.
        let mut link = self::link(Sending {
            one_per_frame: true,
            ..Sending::default()
        });
        (0..67).for_each(|_| link.send(at(1), Kind::Drive, rest()));
        assert_eq!((link.queue.len(), link.counts.lost_in_queue), (64, 3));
        assert_eq!(link.counts.commands, 67);
        link.poll(at(2));
        assert!(link.out.is_empty());
    }

    /// YP-03: a request discards all waiting commands; a drive does not.
    #[test]
    fn a_request_may_clear_the_queue() {
        let lost = |kind, requests_clear_queue| {
            let mut link = link(Sending {
                one_per_frame: true,
                requests_clear_queue,
                ..Sending::default()
            });
            (0..3).for_each(|_| link.send(at(1), Kind::Drive, rest()));
            link.send(at(1), kind, rest());
            (link.queue.len(), link.counts.lost_in_queue)
        };
        assert_eq!(lost(Kind::Request, true), (1, 3));
        assert_eq!(
            [lost(Kind::Drive, true), lost(Kind::Request, false)],
            [(4, 0); 2]
        );
    }

    /// YP-02: the fielded program sends one byte a millisecond.
    #[test]
    fn bytes_may_go_one_a_millisecond() {
        let mut link = link(Sending {
            byte_per_ms: true,
            ..Sending::default()
        });
        link.send(at(5), Kind::Drive, rest());
        link.poll(at(5));
        assert_eq!((link.released, link.poll_at()), (1, Some(at(6))));
        link.poll(at(5));
        assert_eq!(link.released, 1);
        link.poll(at(6));
        assert_eq!(link.released, 2);
        let mut buf = [0; 64];
        assert_eq!((link.transmit(&mut buf), link.released), (2, 0));
    }

    /// A request goes out at once, again each 700 ms without an answer, and at most fourteen times.
    #[test]
    fn a_request_is_sent_until_it_is_answered() {
        let mut link = link(Sending::default());
        let mut request = Request::new(7, rest());
        assert!(!request.is_sent() && request.since() == 7);
        let mut poll = |millis| (request.poll(at(millis), &mut link).is_ok(), request.sent);
        assert_eq!(
            [poll(0), poll(699), poll(700), poll(701)],
            [1, 1, 2, 2].map(|n| (true, n))
        );
        (2..14).for_each(|n| _ = poll(n * 700));
        assert_eq!([poll(9_799), poll(9_800)], [(true, 14), (false, 14)]);
        assert!(request.is_sent());
        assert_eq!((link.counts.requests, link.counts.resends), (1, 13));
        assert_eq!(Request::of_state(7, rest()).wait, SWITCHED);
    }

    /// A report within 19 mm and 19 mrad of the sent pose confirms it. A report from before the
    /// request does not count.
    #[test]
    fn a_pose_was_told_when_the_robot_says_so() {
        let told = |x_mm: f32, heading: f32| {
            let mut link = link(Sending::default());
            let mut tell = Tell::new(&link, Pose::new(x_mm, -250.0, heading));
            link.heard = Some(telemetry(1, 0.5));
            assert_eq!(tell.step(at(0), &mut link).ok(), Some(false));
            tell.step(at(1), &mut link).ok()
        };
        assert_eq!([told(1_519.0, 0.5), told(1_481.0, 0.5)], [Some(true); 2]);
        assert_eq!([told(1_521.0, 0.5), told(1_479.0, 0.5)], [Some(false); 2]);
        assert_eq!(
            [told(1_500.0, 0.519), told(1_500.0, 0.521)],
            [Some(true), Some(false)]
        );
    }
}
