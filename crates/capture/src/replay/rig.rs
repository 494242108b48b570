//! A rig in which a capture takes the part of all devices, for a program in virtual time: each link
//! brings what it brought then, at the same nanosecond, and nobody judges what the program says.

use core::cell::RefCell;
use core::time::Duration;
use std::rc::Rc;

use emulators::world::World;
use emulators::{Device, Event};
use protocols::{Instant, LineConfig, Port};

use super::{Listener, Passage, Played};
use crate::divergence::Track;
use engine::rig::line::{Direction, End};
use engine::rig::{LinkKind, PortRate, Rig};
use engine::robots::{self, Instruments, OpenEnd, Wired};
use engine::run::Run;
use engine::scenario::{Scenario, ScenarioError, Span};

/// How long answers may take behind the end of the capture.
const ANSWERS: Duration = Duration::from_secs(1);

/// A capture that takes the part of the devices.
pub struct StandIn {
    /// The run; it is over when all was played, and answers had their time.
    pub run: Run,
    /// What the program is to open.
    pub open_ends: Vec<OpenEnd>,
    /// What is heard of the program.
    pub ear: Ear,
}

/// What a program says on each link, beside what the captured one said.
pub struct Ear {
    expected: Vec<(String, Track)>,
    sent: Rc<RefCell<Vec<Track>>>,
    end: Instant,
}

impl Ear {
    /// What was heard so far. Behind the end of the capture only what it says is still listened to:
    /// of what came later it says nothing.
    pub fn played(&self) -> Vec<Played> {
        let sent = self.sent.borrow();
        let both = self.expected.iter().zip(sent.iter());
        let played = both.map(|((link, expected), got)| Played {
            link: link.clone(),
            expected: expected.clone(),
            got: until(got, self.end, expected.bytes().len()),
        });
        played.collect()
    }
}

/// What of `track` is not later than `end`, or among its first `least` bytes.
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

impl StandIn {
    /// Of the links `passages`, up to `end`.
    ///
    /// # Errors
    /// Never, but for a mistake here.
    pub fn new(passages: &[&Passage], end: Instant) -> Result<Self, ScenarioError> {
        let (mut scenario, _) = Scenario::from_text(SCENARIO)?;
        scenario.duration = Span((end - Instant::ZERO) + ANSWERS);
        scenario.mission.to_the_end = true;
        let mut wired = Wired::new(Rig::new(robots::nowhere()), Nobody);
        for passage in passages {
            let line = passage.line();
            let master = wired.open_end(&passage.link, line, "the program");
            // At which rate it was recorded a capture may not say.
            wired.set_rate(master, PortRate::Any { usual: line });
            let rig = &mut wired.rig;
            let device = End {
                node: rig.add_device(&passage.link, Silent(line)),
                port: Port(0),
            };
            let link = rig.connect_by(LinkKind::Uart, &passage.link, device, master, 1);
            let lines = rig.lines_mut(link).expect("it was just connected");
            let line = &mut lines[Direction::ToMaster as usize];
            line.is_played = true;
            for arrival in &passage.arrivals {
                let framing_errors = u32::from(arrival.bytes.is_empty());
                line.play(arrival.at, &arrival.bytes, framing_errors);
            }
        }
        let sent = Rc::new(RefCell::new(vec![Track::default(); passages.len()]));
        wired.rig.add_tap(Box::new(Listener(Rc::clone(&sent))));
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
                end,
            },
        })
    }
}

/// A run of nothing.
const SCENARIO: &str = "schema = 1\nname = \"replay\"\nrobot = \"none\"\nduration = \"1s\"\n";

/// There is no robot of which anything could be asked.
struct Nobody;

impl Instruments for Nobody {}

/// Stands where the captured device was: the capture speaks for it.
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

    /// Two arrivals reach the program's end at their nanosecond, and what it says is kept with its
    /// time: two bytes at 9600 baud take 2 x 1,041,666 ns.
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
        // It ends while the program speaks: of the rest of that it says nothing.
        let made = StandIn::new(&[&passage], Instant::from_millis(20));
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
}
