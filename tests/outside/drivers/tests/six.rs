//! Six drivers in six styles, four of them unmodified crates of the registry, in virtual time. Each
//! test runs twenty times with the same trace.

use core::error::Error;
use core::time::Duration;
use std::sync::{Arc, Mutex};

use hilrig::prelude::*;

type Tested = Result<(), Box<dyn Error>>;
type Test = fn(&Bench) -> Tested;

const SECOND: Duration = Duration::from_secs(1);

/// Name, device, test.
const SIX: [(&str, &str, Test); 6] = [
    (
        "std: rplidar_drv_rs",
        "device.lidar.rplidar = { profile = \"fw1.29\", motor = { regulated-rpm = 330 } }",
        lidar,
    ),
    (
        "serialport: rustypot",
        "device.servo = { description = \"dynamixel-xl430\" }",
        servo,
    ),
    (
        "tokio: tokio-modbus",
        "device.meter = { description = \"modbus-meter\" }",
        meter,
    ),
    (
        "embedded-hal: mpu6050-dmp",
        "device.imu.mpu6050 = { accel_noise_m_s2 = 0.01 }",
        imu,
    ),
    (
        "a thread of the driver",
        "device.sonar.text = { baud = 9600, command = [], \
         periodic = { line = \"mm=700\", period = \"500ms\" } }",
        sonar,
    ),
    (
        "embedded-io-async",
        "device.air = { description = \"sds011\" }",
        air,
    ),
];

fn bench(device: &str) -> Result<Bench, ScenarioError> {
    Bench::from_text(&format!(
        "schema = 1\nname = \"bench\"\nrobot = \"custom\"\nduration = \"60s\"\n\
         world.start = {{ x_m = 1, y_m = 1.4, heading_deg = 0 }}\n\
         world.wall = [{{ path_m = [[0, 0], [2.6, 0], [2.6, 2.2], [0, 2.2], [0, 0]] }}]\n{device}"
    ))
}

#[test]
fn each_driver_is_tested_twenty_times_with_the_same_trace() -> Tested {
    let mut all = Vec::new();
    for (name, device, test) in SIX {
        let mut traces = Vec::new();
        for _ in 0..20 {
            let bench = bench(device)?;
            test(&bench).map_err(|error| format!("{name}: {error}"))?;
            traces.push(bench.judge().trace_hash);
        }
        traces.dedup();
        assert_eq!(traces.len(), 1, "{name}");
        all.append(&mut traces);
    }
    // A trace is the fingerprint of the bytes: no two of these are equal.
    all.sort_unstable();
    all.dedup();
    assert_eq!(all.len(), SIX.len());
    Ok(())
}

/// The wall ahead of the lidar is 1.6 m away.
fn lidar(bench: &Bench) -> Tested {
    use rplidar_drv::{RplidarDevice, ScanOptions};
    let mut lidar = RplidarDevice::with_stream(Box::new(bench.port("lidar")?));
    lidar.start_scan_with_options(&ScanOptions::with_mode(0))?;
    lidar.grab_scan()?;
    let mut scan = lidar.grab_scan()?;
    scan.retain(|point| point.is_valid() && point.angle() < 0.05);
    let nearest = scan.iter().map(|point| point.distance());
    let nearest = nearest.fold(f32::MAX, f32::min);
    assert!((1.5..1.7).contains(&nearest), "{nearest} m");
    Ok(())
}

/// Register 0 contains the model, 1060; a goal is reached only with torque enabled.
fn servo(bench: &Bench) -> Tested {
    let mut port = bench.serial("servo", 57_600)?;
    let (bus, port) = (rustypot::DynamixelProtocolHandler::v2(), port.as_mut());
    assert!(bus.ping(port, 1)?);
    assert_eq!(bus.read(port, 1, 0, 2)?, 1060_u16.to_le_bytes());
    bus.write(port, 1, 64, &[1])?;
    bus.write(port, 1, 116, &3000_i32.to_le_bytes())?;
    assert_eq!(bus.read(port, 1, 132, 4)?, 3000_i32.to_le_bytes());
    Ok(())
}

/// A serial number in register 10, a setting, and an address that the meter does not have.
fn meter(bench: &Bench) -> Tested {
    use tokio_modbus::prelude::*;
    bench.tokio(async {
        let mut meter = rtu::attach_slave(bench.port("meter")?, Slave(1));
        let serial = meter.read_input_registers(10, 2).await??;
        assert_eq!(serial, [309, 10_503]);
        meter.write_single_register(2, 250).await??;
        assert_eq!(meter.read_holding_registers(2, 1).await??, [250]);
        assert!(meter.read_holding_registers(99, 1).await?.is_err());
        Ok(())
    })
}

/// A chip at rest measures 1 g upwards: 16384 counts.
fn imu(bench: &Bench) -> Tested {
    use mpu6050_dmp::{address::Address, sensor::Mpu6050};
    let imu = Mpu6050::new(bench.i2c("imu")?, Address::default());
    let mut imu = imu.map_err(|error| format!("{:?}", error.error))?;
    bench.sleep(SECOND / 10);
    let up = imu.accel().map_err(|error| format!("{error:?}"))?.z();
    assert!((16_000..16_800).contains(&up), "{up}");
    Ok(())
}

/// Eight bytes of ten bits at 9600 baud after half a second.
fn sonar(bench: &Bench) -> Tested {
    bench.expect_thread("reader");
    let sonar = Sonar::start(bench.port("sonar")?);
    let latest = || *sonar.0.lock().expect("sound");
    assert_eq!(latest(), None);
    assert_eq!(bench.wait_until(SECOND, latest), Some(700));
    assert_eq!(bench.now().as_micros(), 508_333);
    Ok(())
}

/// 12.3 micrograms of fine dust, telegrams once a second.
fn air(bench: &Bench) -> Tested {
    let mut port = bench.port("air")?;
    assert_eq!(bench.block_on(fine_dust(&mut port))?, 123);
    let first = bench.now();
    bench.block_on(fine_dust(&mut port))?;
    assert_eq!(bench.now() - first, SECOND);
    Ok(())
}

/// A driver that keeps the latest line of a sonar in its own thread.
struct Sonar(Arc<Mutex<Option<u32>>>);

impl Sonar {
    fn start(mut port: impl std::io::Read + Send + 'static) -> Self {
        let (latest, mut line) = (Self(Arc::default()), Vec::new());
        let told = Arc::clone(&latest.0);
        std::thread::spawn(move || {
            let mut byte = [0];
            while port.read(&mut byte).is_ok_and(|len| len == 1) {
                line.push(byte[0]);
                if byte == *b"\n" {
                    let text = String::from_utf8_lossy(&line).trim().replace("mm=", "");
                    *told.lock().expect("sound") = text.parse().ok();
                    line.clear();
                }
            }
        });
        latest
    }
}

/// A driver of the dust sensor, whose telegrams have ten bytes: fine dust in tenths of a microgram.
async fn fine_dust<P: embedded_io_async::Read>(port: &mut P) -> Result<u16, String> {
    let mut telegram = [0; 10];
    loop {
        telegram.rotate_left(1);
        let read = port.read(&mut telegram[9..]).await;
        if read.map_err(|error| format!("{error:?}"))? == 0 {
            return Err("the port hung up before a whole telegram".to_owned());
        }
        let sum = telegram[2..8]
            .iter()
            .fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        if telegram[..2] == [0xAA, 0xC0] && telegram[8] == sum && telegram[9] == 0xAB {
            return Ok(u16::from_le_bytes([telegram[2], telegram[3]]));
        }
    }
}

#[test]
fn a_kind_that_needs_a_feature_names_it() {
    for (device, line) in [
        (
            "device.valve.program = { command = [\"valve\"] }",
            "device.valve.program",
        ),
        (
            "device.board.firmware = { board = \"uno\" }",
            "device.board.firmware",
        ),
    ] {
        let refused = bench(device).err().map(|error| error.to_string());
        let kind = line.rsplit('.').next().unwrap_or_default();
        let wanted =
            format!("{line}: \"{kind}\" needs the feature \"programs\" of the crate hilrig");
        assert!(
            refused.as_ref().is_some_and(|text| text.contains(&wanted)),
            "{refused:?}"
        );
    }
}
