//! A bench of two links between ends that the test serves. The input does not depend on the output,
//! so each line shows its own faults and nothing else.

use core::time::Duration;

use hilrig::Shared;
use hilrig::rig::Rig;
use hilrig::rig::fault::FaultId;
use hilrig::rig::line::{Delivery, Direction, End};
use hilrig::rig::trace::{Side, Tap};
use hilrig::robots::instruments::Unknown;
use hilrig::run::Run;
use hilrig::scenario::{FaultSpec, Scenario};
use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::in_a_room;

/// A byte takes 100 us.
pub(super) const LINE: LineConfig = LineConfig::new_8n1(100_000);
/// Bytes that each line gets at 10 ms. The second line gets them with 20 hex added to each byte,
/// and so on.
pub(super) const SENT: [u8; 10] = [0x00, 0x0D, 0x11, 0x13, 0x81, 5, 6, 7, 8, 9];

/// Content of the four lines: `a` to its master and to its device, then `b`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Seen {
    /// Deliveries: time in byte times since 10 ms, with bytes or event.
    pub(super) lines: [Vec<String>; 4],
    /// Bytes that the receivers got.
    pub(super) got: [Vec<u8>; 4],
    /// The run as a case.
    pub(super) case: Scenario,
}

impl Seen {
    /// One line as text.
    pub(super) fn line(&self, index: usize) -> String {
        self.lines[index].join(" ")
    }

    /// All lines but one.
    pub(super) fn others(&self, index: usize) -> Vec<&Vec<String>> {
        let lines = self.lines.iter().enumerate();
        lines
            .filter(|(other, _)| *other != index)
            .map(|(_, line)| line)
            .collect()
    }
}

struct Pen(Shared<[Vec<String>; 4]>);

impl Pen {
    fn put(&self, link: usize, direction: Direction, at: Instant, what: &str) {
        let since = (at - Instant::from_millis(10)).as_nanos() as f64 / 1e5;
        self.0.lock()[2 * link + direction as usize].push(format!("{since}:{what}"));
    }
}

impl Tap for Pen {
    fn record(&mut self, _: usize, _: Direction, _: Side, _: Instant, _: &[u8]) {}

    fn arrived(&mut self, link: usize, direction: Direction, delivery: &Delivery) {
        let bytes: Vec<String> = delivery.bytes.iter().map(|b| format!("{b:02x}")).collect();
        if !bytes.is_empty() {
            self.put(link, direction, delivery.at, &bytes.join("."));
        }
        if delivery.framing_errors > 0 {
            self.put(link, direction, delivery.at, "!framing");
        }
    }

    fn line_event(&mut self, link: usize, direction: Direction, at: Instant, event: LineEvent) {
        self.put(link, direction, at, &format!("!{event:?}").to_lowercase());
    }
}

/// The scenario with these TOML lines.
pub(super) fn scenario(text: &str) -> Scenario {
    in_a_room("1s", text).0
}

/// One fault on `a`, to its master.
pub(super) fn one(kind: &str, keys: &str) -> Scenario {
    scenario(&format!(
        "[[fault]]\nkind = \"{kind}\"\nlink = \"a\"\ndirection = \"to-master\"\n{keys}\n"
    ))
}

/// Runs `scenario` on the bench; each line gets `sent`, in pieces of at most `piece` bytes.
pub(super) fn run(scenario: Scenario, sent: &[u8], piece: usize) -> Seen {
    let sent = [0, 0x20, 0x40, 0x60].map(|offset| sent.iter().map(|byte| byte + offset).collect());
    run_each(scenario, sent, piece)
}

/// Whether this fault can be planned on the bench.
pub(super) fn is_sound(fault: &FaultSpec) -> bool {
    let (mut rig, _) = bench(1);
    rig.plan_fault(fault, FaultId(0), 1).is_ok()
}

/// The rig and its nodes: `a` at its device and at its master, then `b`.
fn bench(piece: usize) -> (Rig, [usize; 4]) {
    let (room, source) = in_a_room("1s", "");
    let world = room.world.build(room.seed, None, &source).expect("sound");
    let mut rig = Rig::new(world);
    let nodes = ["a.device", "a.master", "b.device", "b.master"];
    let nodes = nodes.map(|name| rig.add_outside(name, LINE));
    let end = |node| End {
        node,
        port: Port(0),
    };
    rig.connect("a", end(nodes[0]), end(nodes[1]), piece);
    rig.connect("b", end(nodes[2]), end(nodes[3]), piece);
    (rig, nodes)
}

/// As [`run`], with separate bytes for each line.
pub(super) fn run_each(scenario: Scenario, sent: [Vec<u8>; 4], piece: usize) -> Seen {
    let (mut rig, nodes) = bench(piece);
    rig.budget = scenario.budget.unwrap_or_default().into();
    for (index, fault) in scenario.fault.iter().enumerate() {
        let planned = rig.plan_fault(fault, FaultId(index), scenario.seed);
        planned.expect("a fault that makes sense here");
    }
    let lines = Shared::default();
    rig.add_tap(Box::new(Pen(lines.clone())));

    let mut run = Run::with_rig(scenario, rig, Box::new(Unknown));
    run.go_on_until(Instant::from_millis(10));
    for (node, bytes) in nodes.into_iter().zip(&sent) {
        run.rig.inject(node, bytes);
    }
    run.go_on_until(Instant::ZERO + Duration::from_secs(1));
    for link in run.rig.links() {
        assert!(link.lines.iter().all(|line| line.conserves_bytes()));
    }
    let receivers = [nodes[1], nodes[0], nodes[3], nodes[2]];
    let got = receivers.map(|node| run.rig.take_output(node).to_vec());
    let case = run.case();
    drop(run);
    let lines = core::mem::take(&mut *lines.lock());
    Seen { lines, got, case }
}
