//! Drives an RPLIDAR with the crate `rplidar_drv_rs`, like its own example, and prints each turn as
//! a line of JSON: `{"turn": [[degrees, millimetres], ..]}`.
//!
//! usage: lidar-client PORT SECONDS [sessions=N] [mode=N]
//!
//! Other requests and their answers go to stderr. DTR is left unchanged: a pseudo-terminal has no
//! DTR, and low DTR runs the motor.

use std::error::Error;
use std::fmt::Write as _;
use std::time::{Duration, Instant};

use rplidar_drv::{Channel, RplidarDevice, RplidarHostProtocol, ScanOptions, ScanPoint};
use serialport::{ClearBuffer, SerialPort};

type Lidar = RplidarDevice<dyn SerialPort>;
/// Result of the client. Errors of the driver that are not `std` errors become text.
type Outcome<T> = Result<T, Box<dyn Error>>;

/// Maximum number of consecutive damaged packets that a patient client skips.
const ERRORS_IN_A_ROW_MAX: u32 = 10;

fn main() -> Outcome<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [path, seconds, options @ ..] = &args[..] else {
        return Err("usage: lidar-client PORT SECONDS [sessions=N] [mode=N]".into());
    };
    let option = |name: &str| {
        let given = options.iter().find_map(|option| option.strip_prefix(name));
        given.map(str::parse::<u16>).transpose()
    };
    let sessions = option("sessions=")?.unwrap_or(1);
    let time = Duration::from_secs_f64(seconds.parse::<f64>()? / f64::from(sessions));
    let port = serialport::new(path, 115_200)
        .timeout(Duration::from_millis(100))
        .open()?;
    for _ in 0..sessions {
        // The driver cannot be told that a scan has ended: each session has its own driver.
        let stream = port.try_clone()?;
        let mut lidar = RplidarDevice::new(Channel::new(RplidarHostProtocol::new(), stream));
        ask(&mut lidar)?;
        scan(&mut lidar, option("mode=")?, time)?;
        lidar.stop().map_err(words)?;
        std::thread::sleep(Duration::from_millis(100));
        port.clear(ClearBuffer::Input)?;
    }
    Ok(())
}

fn words(error: impl std::fmt::Display) -> Box<dyn Error> {
    error.to_string().into()
}

/// The requests at the start: model, health, properties.
fn ask(lidar: &mut Lidar) -> Outcome<()> {
    let info = lidar.get_device_info().map_err(words)?;
    let (model, firmware) = (info.model, info.firmware_version);
    eprintln!("info: model {model:#04x} firmware {firmware:#06x}");
    eprintln!("health: {:?}", lidar.get_device_health().map_err(words)?);
    for mode in lidar.get_all_supported_scan_modes().map_err(words)? {
        eprintln!("mode: {mode:?}");
    }
    eprintln!("motor by command: {:?}", lidar.check_motor_ctrl_support());
    Ok(())
}

/// Scans for `time`, in the sensor's typical mode if none is given.
fn scan(lidar: &mut Lidar, mode: Option<u16>, time: Duration) -> Outcome<()> {
    let options = match mode {
        Some(mode) => ScanOptions::with_mode(mode),
        None => ScanOptions::default(),
    };
    let mode = lidar.start_scan_with_options(&options).map_err(words)?;
    eprintln!("scan: {}", mode.name);
    let until = Instant::now() + time;
    let mut errors = 0;
    while Instant::now() < until {
        match lidar.grab_scan() {
            Ok(points) => {
                errors = 0;
                println!("{}", turn(&points));
            }
            Err(error) if errors < ERRORS_IN_A_ROW_MAX => {
                errors += 1;
                eprintln!("passed over: {error}");
            }
            Err(error) => return Err(words(error)),
        }
    }
    Ok(())
}

fn turn(points: &[ScanPoint]) -> String {
    let mut line = String::from("{\"turn\": [");
    for (index, point) in points.iter().enumerate() {
        let comma = if index == 0 { "" } else { ", " };
        let (degrees, mm) = (point.angle().to_degrees(), point.distance() * 1e3);
        // Writing to a string cannot fail.
        let _ = write!(line, "{comma}[{degrees:.3}, {mm:.2}]");
    }
    line + "]}"
}
