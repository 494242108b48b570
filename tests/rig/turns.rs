//! Turns do not depend on the chunking of a lidar's stream. An adapter delivers the bytes that
//! arrived before its timer expired, a client reads the bytes in its buffer, and neither knows
//! packets.

use core::time::Duration;
use std::io::{Read as _, Write as _};
use std::path::Path;

use firmware_core::pose::Point;
use firmware_core::scan::{BEAMS, Mounting, TurnAssembler, WeakReadings};
use hilrig::ports::Bench;
use hilrig::robots::{Beam, ScanDecoder};
use hilrig::scenario::Scenario;
use proptest::collection::vec;
use proptest::prelude::*;
use protocols::{Decode as _, Instant, rplidar, xv11};

/// The stream of a lidar alone in a room, and the rig that it came from.
struct Recorded {
    bench: Bench,
    bytes: Vec<u8>,
}

impl Recorded {
    /// `len` bytes of the lidar that `device` describes, after `request`.
    fn new(device: &str, request: &[u8], len: usize) -> Self {
        let text = format!(
            "schema = 1\nname = \"test\"\nrobot = \"custom\"\nduration = \"30s\"\nseed = 4\n\
             {device}\n[world]\nstart = {{ x_m = 1.2, y_m = 1.5, heading_deg = 90 }}\n\
             [[world.wall]]\n\
             path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n"
        );
        let (scenario, source) = Scenario::parse(Path::new("<test>"), text).expect("sound");
        let bench = Bench::new(scenario, &source).expect("can be wired");
        let mut port = bench.port("lidar").expect("offered");
        port.set_timeout(Duration::from_secs(5));
        port.write_all(request).expect("room");
        let mut bytes = vec![0; len];
        port.read_exact(&mut bytes).expect("it sends");
        Self { bench, bytes }
    }

    /// Eight turns of packets and the bytes before them.
    fn xv11() -> Self {
        let device = "[device.lidar.xv11]\nsupply = { regulated-rpm = 300 }";
        Self::new(device, &[], 8 * 90 * xv11::FRAME_LEN)
    }

    /// Some six turns of nodes behind their descriptor.
    fn rplidar(command: rplidar::Command) -> Self {
        let device = "[device.lidar.rplidar]\nprofile = \"fw1.29\"";
        Self::new(device, command.request().as_bytes(), 12_000)
    }

    /// The page's turns from reads of `lens` bytes, in this order.
    fn shown(&self, lens: &[usize]) -> Vec<Vec<Beam>> {
        let run = self.bench.run();
        let scanner = run.instruments().scanner(&run.rig);
        let (_, mut scanner): (_, Box<dyn ScanDecoder>) = scanner.expect("it has a lidar");
        let pieces = pieces(&self.bytes, lens);
        pieces.filter_map(|piece| scanner.push(piece)).collect()
    }
}

/// `bytes` in pieces of `lens` bytes, repeatedly.
fn pieces<'a>(bytes: &'a [u8], lens: &'a [usize]) -> impl Iterator<Item = &'a [u8]> {
    lens.iter().cycle().scan(bytes, |rest, &len| {
        let (piece, behind) = rest.split_at(len.min(rest.len()));
        *rest = behind;
        (!piece.is_empty()).then_some(piece)
    })
}

/// The turns of an XV-11 as the robot's program assembles them. The program reads at the end of
/// each piece.
fn assembled(bytes: &[u8], lens: &[usize]) -> Vec<[u16; BEAMS]> {
    let mut assembler = TurnAssembler::new(Mounting {
        position: Point::default(),
        first_bearing: 0.0,
        distance_min_mm: 60,
        distance_max_mm: 6_000,
        weak: WeakReadings::Use,
        delay: Duration::ZERO,
    });
    let mut decoder = xv11::Decoder::default();
    let (mut at, mut turns) = (Instant::ZERO, Vec::new());
    for piece in pieces(bytes, lens) {
        // Five turns a second.
        at += Duration::from_secs(1) * u32::try_from(piece.len()).expect("short") / (5 * 90 * 22);
        for packet in decoder.push(piece).flatten() {
            turns.extend(assembler.push(at, &packet).map(|turn| turn.distances_mm));
        }
    }
    turns
}

/// The nodes of an RPLIDAR, turn by turn.
fn turns_of_nodes(bytes: &[u8], lens: &[usize]) -> Vec<Vec<rplidar::Node>> {
    let (mut decoder, mut turns) = (rplidar::Decoder::default(), vec![Vec::new()]);
    for piece in pieces(bytes, lens) {
        for frame in decoder.push(piece).flatten() {
            let rplidar::Frame::Node(node) = frame else {
                continue;
            };
            if node.starts_turn() {
                turns.push(Vec::new());
            }
            turns.last_mut().expect("one at least").push(node);
        }
    }
    turns
}

/// Lengths of reads, from single bytes to the buffer of a serial port's driver, in turn.
fn any_lens() -> impl Strategy<Value = Vec<usize>> {
    let len = prop_oneof![Just(1), 1_usize..63, 1_usize..1_024];
    vec(len, 1..40)
}

/// One byte at a time: the stream as on the line.
const UNCUT: [usize; 1] = [1];

#[test]
fn an_xv11s_turns_do_not_depend_on_where_its_stream_is_cut() {
    let recorded = Recorded::xv11();
    let bytes = &recorded.bytes;
    let whole = assembled(bytes, &UNCUT);
    let shown = recorded.shown(&UNCUT);
    // Without the boot text eight turns were recorded.
    assert!(whole.len() >= 6 && shown.len() >= 6, "{}", whole.len());
    let walls = |turn: &[u16; BEAMS]| turn.iter().filter(|&&mm| mm > 800).count();
    assert!(walls(&whole[5]) > 300, "{:?}", whole[5]);
    let cases = ProptestConfig::with_cases(128);
    proptest!(cases, |(lens in any_lens())| {
        prop_assert_eq!(assembled(bytes, &lens), &whole[..]);
        prop_assert_eq!(recorded.shown(&lens), &shown[..]);
    });
}

#[test]
fn an_rplidars_turns_do_not_depend_on_where_its_stream_is_cut() {
    let recorded = Recorded::rplidar(rplidar::Command::Scan);
    let bytes = &recorded.bytes;
    let whole = turns_of_nodes(bytes, &UNCUT);
    let shown = recorded.shown(&UNCUT);
    assert!(whole.len() >= 6 && shown.len() >= 5, "{}", whole.len());
    // A sample each 508 us and 5.5 turns a second.
    assert!((350..=366).contains(&whole[2].len()), "{}", whole[2].len());
    let cases = ProptestConfig::with_cases(128);
    proptest!(cases, |(lens in any_lens())| {
        prop_assert_eq!(turns_of_nodes(bytes, &lens), &whole[..]);
        prop_assert_eq!(recorded.shown(&lens), &shown[..]);
    });
}

/// The angles of a capsule need the next capsule, so a cut can have more effect.
#[test]
fn turns_of_capsules_do_not_depend_on_where_the_stream_is_cut() {
    let recorded = Recorded::rplidar(rplidar::Command::ExpressScan { mode: 0 });
    let shown = recorded.shown(&UNCUT);
    assert!(shown.len() >= 5, "{}", shown.len());
    let cases = ProptestConfig::with_cases(128);
    proptest!(cases, |(lens in any_lens())| {
        prop_assert_eq!(recorded.shown(&lens), &shown[..]);
    });
}
