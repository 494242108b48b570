//! Chips on a bus and a depth camera alone: their answers to requests, and the effects of their own
//! faults.

use core::time::Duration;
use std::io::{Read as _, Write as _};
use std::path::Path;

use hilrig::ports::{Bench, VirtualPort};
use hilrig::scenario::Scenario;
use protocols::perception::Message;

/// A wall 1 m ahead of a robot that stands still for 20 s, with `device`, and with a fault of it
/// from the tenth second on.
fn bench(device: &str, fault: Option<(&str, &str)>) -> Bench {
    let fault = fault.map(|(name, more)| {
        let device = device.split(['.', ']']).nth(1).expect("a name");
        format!(
            "[[fault]]\ndevice = \"{device}\"\nkind = \"device\"\nfault = \"{name}\"\n\
             from = \"10s\"\n{more}"
        )
    });
    let text = format!(
        "schema = 1\nname = \"chips\"\nrobot = \"rescue\"\nduration = \"20s\"\n{device}\n{}\n\
         [world]\nstart = {{ x_m = 1.0, y_m = 1.0, heading_deg = 0 }}\n\
         [[world.wall]]\npath_m = [[2.0, -2.0], [2.0, 4.0]]\n",
        fault.unwrap_or_default()
    );
    let (scenario, source) = Scenario::parse(Path::new("<test>"), text).expect("sound");
    Bench::new(scenario, &source).expect("can be wired")
}

/// Makes one transaction and returns the answer; `None` from a chip that does not acknowledge.
fn transact(bus: &mut VirtualPort, message: &[u8], answer: usize) -> Option<Vec<u8>> {
    bus.write_all(message).expect("room");
    bus.flush().expect("sent");
    let mut bytes = vec![0; answer];
    if answer == 0 {
        return Some(bytes);
    }
    let len = bus.read(&mut bytes).ok()?;
    (len == answer).then_some(bytes)
}

/// The range in centimetres that the chip at E2 measures, 70 ms after the request.
fn range_cm(bench: &Bench, bus: &mut VirtualPort) -> Option<u16> {
    transact(bus, &[0xE2, 0x00, 0x51], 0);
    // An echo from 6 m takes longer than this, and so does the default range of 11 m.
    bench.sleep(Duration::from_millis(20));
    let meanwhile = transact(bus, &[0xE3, 1], 1);
    // While it ranges, no chip acknowledges and none pulls the bus down.
    let is_idle = meanwhile.is_none_or(|bytes| bytes == [0xFF]);
    assert!(is_idle, "it acknowledges while it ranges");
    bench.sleep(Duration::from_millis(70));
    transact(bus, &[0xE2, 0x02], 0);
    let bytes = transact(bus, &[0xE3, 2], 2)?;
    Some(u16::from_be_bytes([bytes[0], bytes[1]]))
}

const RANGER: &str = "[device.ranger.srf08]\naddress = 0xE2\nnoise_m = 0\n";

/// A wall of 1 m is 100 cm. The faults give half a metre more, no echo or no answer; a stuck ranger
/// repeats its last echo.
#[test]
fn a_ranger_by_itself_tells_100_cm_and_its_faults_something_else() {
    let rows = [
        ("none", None, Some(100)),
        ("wrong", Some(("wrong", "")), Some(150)),
        ("deaf", Some(("deaf", "")), Some(0)),
        ("stuck", Some(("stuck", "")), Some(100)),
        ("off", Some(("off", "")), None),
    ];
    for (name, fault, expected) in rows {
        let bench = bench(RANGER, fault);
        let mut bus = bench.raw("ranger").expect("a port");
        bus.set_timeout(Duration::from_millis(20));
        assert_eq!(range_cm(&bench, &mut bus), Some(100), "{name}");
        bench.sleep(Duration::from_secs(10));
        assert_eq!(range_cm(&bench, &mut bus), expected, "{name}");
    }
}

const GYRO: &str = "[device.gyro.mpu6050]\ngyro_bias_dps = [0, 0, 1.0]\n";

/// Identity 68. At rest the turn rate is the bias of 1 degree a second, at a range of 2000 with
/// 16.4 counts a degree. A chip asleep after a power dip shows nothing; a clone has another
/// identity.
#[test]
fn a_gyroscope_by_itself_has_its_name_and_its_bias() {
    let ask = |bus: &mut VirtualPort| {
        transact(bus, &[0xD0, 0x75], 0);
        let name = transact(bus, &[0xD1, 1], 1)?;
        transact(bus, &[0xD0, 0x47], 0);
        let rate = transact(bus, &[0xD1, 2], 2)?;
        Some((name[0], i16::from_be_bytes([rate[0], rate[1]])))
    };
    let rows: [(&str, Option<u8>, core::ops::RangeInclusive<i16>); 4] = [
        ("off", None, 0..=0),
        ("restart", Some(0x68), 0..=0),
        ("stuck", Some(0x68), 12..=21),
        ("wrong", Some(0x98), 12..=21),
    ];
    for (fault, name, rates) in rows {
        let bench = bench(GYRO, Some((fault, "")));
        let mut bus = bench.raw("gyro").expect("a port");
        bus.set_timeout(Duration::from_millis(20));
        transact(&mut bus, &[0xD0, 0x6B, 0x00], 0);
        transact(&mut bus, &[0xD0, 0x1B, 0x18], 0);
        let (found, rate) = ask(&mut bus).expect("it is there");
        // Four deviations of 0.05 degrees are 3 counts.
        assert!(found == 0x68 && (12..=21).contains(&rate), "{rate}");
        bench.sleep(Duration::from_secs(10));
        let found = ask(&mut bus);
        assert_eq!(found.map(|it| it.0), name, "{fault}");
        assert!(
            found.is_none_or(|it| rates.contains(&it.1)),
            "{fault}: {found:?}"
        );
    }
}

const CAMERA: &str = "[device.camera.camera]\ngaps = 0\nnoise_m = 0\n";

/// Rows of depths received within a second, each with the number of its 640 columns that have a
/// depth.
fn rows(bench: &Bench, scan: &mut VirtualPort) -> Vec<Option<usize>> {
    let end = bench.now() + Duration::from_secs(1);
    let mut rows = Vec::new();
    while bench.now() < end {
        let mut message = [0; 2_000];
        let Ok(len) = scan.read(&mut message) else {
            continue;
        };
        rows.push(match Message::decode(&message[..len]) {
            Ok(Message::DepthRow(row)) => Some(row.depths_mm().filter(|mm| *mm > 0).count()),
            _ => None,
        });
    }
    rows
}

/// The camera sends 30 rows a second with all columns; each fault changes the rows in its own way.
#[test]
fn a_camera_by_itself_sends_30_rows_a_second_and_its_faults_others() {
    type Expected = fn(&[Option<usize>]) -> bool;
    let table: [(&str, &str, Expected); 6] = [
        ("off", "", <[_]>::is_empty),
        ("slow", "", |rows| (4..=6).contains(&rows.len())),
        ("garbage", "", |rows| {
            rows.len() >= 29 && rows.iter().all(Option::is_none)
        }),
        ("stuck", "", |rows| rows.iter().all(|it| *it == Some(640))),
        ("blind", "", |rows| {
            rows.len() >= 29 && rows.iter().all(|it| *it == Some(0))
        }),
        ("battery", "", |rows| {
            rows.iter()
                .all(|it| it.is_some_and(|seen| (257..383).contains(&seen)))
        }),
    ];
    for (fault, more, holds) in table {
        let bench = bench(CAMERA, Some((fault, more)));
        let mut scan = bench.raw("camera").expect("a port");
        scan.set_timeout(Duration::from_millis(100));
        let before = rows(&bench, &mut scan);
        assert!(before.len() >= 29, "{}", before.len());
        assert!(before.iter().all(|it| *it == Some(640)), "{before:?}");
        bench.sleep(Duration::from_millis(9_050));
        while scan.read(&mut [0; 2_000]).is_ok() && bench.now().as_millis() < 10_080 {}
        let after = rows(&bench, &mut scan);
        assert!(holds(&after), "{fault}: {after:?}");
        // After the collapse no bytes arrive for five seconds.
        if fault == "battery" {
            bench.sleep(Duration::from_secs(5));
            while scan.read(&mut [0; 2_000]).is_ok() {}
            assert!(rows(&bench, &mut scan).is_empty());
        }
    }
}
