use core::cell::Cell;
use std::path::Path;

use emulators::Device;
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::{Instant, LineConfig, Port as DevicePort};

use super::*;
use crate::clock::SimClock;
use crate::transport::{Counters, Memory, PortEvent};
use engine::rig::line::End;

const LINE: LineConfig = LineConfig::new_8n1(115_200);

/// Sends 0, 1, 2, .. without pause and stores its input.
#[derive(Clone, Default)]
struct Counter {
    next: u8,
    heard: Vec<u8>,
    events: Vec<LineEvent>,
    /// Its rate instead of the usual one.
    baud: Option<u32>,
}

impl Device for Counter {
    fn receive(&mut self, _: DevicePort, _: Instant, bytes: &[u8]) {
        self.heard.extend_from_slice(bytes);
    }
    fn line_event(&mut self, _: DevicePort, _: Instant, event: LineEvent) {
        self.events.push(event);
    }
    fn poll(&mut self, _: Instant, _: &mut World) {}
    fn transmit(&mut self, _: DevicePort, buf: &mut [u8]) -> usize {
        for slot in buf.iter_mut() {
            *slot = self.next;
            self.next = self.next.wrapping_add(1);
        }
        buf.len()
    }
    fn poll_at(&self) -> Option<Instant> {
        None
    }
    fn line_config(&self, _: DevicePort) -> LineConfig {
        LineConfig::new_8n1(self.baud.unwrap_or(LINE.baud))
    }
    fn take_events(&mut self) -> Vec<Event> {
        Vec::new()
    }
}

/// A counter on a link whose other end is outside.
fn rig() -> (Rig, OpenEnd) {
    let scene = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("nothing is in it");
    let start = Pose::new(0.0, 0.0, 0.0);
    let world = World::new(scene, BodyConfig::default(), start, 1).expect("nothing is near");
    let mut rig = Rig::new(world);
    let port = DevicePort(0);
    let node = rig.add_device("counter", Counter::default());
    let device = End { node, port };
    let node = rig.add_outside("counter", LINE);
    rig.connect("counter", device, End { node, port }, 16);
    let end = OpenEnd {
        name: "counter".to_owned(),
        link: "counter".to_owned(),
        node,
        line: LINE,
        rate: PortRate::OfLine,
        connect: "a test",
        is_optional: false,
        robot: 0,
    };
    (rig, end)
}

fn read_all(port: &mut Memory) -> Vec<u8> {
    let mut buf = [0; 4096];
    let len = port.read(&mut buf).expect("memory stays");
    buf[..len].to_vec()
}

/// Bytes 0, 1, 2, .. 255, 0, ..
fn counting(len: usize) -> Vec<u8> {
    (0..=255).cycle().take(len).collect()
}

/// 115200 baud carry 11,520 bytes per second.
#[test]
fn the_rig_keeps_up_with_the_clock_and_never_overtakes_it() {
    let (mut rig, end) = rig();
    let (near, mut far) = Memory::pair("counter");
    let mut realtime = Realtime::new(SimClock::default());
    realtime.serve(end, Box::new(near));
    let mut received = Vec::new();
    while realtime.clock().now() < Instant::from_secs(1) {
        let present = realtime.clock().now();
        realtime.turn(&mut rig).expect("memory stays");
        assert_eq!(rig.now(), present);
        received.extend(read_all(&mut far));
    }
    assert!((11_520 - 100..=11_520).contains(&received.len()));
    assert_eq!(received, counting(received.len()));
}

/// The process was stopped for half a second: no time is skipped, and the client is served between
/// two slices.
#[test]
fn after_a_delay_every_byte_comes_in_order_and_in_small_pieces() {
    let (mut rig, end) = rig();
    let (near, mut far) = Memory::pair("counter");
    let mut realtime = Realtime::new(SimClock::default());
    realtime.serve(end, Box::new(near));
    realtime.turn(&mut rig).expect("memory stays");
    realtime.clock().advance(Duration::from_millis(500));

    let mut received = Vec::new();
    while realtime.clock().now() - rig.now() > SLICE {
        let before = rig.now();
        realtime.turn(&mut rig).expect("memory stays");
        assert!(rig.now() - before <= SLICE);
        received.extend(read_all(&mut far));
        assert!(rig.now() < Instant::from_secs(1), "never catches up");
    }
    assert!(received.len() >= 5_760 - 100, "half a second's worth");
    assert_eq!(received, counting(received.len()));
    assert!(realtime.lateness().max() >= Duration::from_millis(490));
}

/// A clock that can stop, like the clock of `up`.
#[derive(Default)]
struct Slipping {
    wall: SimClock,
    stood: Cell<Duration>,
}

impl Clock for Slipping {
    fn now(&self) -> Instant {
        Instant::ZERO + ((self.wall.now() - Instant::ZERO) - self.stood.get())
    }

    fn slip(&self, by: Duration) -> bool {
        self.stood.set(self.stood.get() + by);
        true
    }

    fn sleep_until(&self, deadline: Instant) {
        self.wall.sleep_until(deadline + self.stood.get());
    }
}

/// A clock whose sleeps take 0.3 ms too long, as those of a system do.
#[derive(Default)]
struct Oversleeping(SimClock);

impl Clock for Oversleeping {
    fn now(&self) -> Instant {
        self.0.now()
    }

    fn sleep_until(&self, deadline: Instant) {
        self.0.sleep_until(deadline + Duration::from_micros(300));
    }
}

/// Nothing happens in the rig, and its time passes all the same.
#[test]
fn an_idle_rig_keeps_up_with_a_clock_that_oversleeps() {
    let scene = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("nothing is in it");
    let world = World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free");
    let mut rig = Rig::new(world);
    let mut realtime = Realtime::new(Oversleeping::default());
    while realtime.clock.now() < Instant::from_secs(5) {
        realtime.turn(&mut rig).expect("there is no port");
    }
    let behind = realtime.clock.now() - rig.now();
    assert!(behind <= 2 * SLICE, "{behind:?}");
}

fn breaks_a_rule(rig: &mut Rig) {
    let event = Event {
        at: rig.now(),
        kind: EventKind::Violation,
        rule: "too-soon",
        detail: "the last one is not answered yet".to_owned(),
        bytes: Vec::new(),
    };
    rig.log("counter", event);
}

/// The process was stopped for half a second: rig time stood. The client gets no burst, no byte is
/// lost, and violations during this time and 100 ms more do not count.
#[test]
fn while_the_rig_is_late_its_time_stands_and_nobody_is_blamed() {
    let (mut rig, end) = rig();
    let (near, mut far) = Memory::pair("counter");
    let mut realtime = Realtime::new(Slipping::default());
    realtime.serve(end, Box::new(near));
    let mut received = Vec::new();
    let mut until = |realtime: &mut Realtime<Slipping>, rig: &mut Rig, end: Instant| {
        while rig.now() < end {
            let before = rig.now();
            realtime.turn(rig).expect("memory stays");
            assert!(rig.now() - before <= SLICE, "{before}: a jump");
            received.extend(read_all(&mut far));
        }
        received.len()
    };
    until(&mut realtime, &mut rig, Instant::from_millis(100));
    breaks_a_rule(&mut rig);
    assert_eq!((rig.violations(), rig.excused()), (1, 0));
    realtime.clock().wall.advance(Duration::from_millis(500));
    realtime.turn(&mut rig).expect("memory stays");
    assert!(rig.now() < Instant::from_millis(110), "{}", rig.now());
    assert_eq!(realtime.stalls().0, 1);
    until(&mut realtime, &mut rig, Instant::from_millis(650));
    breaks_a_rule(&mut rig);
    assert_eq!((rig.violations(), rig.excused()), (1, 1));
    let len = until(&mut realtime, &mut rig, Instant::from_millis(750));
    breaks_a_rule(&mut rig);
    assert_eq!((rig.violations(), rig.excused()), (2, 1));
    // 750 ms at 11,520 bytes per second, and the 5 ms of the last turn.
    assert!((8_640 - 120..=8_640 + 60).contains(&len), "{len}");
    assert_eq!(received, counting(len));
    assert!(realtime.lateness().is_too_much());
}

/// A client sent 200 bytes within 100 ms in which the rig was stopped. They are sent within the
/// same time, in bursts of 64, instead of the 17 ms that the line would need.
#[test]
fn what_a_client_sent_while_rig_time_stood_is_not_poured_over_the_device() {
    let (mut rig, end) = rig();
    let (near, mut far) = Memory::pair("counter");
    let mut realtime = Realtime::new(Slipping::default());
    realtime.serve(end, Box::new(near));
    let mut heard_at = |realtime: &mut Realtime<Slipping>, end: Instant| {
        while rig.now() < end {
            realtime.turn(&mut rig).expect("memory stays");
        }
        rig.device::<Counter>("counter")
            .expect("there")
            .heard
            .clone()
    };
    heard_at(&mut realtime, Instant::from_millis(10));
    realtime.clock().wall.advance(Duration::from_millis(100));
    assert_eq!(far.write(&counting(200)), 200);
    let half = heard_at(&mut realtime, Instant::from_millis(60)).len();
    assert_eq!(half, 128, "the second of four bursts is under way");
    assert_eq!(far.write(&[200]), 1);
    let all = heard_at(&mut realtime, Instant::from_millis(130));
    assert_eq!(all, counting(201));
}

#[test]
fn what_a_client_sends_takes_its_time_on_the_line() {
    let (mut rig, end) = rig();
    let (near, mut far) = Memory::pair("counter");
    let mut realtime = Realtime::new(SimClock::default());
    realtime.serve(end, Box::new(near));
    assert_eq!(far.write(&counting(1152)), 1152);
    // 1152 bytes at 11,520 a second take 100 ms.
    let mut heard = 0;
    while realtime.clock().now() < Instant::from_millis(90) {
        realtime.turn(&mut rig).expect("memory stays");
        heard = rig.device::<Counter>("counter").expect("there").heard.len();
    }
    assert!((900..=1037).contains(&heard), "{heard} after 90 ms");
    while realtime.clock().now() < Instant::from_millis(120) {
        realtime.turn(&mut rig).expect("memory stays");
    }
    let device = rig.device::<Counter>("counter").expect("there");
    assert_eq!(device.heard, counting(1152));
}

#[test]
fn the_device_sees_a_client_come_and_go() {
    let (mut rig, end) = rig();
    let (near, far) = Memory::pair("counter");
    let mut realtime = Realtime::new(SimClock::default());
    realtime.serve(end, Box::new(near));
    realtime.turn(&mut rig).expect("memory stays");
    drop(far);
    realtime.turn(&mut rig).expect("memory stays");
    let device = rig.device::<Counter>("counter").expect("there");
    assert_eq!(device.events, [LineEvent::Opened, LineEvent::Closed]);
    let rules: Vec<_> = rig
        .events()
        .iter()
        .map(|logged| logged.event.rule)
        .collect();
    assert_eq!(rules, ["port-opened", "port-closed"]);
}

/// A port that reports all events of a client at once.
struct Fickle(Vec<PortEvent>);

impl Transport for Fickle {
    fn read(&mut self, _: &mut [u8]) -> Result<usize, TransportError> {
        Ok(0)
    }
    fn write(&mut self, _: &[u8]) -> usize {
        0
    }
    fn next_event(&mut self) -> Option<PortEvent> {
        (!self.0.is_empty()).then(|| self.0.remove(0))
    }
    fn path(&self) -> &Path {
        "fickle".as_ref()
    }
    fn counters(&self) -> Counters {
        Counters::default()
    }
    fn readiness<'a>(&'a self, _: &mut Vec<std::os::fd::BorrowedFd<'a>>) {}
}

/// Left by a predecessor, set by the client itself, and corrected: logged twice, then no more.
#[test]
fn a_wrong_rate_is_told_when_it_is_found_and_when_it_is_set() {
    let (mut rig, end) = rig();
    let mut realtime = Realtime::new(SimClock::default());
    let events = vec![
        PortEvent::BaudChanged(9600),
        PortEvent::Opened,
        PortEvent::BaudChanged(57_600),
        PortEvent::BaudChanged(115_200),
    ];
    realtime.serve(end, Box::new(Fickle(events)));
    realtime.turn(&mut rig).expect("stays");
    let told: Vec<_> = rig.events().iter().map(ToString::to_string).collect();
    assert_eq!(
        told,
        [
            "0.000000 counter port-opened: client at 9600 baud",
            "0.000000 counter wrong-baud: client at 9600 baud, expected 115200: it reads garbage",
            "0.000000 counter wrong-baud: client at 57600 baud, expected 115200: it reads garbage",
        ]
    );
}

/// A radio module that switched to another rate: a client at the old rate is then wrong, and a
/// client that follows is right.
#[test]
fn a_client_is_judged_by_the_rate_that_its_device_has_now() {
    let (mut rig, end) = rig();
    let mut realtime = Realtime::new(SimClock::default());
    realtime.serve(end, Box::new(Fickle(vec![PortEvent::Opened])));
    realtime.turn(&mut rig).expect("stays");
    let told = |rig: &Rig| {
        rig.events()
            .iter()
            .map(|logged| logged.event.detail.clone())
            .collect()
    };
    let first: Vec<String> = told(&rig);
    assert_eq!(first, ["client at 115200 baud"]);
    rig.device_mut::<Counter>("counter")
        .expect("it is there")
        .baud = Some(9600);
    realtime.carry(&mut rig).expect("stays");
    let blamed: Vec<String> = told(&rig);
    let expected = "client at 115200 baud, expected 9600: it reads garbage";
    assert_eq!(blamed[1..], [expected]);
    assert_eq!(
        realtime.signs().next().and_then(|sign| sign.wrong_rate),
        Some((115_200, 9600))
    );
    rig.device_mut::<Counter>("counter")
        .expect("it is there")
        .baud = None;
    realtime.carry(&mut rig).expect("stays");
    assert_eq!(told(&rig), blamed);
    assert_eq!(
        realtime.signs().next().and_then(|sign| sign.wrong_rate),
        None
    );
}
