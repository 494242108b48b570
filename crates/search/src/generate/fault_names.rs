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
