//! The faults of each device, by their names in scenarios.

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
    let silent = "off restart stuck wrong battery-low wheel-held";
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
    // These devices have no faults.
    assert_eq!(of(&TouchPanel::new(Vec::new())), "");
    assert_eq!(
        of(&Pc::new(Script::mission(Vec::new()).expect("short"))),
        ""
    );
}

/// Usual figures of the lidar's faults: shares of starts as reported, degrees, seconds, one byte in
/// so many, and a mode after the five of firmware 1.29.
#[test]
fn faults_of_the_rplidar_have_their_usual_figures() {
    let usual = rplidar::Fault::ALL.map(|fault| (fault.name(), fault.usual_figure()));
    let with: Vec<_> = usual
        .iter()
        .filter(|(_, figure)| figure.is_some())
        .collect();
    let expected = [
        ("dust", 400.0),
        ("uneven", 100.0),
        ("wrong", 1.1),
        ("protection-stop", 120.0),
        ("byte-loss", 20_000.0),
        ("burst", 64.0),
        ("unclean-stop", 8.0),
        ("torn-start", 0.8),
        ("deaf-start", 0.3),
        ("conf-empty", 0.0),
        ("typical-mode", 5.0),
        ("late-answers", 2.0),
        ("weak-supply", 400.0),
        ("slow-stop", 0.5),
        ("turned", 90.0),
    ];
    assert_eq!(with.len(), expected.len(), "{with:?}");
    for (name, figure) in expected {
        assert!(with.contains(&&(name, Some(figure))), "{name}: {with:?}");
    }
}
