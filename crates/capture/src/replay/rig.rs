//! A rig in which a capture replaces all devices, for a program in virtual time. Each link replies
//! as in the capture. In a replay by time, it sends the captured bytes at the same nanosecond. No
//! device judges the program.

use core::time::Duration;

use emulators::world::World;
use emulators::{Device, Event};
use protocols::{Instant, LineConfig, LineEvent, Port};

use super::conversation::{Conversation, are_over};
use super::listen::Listener;
use super::{Passage, Played, Recorded, Talked};
use crate::divergence::Track;
use engine::Shared;
use engine::rig::line::{Direction, End};
use engine::rig::{LinkKind, PortRate, Rig};
use engine::robots::{self, Instruments, OpenEnd, Wired};
use engine::run::Run;
use engine::scenario::{Scenario, ScenarioError, Span};

/// Maximum time for replies after the end of the capture.
const ANSWERS: Duration = Duration::from_secs(1);

/// A capture that replaces the devices.
pub struct StandIn {
    /// The run; it ends after the whole capture was played and the time for replies has passed.
    pub run: Run,
    /// Ports for the program.
    pub open_ends: Vec<OpenEnd>,
    /// Received bytes of the program.
    pub ear: Ear,
}

/// Bytes of a program on each link, with those of the captured one.
pub struct Ear {
    expected: Vec<(String, Track)>,
    sent: Shared<Vec<Track>>,
    talks: Vec<Shared<Conversation>>,
    end: Instant,
}

impl Ear {
    /// Bytes received so far. In a replay by time, only as many bytes as the capture has count
    /// after its end: the capture does not cover later ones.
    pub fn played(&self) -> Vec<Played> {
        let sent = self.sent.lock();
        let both = self.expected.iter().zip(sent.iter()).enumerate();
        let played = both.map(|(index, ((link, expected), got))| {
            let talk = self.talks.get(index);
            Played {
                link: link.clone(),
                expected: expected.clone(),
                got: match talk {
                    Some(_) => got.clone(),
                    None => until(got, self.end, expected.bytes().len()),
                },
                talk: talk.map(|talk| Talked::of(&talk.lock())),
            }
        });
        played.collect()
    }

    /// Whether there is a conversation, and it has ended by `now`.
    pub fn is_over(&self, now: Instant) -> bool {
        let talks: Vec<_> = self.talks.iter().map(|talk| talk.lock()).collect();
        !talks.is_empty() && are_over(talks.iter().map(|talk| &**talk), now, self.end)
    }
}

/// The part of `track` that is not later than `end`, or among its first `least` bytes.
fn until(track: &Track, end: Instant, least: usize) -> Track {
    let mut heard = Track::default();
    for (at, bytes) in track.pieces() {
        let room = match at <= end {
            true => bytes.len(),
            false => least.saturating_sub(heard.bytes().len()).min(bytes.len()),
        };
        heard.push(at, &bytes[..room]);
    }
    heard
}

/// Clock of a played capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Timing {
    /// The program's requests trigger the replies.
    Conversation,
    /// The captured times.
    Clock,
}

/// Maximum length of a conversation: this multiple of its capture, plus this time.
const LONGEST: u32 = 20;
const LONGEST_MORE: Duration = Duration::from_secs(600);

impl StandIn {
    /// Builds a rig of the links `passages` of `recorded`, up to its end.
    ///
    /// # Errors
    /// Only on a defect of this function.
    pub fn new(
        passages: &[&Passage],
        recorded: &Recorded,
        timing: Timing,
    ) -> Result<Self, ScenarioError> {
        let origin = recorded.origin();
        let (end, longest) = match timing {
            Timing::Clock => (recorded.end, (recorded.end - Instant::ZERO) + ANSWERS),
            Timing::Conversation => {
                let lasts = recorded.end - origin;
                (Instant::ZERO + lasts, lasts * LONGEST + LONGEST_MORE)
            }
        };
        let (mut scenario, _) = Scenario::from_text(SCENARIO)?;
        scenario.duration = Span(longest);
        scenario.mission.to_the_end = true;
        let mut wired = Wired::new(Rig::new(robots::nowhere()), NoRobot);
        let mut talks = Vec::new();
        for passage in passages {
            let line = passage.line();
            let master = wired.open_end(&passage.link, line, "the program");
            // The capture may lack its baud rate.
            wired.set_rate(master, PortRate::Any { usual: line });
            let rig = &mut wired.rig;
            let talk = Shared::new(Conversation::new(passage, &recorded.session(), true));
            let node = match timing {
                Timing::Clock => rig.add_device(&passage.link, Silent(line)),
                Timing::Conversation => {
                    let talk = talk.clone();
                    rig.add_device(&passage.link, Speaker { line, talk })
                }
            };
            let device = End {
                node,
                port: Port(0),
            };
            let link = rig.connect_by(LinkKind::Uart, &passage.link, device, master, 1);
            if timing == Timing::Conversation {
                talks.push(talk);
                continue;
            }
            let lines = rig.lines_mut(link).expect("it was just connected");
            let line = &mut lines[Direction::ToMaster as usize];
            line.is_played = true;
            for arrival in &passage.arrivals {
                let framing_errors = u32::from(arrival.bytes.is_empty());
                line.play(arrival.at, &arrival.bytes, framing_errors);
            }
        }
        let sent = Shared::new(vec![Track::default(); passages.len()]);
        wired.rig.add_tap(Box::new(Listener(sent.clone())));
        let expected = passages.iter();
        let expected = expected.map(|passage| (passage.link.clone(), passage.sent.clone()));
        let Wired {
            rig,
            open_ends,
            instruments,
        } = wired;
        Ok(Self {
            run: Run::with_rig(scenario, rig, instruments),
            open_ends,
            ear: Ear {
                expected: expected.collect(),
                sent,
                talks,
                end,
            },
        })
    }
}

/// An empty run.
const SCENARIO: &str = "schema = 1\nname = \"replay\"\nrobot = \"none\"\nduration = \"1s\"\n";

/// A replay has no robot with instruments.
struct NoRobot;

impl Instruments for NoRobot {}

/// A node in the place of the captured device, without messages of its own: the capture supplies
/// the bytes.
#[derive(Clone, Debug)]
struct Silent(LineConfig);

impl Device for Silent {
    fn receive(&mut self, _: Port, _: Instant, _: &[u8]) {}

    fn poll(&mut self, _: Instant, _: &mut World) {}

    fn transmit(&mut self, _: Port, _: &mut [u8]) -> usize {
        0
    }

    fn poll_at(&self) -> Option<Instant> {
        None
    }

    fn line_config(&self, _: Port) -> LineConfig {
        self.0
    }

    fn take_events(&mut self) -> Vec<Event> {
        Vec::new()
    }
}

/// A node that replies in the place of the captured device.
struct Speaker {
    line: LineConfig,
    talk: Shared<Conversation>,
}

/// A copy continues alone: reports are about the original.
impl Clone for Speaker {
    fn clone(&self) -> Self {
        Self {
            line: self.line,
            talk: Shared::new(self.talk.lock().clone()),
        }
    }
}

impl Device for Speaker {
    fn receive(&mut self, _: Port, now: Instant, bytes: &[u8]) {
        self.talk.lock().receive(now, bytes);
    }

    fn line_event(&mut self, _: Port, now: Instant, event: LineEvent) {
        let mut talk = self.talk.lock();
        match event {
            LineEvent::Opened => talk.open(now),
            LineEvent::Closed => talk.close(),
            LineEvent::Break
            | LineEvent::FramingError
            | LineEvent::ParityError
            | LineEvent::Overrun => {}
        }
    }

    fn poll(&mut self, now: Instant, _: &mut World) {
        self.talk.lock().poll(now);
    }

    fn transmit(&mut self, _: Port, buf: &mut [u8]) -> usize {
        self.talk.lock().transmit(buf)
    }

    fn may_send(&self, _: Port) -> bool {
        self.talk.lock().has_more()
    }

    fn poll_at(&self) -> Option<Instant> {
        self.talk.lock().poll_at()
    }

    fn line_config(&self, _: Port) -> LineConfig {
        self.line
    }

    fn take_events(&mut self) -> Vec<Event> {
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::Arrival;
    use engine::rig::Paced as _;

    fn said(text: &str) -> Track {
        let mut track = Track::default();
        track.push(Instant::from_millis(12), text.as_bytes());
        track
    }

    /// Two messages reach the program at their nanosecond, and the program's bytes are recorded
    /// with their time: two bytes at 9600 baud take 2 x 1,041,666 ns.
    #[test]
    fn a_capture_speaks_and_hears_in_the_place_of_a_device() {
        let arrival = |at, bytes: &[u8]| Arrival {
            at: Instant::from_millis(at),
            bytes: bytes.to_vec(),
        };
        let passage = Passage {
            link: "sonar".to_owned(),
            baud: 9600,
            sent: said("hi"),
            arrivals: vec![arrival(10, b"mm"), arrival(20, b"=7")],
            ..Passage::default()
        };
        // The capture ends while the program sends; it does not cover the rest.
        let recorded = Recorded {
            end: Instant::from_millis(20),
            ..Recorded::default()
        };
        let made = StandIn::new(&[&passage], &recorded, Timing::Clock);
        let StandIn {
            mut run,
            open_ends,
            ear,
        } = made.expect("a rig");
        let node = open_ends[0].node;
        run.go_on_until(Instant::from_nanos(9_999_999));
        assert_eq!(run.rig.take_output(node), b""[..]);
        run.go_on_until(Instant::from_millis(10));
        assert_eq!(run.rig.take_output(node), b"mm"[..]);
        run.rig.inject(node, b"hi");
        run.go_on_until(Instant::from_millis(19));
        run.rig.inject(node, b"and more");
        run.run_until(Instant::from_secs(5));
        assert_eq!(run.rig.take_output(node), b"=7"[..]);
        assert_eq!(
            run.rig.now(),
            Instant::from_millis(1_020),
            "then it is over"
        );
        let [heard] = &ear.played()[..] else {
            panic!("one link");
        };
        assert_eq!(heard.got.bytes(), b"hi");
        assert_eq!(heard.got.end(), Some(Instant::from_nanos(12_083_332)));
    }

    /// The program sends its request 3 s later than the captured one; "mm" is complete 8 ms after
    /// "hi", as captured. The program sends at 3 s, and its two bytes take 2,083,332 ns.
    #[test]
    fn a_capture_answers_whenever_it_is_asked() {
        let arrival = |at, bytes: &[u8]| Arrival {
            at: Instant::from_millis(at),
            bytes: bytes.to_vec(),
        };
        let passage = Passage {
            link: "sonar".to_owned(),
            baud: 9600,
            sent: said("hi"),
            arrivals: vec![arrival(20, b"mm")],
            ..Passage::default()
        };
        let recorded = Recorded {
            links: vec![passage],
            end: Instant::from_millis(25),
            zero: Instant::ZERO,
        };
        let passage = &recorded.links[0];
        let made = StandIn::new(&[passage], &recorded, Timing::Conversation).expect("a rig");
        let StandIn {
            mut run,
            open_ends,
            ear,
        } = made;
        let node = open_ends[0].node;
        run.go_on_until(Instant::from_secs(3));
        assert!(run.rig.take_output(node).is_empty() && !ear.is_over(run.rig.now()));
        run.rig.inject(node, b"hi");
        run.go_on_until(Instant::from_nanos(3_010_083_300));
        assert!(run.rig.take_output(node).len() < 2);
        run.go_on_until(Instant::from_nanos(3_010_083_400));
        assert!(!ear.is_over(run.rig.now()), "the program may answer");
        run.go_on_until(Instant::from_millis(4_010));
        assert!(ear.is_over(run.rig.now()));
        let [heard] = &ear.played()[..] else {
            panic!("one link");
        };
        let talk = heard.talk.as_ref().expect("a conversation");
        assert_eq!((talk.tally.made, &talk.divergence), (1, &None));
        assert_eq!(run.rig.take_output(node), b"m"[..]);
    }
}
