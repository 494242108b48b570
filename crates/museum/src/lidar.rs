//! The lidar stream in the robot's program.

use core::time::Duration;

use emulators::rng::Rng;
use firmware_core::packets::Packets;
use firmware_core::robots::rescue::Rescue;
use firmware_core::scan::TurnAssembler;
use firmware_core::{Inspect, Master};
use protocols::xv11::{FRAME_LEN, RawReading, Reading, SpeedWord};
use protocols::{Decode, FrameError, Instant, pcui, xv11};

use super::robot::{MS, Robot, config, packet, packet_at, range};
use super::{Bug, Observation, Variant};
use engine::codec::{PCUI, XV11};

const LIDAR: &str = "robot's program, lidar";

pub(super) const ROWS: [Bug; 12] = [
    Bug::mutant(
        "XV-01",
        LIDAR,
        "with the checksum comparison only the first packet passes: the sum is never cleared",
        xv_01,
    ),
    Bug::mutant(
        "XV-02",
        LIDAR,
        "without the comparison one flipped bit makes a distance 8192 mm wrong",
        xv_02,
    ),
    Bug::mutant(
        "XV-03",
        LIDAR,
        "a damaged index writes up to 65535 elements outside an array of 360",
        xv_03,
    ),
    Bug::mutant(
        "XV-04",
        LIDAR,
        "in a scene of 1018 mm a false start byte repeats: the decoder stays locked on it",
        xv_04,
    ),
    Bug::mutant(
        "XV-05",
        LIDAR,
        "one byte lost in a revolution sometimes causes a write outside the array",
        xv_05,
    ),
    Bug::mutant(
        "XV-06",
        LIDAR,
        "a damaged packet 0 causes the loss of the whole revolution",
        xv_06,
    ),
    Bug::mutant(
        "XV-07",
        LIDAR,
        "the distances of a missing packet keep the values of an earlier turn",
        xv_07,
    ),
    Bug::mutant(
        "XV-08",
        LIDAR,
        "after the lidar is unplugged the program waits forever; only the base stops the robot",
        xv_08,
    ),
    Bug::mutant(
        "XV-09",
        LIDAR,
        "each lost packet kicks the lidar's motor",
        xv_09,
    ),
    Bug::mutant(
        "XV-10",
        LIDAR,
        "readings with the strength warning are discarded",
        xv_10,
    ),
    Bug::mutant(
        "XV-11",
        LIDAR,
        "so near to a wall that no beam returns a distance, the robot drives straight ahead",
        xv_11,
    ),
    Bug::mutant(
        "XV-12",
        LIDAR,
        "with the raw stream enabled, lidar bytes appear between the PC's frames",
        xv_12,
    ),
];

/// Result of reading a stream of packets.
struct Read {
    packets: Vec<xv11::Frame>,
    errors: Vec<FrameError>,
    intake: Packets,
}

fn read(variant: Variant, id: &str, bytes: &[u8]) -> Read {
    let mut intake = Packets::with_defects(config(variant, id).defects.packets);
    let (mut packets, mut errors) = (Vec::new(), Vec::new());
    let mut input = bytes;
    while let Some(outcome) = intake.step(&mut input) {
        match outcome {
            Ok(packet) => packets.push(packet),
            Err(error) => errors.push(error),
        }
    }
    Read {
        packets,
        errors,
        intake,
    }
}

fn xv_01(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let bytes = [0, 1].map(|index| *packet(index, range(1000)).as_bytes());
    seen.bytes("lidar", &XV11, bytes.as_flattened());
    let read = read(variant, "XV-01", bytes.as_flattened());
    seen.figure("packets that pass", read.packets.len());
    let computed = match read.errors.first() {
        Some(FrameError::Checksum { expected, found }) => format!("{expected:04X} for {found:04X}"),
        _ => "as sent".to_owned(),
    };
    seen.figure("checksum of the second packet", computed);
    seen.judged(read.packets.len() == 1)
}

/// Byte 5 holds the high bits of the first distance.
fn xv_02(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let mut bytes = *packet(0, range(1000)).as_bytes();
    bytes[5] ^= 0x20;
    seen.bytes("lidar", &XV11, &bytes);
    let read = read(variant, "XV-02", &bytes);
    let readings = read.packets.first().map(xv11::Frame::readings);
    let distance = match readings {
        Some([Reading::Range { distance_mm, .. }, ..]) => distance_mm,
        _ => 0,
    };
    let told = match distance {
        0 => "none, the packet is rejected".to_owned(),
        distance => format!("{distance} mm"),
    };
    seen.figure("first distance", told);
    seen.judged(distance == 1000 + 8192)
}

/// A packet that is valid except for its index byte.
fn xv_03(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let mut places = Vec::new();
    for index in [0xFA, 0xFF, 0x00, 0x9F] {
        let mut bytes = *packet(0, range(1000)).as_bytes();
        bytes[1] = index;
        seen.bytes("lidar", &XV11, &bytes);
        let stray = read(variant, "XV-03", &bytes).intake.stray_writes();
        places.extend((stray.count > 0).then(|| stray.first.to_string()));
    }
    let told = if places.is_empty() {
        "none".to_owned()
    } else {
        places.join(", ")
    };
    seen.figure("places written beside the array of 360", &told);
    seen.judged(told == "360, 380, 64896, 65532")
}

fn xv_04(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let turn: Vec<u8> = (0..90)
        .flat_map(|index| *packet(index, range(0x03FA)).as_bytes())
        .collect();
    let stream = turn.repeat(21);
    let joined = &stream[5..];
    seen.bytes("lidar", &XV11, &joined[..60]);
    let read = read(variant, "XV-04", joined);
    let stray = read.intake.stray_writes();
    seen.figure("packets of 21 turns taken", read.packets.len());
    seen.figure("writes beside the array", stray.count);
    seen.judged(read.packets.is_empty() && stray.count == 1889 && stray.first == 64_908)
}

/// A turn of random distances.
fn random_turn(rng: &mut Rng) -> Vec<u8> {
    let mut distance = || {
        let mm = rng.uniform() * 6000.0;
        #[expect(clippy::cast_possible_truncation, reason = "below 6000")]
        let mm = mm as u16;
        RawReading::from(range(mm))
    };
    (0..90)
        .flat_map(|index| {
            let readings = core::array::from_fn(|_| distance());
            *xv11::Frame::new(index, SpeedWord(300 * 64), readings).as_bytes()
        })
        .collect()
}

fn xv_05(variant: Variant) -> Observation {
    const TURNS: usize = 2000;
    let mut rng = Rng::stream(1, "museum.xv-05");
    let mut intake = Packets::with_defects(config(variant, "XV-05").defects.packets);
    let mut hit = 0;
    for _ in 0..TURNS {
        let mut bytes = random_turn(&mut rng);
        let place = rng.uniform() * 1980.0;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "0 to 1979"
        )]
        bytes.remove(place as usize);
        let before = intake.stray_writes().count;
        let mut input = &bytes[..];
        while intake.step(&mut input).is_some() {}
        hit += usize::from(intake.stray_writes().count > before);
    }
    let mut seen = Observation::default();
    seen.figure(
        "of 2000 turns that lost a byte, with a write beside the array",
        hit,
    );
    seen.judged(hit > 0)
}

fn arrival(turn: u64, index: u8) -> Instant {
    Instant::from_nanos(turn * 200_000_000 + (u64::from(index) + 1) * 200_000_000 / 90)
}

/// Feeds a turn of packets with this reading, without those in `lost`; returns how many turns
/// ended.
fn feed(assembler: &mut TurnAssembler, turn: u64, reading: Reading, lost: &[u8]) -> usize {
    let kept = (0..90).filter(|index| !lost.contains(index));
    kept.filter(|index| {
        let packet = packet(*index, reading);
        assembler.push(arrival(turn, *index), &packet).is_some()
    })
    .count()
}

fn assembler(variant: Variant, id: &str) -> TurnAssembler {
    let config = config(variant, id);
    TurnAssembler::with_defects(config.mounting, config.defects.scan)
}

fn xv_06(variant: Variant) -> Observation {
    let mut assembler = assembler(variant, "XV-06");
    let turns: usize = (0..5)
        .map(|turn| feed(&mut assembler, turn, range(1000), &[0]))
        .sum();
    let mut seen = Observation::default();
    let mut bytes = *packet(0, range(1000)).as_bytes();
    bytes[20] ^= 1;
    seen.bytes("lidar", &XV11, &bytes);
    seen.figure("of 5 turns without packet 0 used", turns);
    seen.judged(turns == 0)
}

fn xv_07(variant: Variant) -> Observation {
    let mut assembler = assembler(variant, "XV-07");
    feed(&mut assembler, 0, range(1000), &[]);
    feed(&mut assembler, 1, range(2000), &[40]);
    let distance = assembler.turn().distances_mm[160];
    let mut seen = Observation::default();
    seen.figure(
        "distances of the turn, mm",
        assembler.turn().distances_mm[0],
    );
    seen.figure(
        "distance of a beam that did not arrive (0: none), mm",
        distance,
    );
    seen.judged(distance == 1000)
}

fn xv_08(variant: Variant) -> Observation {
    let mut robot = Robot::exploring(variant, "XV-08");
    robot.scene = Some(range(2000));
    robot.run(Duration::from_secs(2));
    robot.note_set_points("set-points while it sees");
    robot.scene = None;
    robot.run(500 * MS);
    let before = robot.requests;
    robot.run(Duration::from_secs(1));
    let requests = robot.requests - before;
    let set_points = robot.note_set_points("set-points a second after the last packet");
    robot
        .seen
        .figure("requests to the base in the last second", requests);
    robot
        .seen
        .figure("the program says", Inspect::mode(&*robot.program));
    robot.judged(requests == 0 && set_points != [0, 0])
}

/// The lidar reports 310 rpm until the duty has decreased, then a packet is damaged.
fn xv_09(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "XV-09");
    let send = |robot: &mut Robot, damage: u8| {
        let mut bytes = *packet_at(310, 0, range(1000)).as_bytes();
        bytes[20] ^= damage;
        robot.program.receive(Rescue::LIDAR, robot.now, &bytes);
        robot.run(2 * MS);
        bytes
    };
    for _ in 0..300 {
        send(&mut robot, 0);
    }
    let before = robot.duty;
    let damaged = send(&mut robot, 1);
    robot.run(60 * MS);
    let after = robot.duty;
    robot.seen.bytes("lidar", &XV11, &damaged);
    robot
        .seen
        .figure("duty before, of 255", before.unwrap_or(0));
    robot
        .seen
        .figure("duty after a damaged packet, of 255", after.unwrap_or(0));
    robot.judged(before != after && after == Some(180))
}

fn xv_10(variant: Variant) -> Observation {
    let weak = Reading::Range {
        distance_mm: 300,
        strength: 5,
        weak: true,
    };
    let mut assembler = assembler(variant, "XV-10");
    feed(&mut assembler, 0, weak, &[]);
    let distance = assembler.turn().distances_mm[0];
    let mut seen = Observation::default();
    seen.bytes("lidar", &XV11, packet(0, weak).as_bytes());
    seen.figure("distance believed (0: none), mm", distance);
    seen.judged(distance == 0)
}

fn xv_11(variant: Variant) -> Observation {
    let nothing = Reading::Invalid {
        code: 0x35,
        strength: 0,
    };
    let mut robot = Robot::exploring(variant, "XV-11");
    robot.scene = Some(nothing);
    robot.run(Duration::from_secs(2));
    robot
        .seen
        .bytes("lidar", &XV11, packet(0, nothing).as_bytes());
    let set_points = robot.note_set_points("set-points with every beam invalid");
    robot.judged(set_points == [20, 20])
}

fn xv_12(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "XV-12");
    robot.scene = Some(range(1000));
    robot.run(Duration::from_secs(1));
    let mut decoder = pcui::Decoder::default();
    let frames = decoder.push(&robot.radio).flatten().count();
    let strays = decoder.discarded();
    let start = robot
        .radio
        .windows(FRAME_LEN)
        .position(|w| w[..2] == [0xFA, 0xA0]);
    let from = start.unwrap_or(0);
    let shown = robot.radio[from..]
        .iter()
        .take(60)
        .copied()
        .collect::<Vec<_>>();
    robot.seen.bytes("robot", &PCUI, &shown);
    robot.seen.figure("frames", frames);
    robot.seen.figure("bytes that are no frame", strays);
    robot.judged(strays > 1000)
}
