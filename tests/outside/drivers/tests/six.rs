//! Six drivers in six styles, four of them unmodified crates of the registry, in virtual time. Each
//! runs twenty times with the same trace.

use core::error::Error;
use core::time::Duration;

use hilrig::prelude::*;

type Tested = Result<(), Box<dyn Error>>;

/// Runs `test` twenty times on a bench of this device.
fn twenty_times(device: &str, test: impl Fn(&Bench) -> Tested) -> Tested {
    let mut traces = Vec::new();
    for _ in 0..20 {
        let bench = Bench::from_text(&format!(
            "schema = 1\nname = \"bench\"\nrobot = \"custom\"\nduration = \"60s\"\n\
             world.start = {{ x_m = 1, y_m = 1.4, heading_deg = 0 }}\n\
             world.wall = [{{ path_m = [[0, 0], [2.6, 0], [2.6, 2.2], [0, 2.2], [0, 0]] }}]\n{device}"
        ))?;
        test(&bench)?;
        traces.push(bench.judge().trace_hash);
    }
    traces.dedup();
    assert_eq!(traces.len(), 1);
    Ok(())
}

/// std: the wall ahead of the lidar is 1.6 m away.
#[test]
fn std_rplidar_drv() -> Tested {
    twenty_times(
        "device.lidar.rplidar = { motor = { regulated-rpm = 330 } }",
        |bench| {
            let mut lidar = rplidar_drv::RplidarDevice::with_stream(Box::new(bench.port("lidar")?));
            lidar.start_scan_with_options(&rplidar_drv::ScanOptions::with_mode(0))?;
            lidar.grab_scan()?;
            let scan = lidar.grab_scan()?;
            let ahead = scan
                .iter()
                .filter(|point| point.is_valid() && point.angle() < 0.05);
            let nearest = ahead.map(|point| point.distance()).fold(f32::MAX, f32::min);
            assert!((1.5..1.7).contains(&nearest), "{nearest} m");
            Ok(())
        },
    )
}

/// serialport: model 1060 at register 0; a goal is reached once torque is on.
#[test]
fn serialport_rustypot() -> Tested {
    twenty_times(
        "device.servo = { description = \"dynamixel-xl430\" }",
        |bench| {
            let mut port = bench.serial("servo", 57_600)?;
            let bus = rustypot::DynamixelProtocolHandler::v2();
            let port = port.as_mut();
            assert!(bus.ping(port, 1).expect("answers"));
            assert_eq!(
                bus.read(port, 1, 0, 2).expect("answers"),
                1060_u16.to_le_bytes()
            );
            bus.write(port, 1, 64, &[1]).expect("answers");
            bus.write(port, 1, 116, &3000_i32.to_le_bytes())
                .expect("answers");
            assert_eq!(
                bus.read(port, 1, 132, 4).expect("answers"),
                3000_i32.to_le_bytes()
            );
            Ok(())
        },
    )
}

/// tokio: a serial number at 10, a label at 3, and an answer that a cut line never gives.
#[test]
fn tokio_modbus() -> Tested {
    use tokio_modbus::prelude::*;
    twenty_times(
        "device.meter = { description = \"modbus-meter\" }",
        |bench| {
            bench.tokio(async {
                let mut meter = rtu::attach_slave(bench.port("meter")?, Slave(1));
                let serial = meter.read_input_registers(10, 2).await??;
                assert_eq!(
                    u32::from(serial[0]) << 16 | u32::from(serial[1]),
                    20_261_127
                );
                meter.write_single_register(2, 250).await??;
                assert_eq!(meter.read_holding_registers(2, 1).await??, [250]);
                assert!(meter.read_holding_registers(99, 1).await?.is_err());
                Ok(())
            })
        },
    )
}

/// embedded-hal: a chip at rest measures 1 g upwards.
#[test]
fn i2c_mpu6050_dmp() -> Tested {
    twenty_times(
        "device.imu.mpu6050 = { accel_noise_m_s2 = 0.01 }",
        |bench| {
            let address = mpu6050_dmp::address::Address::default();
            let imu = mpu6050_dmp::sensor::Mpu6050::new(bench.i2c("imu")?, address);
            let mut imu = imu.map_err(|_| "no chip")?;
            bench.sleep(Duration::from_millis(100));
            let up = imu.accel().map_err(|_| "no answer")?.z();
            assert!((16_000..16_800).contains(&up), "{up} of 16384");
            Ok(())
        },
    )
}

/// Threads: a driver that keeps the latest line in a thread of its own.
struct Sonar(std::sync::Arc<std::sync::Mutex<Option<u32>>>);

impl Sonar {
    fn start(mut port: impl std::io::Read + Send + 'static) -> Self {
        let (latest, mut line) = (Self(std::sync::Arc::default()), Vec::new());
        let told = std::sync::Arc::clone(&latest.0);
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

#[test]
fn a_thread_of_the_driver() -> Tested {
    let sonar = "[device.sonar.text]\nbaud = 9600\ncommand = []\n\
                 periodic = { line = \"mm=700\", period = \"500ms\" }";
    twenty_times(sonar, |bench| {
        bench.expect_thread("reader");
        let sonar = Sonar::start(bench.port("sonar")?);
        let latest = || *sonar.0.lock().expect("sound");
        assert_eq!(latest(), None);
        assert_eq!(bench.wait_until(Duration::from_secs(1), latest), Some(700));
        // Eight bytes of ten bits at 9600 baud after half a second.
        assert_eq!(bench.now().as_micros(), 508_333);
        Ok(())
    })
}

/// embedded-io-async: a driver of our own for the dust sensor's telegram of ten bytes.
async fn dust<P: embedded_io_async::Read>(port: &mut P) -> Result<[u16; 2], P::Error> {
    let mut telegram = [0; 10];
    loop {
        telegram.rotate_left(1);
        port.read(&mut telegram[9..]).await?;
        let sum = telegram[2..8]
            .iter()
            .fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        if telegram[..2] == [0xAA, 0xC0] && telegram[8] == sum && telegram[9] == 0xAB {
            return Ok([2, 4].map(|at| u16::from_le_bytes([telegram[at], telegram[at + 1]])));
        }
    }
}

#[test]
fn embedded_io_async_dust() -> Tested {
    twenty_times("device.air = { description = \"sds011\" }", |bench| {
        let mut port = bench.port("air")?;
        let [fine, coarse] = bench.block_on(dust(&mut port))?;
        assert!(
            (50..=500).contains(&fine) && coarse >= fine,
            "{fine} {coarse}"
        );
        let late = bench.now();
        bench.block_on(dust(&mut port))?;
        assert_eq!((bench.now() - late).as_secs_f64().round(), 1.0);
        Ok(())
    })
}
