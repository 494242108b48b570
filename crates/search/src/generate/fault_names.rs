use emulators::avr_base::{Announce, AvrBase, AvrBaseConfig};
use emulators::camera::{Camera, CameraConfig};
use emulators::car_board::{BoardConfig, CarBoard};
use emulators::hc06::{Hc06, Profile};
use emulators::odometer::{Odometer, OdometerConfig};
use emulators::wheel_board::WheelBoard;
use emulators::xv11::Xv11;
use emulators::{Device, rplidar, wheel_board, xv11};

/// Names of the faults of the built-in devices.
pub(super) fn of_devices() -> impl Iterator<Item = &'static str> {
    let base = AvrBaseConfig {
        announce: Announce::StopButton,
        ..AvrBaseConfig::default()
    };
    let devices: [Box<dyn Device>; 8] = [
        Box::new(AvrBase::new(base, 0)),
        Box::new(CarBoard::new(BoardConfig::default())),
        Box::new(Camera::new(CameraConfig::default(), 0, "camera")),
        Box::new(Hc06::new(Profile::default(), 0)),
        Box::new(Odometer::new(OdometerConfig::default())),
        Box::new(WheelBoard::new("board", 0, wheel_board::Config::default())),
        Box::new(Xv11::new("lidar", 0, xv11::Config::default())),
        Box::new(rplidar::Rplidar::new(
            "lidar",
            0,
            rplidar::Config::default(),
        )),
    ];
    let names = devices.map(|device| device.known_faults());
    names.into_iter().flatten().copied()
}

/// Maximum number of letters by which a misspelt name differs. A name that differs more may be a
/// fault of a user's device.
const LETTERS: usize = 2;

/// The similar name in `known`, if `name` is not in it.
pub(super) fn misspelt<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    if known.contains(&name) {
        return None;
    }
    let near = known.iter().map(|&one| (distance(name, one), one)).min()?;
    (near.0 <= LETTERS).then_some(near.1)
}

/// The edit distance: letters to insert, remove or change.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (index, letter) in a.chars().enumerate() {
        let mut before = row[0];
        row[0] = index + 1;
        for (column, other) in b.iter().enumerate() {
            let changed = before + usize::from(letter != *other);
            before = row[column + 1];
            row[column + 1] = changed.min(before + 1).min(row[column] + 1);
        }
    }
    row[b.len()]
}
