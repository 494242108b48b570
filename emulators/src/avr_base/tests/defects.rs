//! The defects of the fielded builds by their ids in the field-bug catalogue: each is shown where
//! it belongs and shown absent elsewhere. A probe returns whether the base has the defect.

use super::*;
use crate::world::{Point, Wheel};

type Probe = fn(Profile) -> bool;

/// Id, description, probe.
const TABLE: [(&str, &str, Probe); 20] = [
    ("AV-01", "the documented checksum is refused", av_01),
    (
        "AV-02",
        "a write that reaches the speeds from below arms no time-out",
        av_02,
    ),
    ("AV-03a", "reads leave the register map", av_03a),
    (
        "AV-03b",
        "a write behind the map is acknowledged with what looks like an error",
        av_03b,
    ),
    (
        "AV-03c",
        "a write changes the request being worked on",
        av_03c,
    ),
    ("AV-04", "a write of 127 bytes is never answered", av_04),
    ("AV-05", "the battery's low byte is its high byte", av_05),
    ("AV-06", "a short pause can cost a frame", av_06),
    ("AV-07", "a request sent too early is lost", av_07),
    (
        "AV-08",
        "a long reply costs the head of an early request",
        av_08,
    ),
    (
        "AV-09",
        "a stray start byte costs the request behind it",
        av_09,
    ),
    ("AV-10", "a stray header swallows what follows", av_10),
    (
        "AV-11",
        "writes to read-only registers are acknowledged",
        av_11,
    ),
    (
        "AV-12",
        "an encoder can be read in the middle of a carry",
        av_12,
    ),
    ("AV-13", "a speed register shows what is not obeyed", av_13),
    ("AV-14", "small speeds have no proportional part", av_14),
    ("AV-15", "fast wheels lose counts", av_15),
    ("AV-16", "a request is answered five seconds late", av_16),
    ("AV-17", "debug text delays every reply", av_17),
    (
        "AV-18",
        "battery percent are wrong at first and never rise",
        av_18,
    ),
];

/// The second part of the table.
const TABLE_2: [(&str, &str, Probe); 2] = [
    ("AV-19", "a very near object reads as negative", av_19),
    ("AV-20", "an acknowledgement looks like an error", av_20),
];

/// Defects of the build of 2014 that the one of 2015 no longer has.
const HISTORIC: [(&str, &str, Probe); 2] = [
    ("H-AV-1", "the time-out does not stop the motors", h_av_1),
    ("H-AV-2", "speed -20 is full ahead", h_av_2),
];

#[test]
fn both_fielded_builds_have_every_defect_and_the_document_none() {
    for (id, what, probe) in TABLE.into_iter().chain(TABLE_2) {
        let found = Profile::ALL.map(probe);
        assert_eq!(found, [false, true, true], "{id}: {what}");
    }
}

#[test]
fn only_the_build_of_2014_has_the_historic_defects() {
    for (id, what, probe) in HISTORIC {
        let found = Profile::ALL.map(probe);
        assert_eq!(found, [false, false, true], "{id}: {what}");
    }
}

fn bench(profile: Profile) -> Bench {
    Bench::new(in_phase(profile))
}

fn is_error(bench: &Bench, reply: &[u8]) -> bool {
    reply == Frame::read(0xFF, 0, bench.order()).as_bytes()
}

fn av_01(profile: Profile) -> bool {
    let mut bench = bench(profile);
    let reply = bench.ask(&hex("AB 24 0A D9 00"));
    is_error(&bench, &reply)
}

/// Registers 45..=47 in one write. The build of 2014 does not stop in any case.
fn av_02(profile: Profile) -> bool {
    let mut bench = bench(profile);
    bench.write(45, &[0, 20, 20]);
    bench.run(Duration::from_secs(10));
    bench.world.is_moving()
}

fn av_03a(profile: Profile) -> bool {
    bench(profile).read(50, 10).len() == 10
}

/// The task table lies below the map, so that the timer task runs on: the motors time out.
fn av_03b(profile: Profile) -> bool {
    let mut bench = bench(profile);
    // The distance that lies there is not refreshed in the next 150 ms.
    bench.run(110 * MS);
    let reply = bench.write(255, &[0xFF]);
    is_error(&bench, &reply) && bench.read(255, 1) == [0xFF]
}

/// The write `AB 37 81 FF` to the data pointer is acknowledged.
fn av_03c(profile: Profile) -> bool {
    let mut bench = bench(profile);
    let reply = bench.write(55, &[0xFF]);
    reply == Frame::read(55, 0, bench.order()).as_bytes()
}

fn av_04(profile: Profile) -> bool {
    bench(profile).write(0, &[0; 127]).is_empty()
}

/// 12000 mV are 2EE0 hex.
fn av_05(profile: Profile) -> bool {
    let mut bench = Bench::new(AvrBaseConfig {
        battery: BatteryConfig {
            start_mv: 12_000.0,
            drop_mv_per_s: 0.0,
        },
        ..in_phase(profile)
    });
    bench.run(100 * MS);
    bench.read(33, 2) == [0x2E, 0x00]
}

/// A frame has a pause of 1.5 ms, during which the divider counts.
fn av_06(profile: Profile) -> bool {
    let mut bench = bench(profile);
    bench.run(Duration::from_micros(24_500) - 10 * MS);
    let frame = Frame::read(36, 1, bench.order());
    bench.send(&frame.as_bytes()[..2]);
    bench.run(MS + MS / 2);
    bench.send(&frame.as_bytes()[2..]);
    bench.run(MS);
    bench.take().is_empty()
}

fn av_07(profile: Profile) -> bool {
    let mut bench = bench(profile);
    let frame = Frame::read(36, 1, bench.order());
    bench.ask(&frame.as_bytes().repeat(2)).len() < 12
}

/// A read of all 53 registers, and the next request while the reply fills the ring.
fn av_08(profile: Profile) -> bool {
    let mut bench = bench(profile);
    let order = bench.order();
    bench.send(Frame::read(0, 53, order).as_bytes());
    bench.run(MS / 5);
    bench.send(Frame::read(36, 1, order).as_bytes());
    bench.run(2 * MS);
    bench.take().len() == 58
}

fn av_09(profile: Profile) -> bool {
    let mut bench = bench(profile);
    let mut bytes = vec![0xAB];
    bytes.extend(Frame::read(36, 10, bench.order()).as_bytes());
    let reply = bench.ask(&bytes);
    is_error(&bench, &reply)
}

/// A header announces 126 bytes; 3 ms later a good frame follows.
fn av_10(profile: Profile) -> bool {
    let mut bench = bench(profile);
    bench.send(&hex("AB 00 FE"));
    bench.run(3 * MS);
    bench.send(Frame::read(36, 1, bench.order()).as_bytes());
    bench.run(MS);
    bench.take().is_empty()
}

fn av_11(profile: Profile) -> bool {
    let mut bench = bench(profile);
    let reply = bench.write(35, &[0x55]);
    reply == Frame::read(35, 0, bench.order()).as_bytes()
}

/// Every read that can be torn is torn; at some point the count jumps back.
fn av_12(profile: Profile) -> bool {
    let mut bench = Bench::new(AvrBaseConfig {
        encoder_tear: 1.0,
        ..in_phase(profile)
    });
    let mut counts = vec![0];
    for _ in 0..150 {
        bench.write(46, &[30, 30, 0]);
        let bytes = bench.read(36, 4);
        counts.push(i32::from_le_bytes(bytes.try_into().unwrap()));
    }
    counts.windows(2).any(|pair| pair[1] - pair[0] > 200)
}

fn av_13(profile: Profile) -> bool {
    let mut bench = bench(profile);
    bench.write(46, &[100]);
    bench.read(46, 1) == [100] && bench.base.set_points() == [35, 0]
}

/// First drive after speed 2 is set, with the wheel at rest. The fielded regulator gives
/// 2 * 0 + 2 * (0 + 1) = 2, the documented one 2 * 1 + 2 = 4; the pulse widths are 41 and 43. In
/// 2014 there was no integral either: 0.
fn av_14(profile: Profile) -> bool {
    let mut bench = bench(profile);
    bench.run(2 * MS);
    bench.write(46, &[2, 0, 0]);
    bench.run(REGULATOR);
    matches!(bench.world.drive(Wheel::Left), Drive::Power(pulse) if pulse < 43)
}

/// A wheel with four times the encoder lines turns 3100 edges a second: three per look.
fn av_15(profile: Profile) -> bool {
    let scene = Scene::new::<Shape>([], vec![]).unwrap();
    let body = BodyConfig {
        ticks_per_turn: 1_440,
        ..BodyConfig::default().ideal()
    };
    let mut bench = bench(profile);
    bench.world = World::new(scene, body, Pose::default(), 1).unwrap();
    bench.run(Duration::ZERO);
    bench.write(46, &[35, 35, 0]);
    bench.run(900 * MS);
    let count = i32::from_le_bytes(bench.read(36, 4).try_into().unwrap());
    i64::from(count) < bench.world.encoder_ticks(Wheel::Left) / 2
}

fn av_16(profile: Profile) -> bool {
    let mut bench = bench(profile);
    bench.base.reset(bench.now, StartCause::Watchdog);
    let frame = Frame::read(36, 1, bench.order());
    bench.ask(frame.as_bytes());
    bench.run(Duration::from_secs(6));
    bench.take().len() == 6
}

/// The option exists only in the fielded firmware: replies 7.2 to 8.4 ms late.
fn av_17(profile: Profile) -> bool {
    let mut bench = Bench::new(AvrBaseConfig {
        debug_text: DebugText::On,
        ..in_phase(profile)
    });
    let frame = Frame::read(36, 1, bench.order());
    bench.send(frame.as_bytes());
    let end = bench.now;
    bench.run(10 * MS);
    let late = bench.sent[0].0 - end;
    let mut text = [0; 200];
    let len = bench.base.transmit(AvrBase::DEBUG, &mut text);
    late >= Duration::from_micros(7_150) && len == 103
}

fn av_18(profile: Profile) -> bool {
    let mut bench = bench(profile);
    let first = bench.read(35, 1);
    bench.run(200 * MS);
    bench.base.replace_battery(
        bench.now,
        BatteryConfig {
            start_mv: 10_500.0,
            drop_mv_per_s: 0.0,
        },
    );
    bench.run(200 * MS);
    bench
        .base
        .replace_battery(bench.now, BatteryConfig::default());
    bench.run(200 * MS);
    first == [0] && bench.read(35, 1) == [25]
}

/// A wall is 30 mm in front of the long-range sensor.
fn av_19(profile: Profile) -> bool {
    let wall = Shape::Wall {
        from: Point::new(0.18, -1.0),
        to: Point::new(0.18, 1.0),
    };
    let mut bench = bench(profile);
    let scene = Scene::new([wall], vec![]).unwrap();
    bench.world = World::new(scene, BodyConfig::default(), Pose::default(), 1).unwrap();
    bench.run(300 * MS);
    let bytes = bench.read(9, 2);
    i16::from_le_bytes(bytes.try_into().unwrap()) < 0
}

fn av_20(profile: Profile) -> bool {
    let mut bench = bench(profile);
    bench.run(110 * MS);
    let reply = bench.write(255, &[0x55]);
    is_error(&bench, &reply) && bench.read(255, 1) == [0x55]
}

/// The base receives nothing for five seconds.
fn h_av_1(profile: Profile) -> bool {
    let mut bench = bench(profile);
    bench.write(46, &[20, 20, 0]);
    bench.run(Duration::from_secs(5));
    bench.world.is_moving()
}

fn h_av_2(profile: Profile) -> bool {
    let mut bench = bench(profile);
    bench.write(46, &[20, 0xEC, 0]);
    bench.run(500 * MS);
    bench.base.set_points() == [20, 35] && bench.world.wheel_speed(Wheel::Right) > 0.0
}
