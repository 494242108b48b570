//! What can go wrong with each device, by the names that scenarios use.

use emulators::avr_base::{Announce, AvrBase, AvrBaseConfig};
use emulators::camera::{Camera, CameraConfig};
use emulators::car_board::{BoardConfig, CarBoard};
use emulators::hc06::{Hc06, Profile};
use emulators::odometer::{Odometer, OdometerConfig};
use emulators::pc::{Pc, Script};
use emulators::touch_panel::TouchPanel;
use emulators::wheel_board::WheelBoard;
use emulators::xv11::Xv11;
use emulators::{Device, rplidar, wheel_board, xv11};

fn base(announce: Announce) -> AvrBase {
    let config = AvrBaseConfig {
        announce,
        ..AvrBaseConfig::default()
    };
    AvrBase::new(config, 7)
}

#[test]
fn each_device_names_its_faults() {
    let of = |device: &dyn Device| device.known_faults().join(" ");
    let silent = "off restart stuck wrong battery-low";
    assert_eq!(of(&base(Announce::Nothing)), silent);
    assert_eq!(
        of(&base(Announce::StopButton)),
        format!("{silent} stop-button")
    );
    let car = "off restart stuck slow battery-low motor servo hall line front right left";
    assert_eq!(of(&CarBoard::new(BoardConfig::default())), car);
    let camera = Camera::new(CameraConfig::default(), 7, "camera");
    assert_eq!(of(&camera), "off slow garbage stuck blind battery");
    assert_eq!(
        of(&Hc06::new(Profile::default(), 7)),
        "off restart out-of-reach"
    );
    let odometer = "off restart stuck slow wrong worn iron imu-off imu-stuck imu-wrong";
    assert_eq!(of(&Odometer::new(OdometerConfig::default())), odometer);
    let wheels = WheelBoard::new("board", 7, wheel_board::Config::default());
    assert_eq!(of(&wheels), "off restart stuck wrong slow garbage blind");
    let lidar = "slow off dust stuck encoder-blind frozen-speed false-doubling dark dense-starts \
        garbage wrong restart";
    assert_eq!(of(&Xv11::new("lidar", 7, xv11::Config::default())), lidar);
    let rplidar = rplidar::Rplidar::new("lidar", 7, rplidar::Config::default());
    let names: Vec<&str> = rplidar::Fault::ALL
        .iter()
        .map(|fault| fault.name())
        .collect();
    assert_eq!(of(&rplidar), format!("slow {}", names.join(" ")));
    // Nothing of their own goes wrong with these.
    assert_eq!(of(&TouchPanel::new(Vec::new())), "");
    assert_eq!(
        of(&Pc::new(Script::mission(Vec::new()).expect("short"))),
        ""
    );
}

/// The usual figures of the lidar's faults that have one, as the list of faults has them.
#[test]
fn faults_of_the_rplidar_have_their_usual_figures() {
    use rplidar::Fault;
    let usual = |name: &str| Fault::from_name(name).expect("it is one").usual_figure();
    assert_eq!(
        ["dust", "uneven", "wrong"].map(usual),
        [400.0, 100.0, 1.1].map(Some)
    );
    assert_eq!(["off", "stuck", "garbage", "restart"].map(usual), [None; 4]);
}
