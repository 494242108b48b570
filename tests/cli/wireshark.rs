//! The dissector, judged by tshark: fields of known frames against values computed by hand.

use std::fs;
use std::path::Path;
use std::process::Command;

use hilrig::capture::{Interface, Kind, Record, Section};
use hilrig::rig::line::Direction;
use protocols::{Instant, LineEvent};

use super::captures::skipped;
use super::{Session, shipped, text};

/// Chunks of one link and direction, 1 ms apart, as a capture.
struct Chunks(Vec<u8>, u64);

impl Chunks {
    fn of(links: &[&str]) -> Self {
        let mut out = Vec::new();
        Section::default().write(&mut out);
        for name in links {
            Interface::new(name, 1_000_000).write(&mut out);
        }
        Self(out, 0)
    }

    fn add(&mut self, link: u32, direction: Direction, bytes: &[u8]) {
        self.record(link, direction, Kind::Data, bytes, "");
    }

    fn event(&mut self, link: u32, direction: Direction, event: LineEvent, comment: &str) {
        self.record(link, direction, Kind::Line(event), &[], comment);
    }

    fn record(&mut self, link: u32, direction: Direction, kind: Kind, bytes: &[u8], comment: &str) {
        self.1 += 1;
        let record = Record {
            link: 0,
            sequence: None,
            at: Instant::from_millis(self.1),
            direction,
            kind,
            bytes: bytes.to_vec().into(),
            sent: None,
            pieces: Vec::new(),
            comment: comment.to_owned(),
        };
        record.write(link, &mut self.0);
    }
}

/// The output of tshark for `fields`, a line per packet. `None`, with a visible message, without
/// tshark.
fn dissect(session: &Session, chunks: &Chunks, fields: &[&str]) -> Option<Vec<String>> {
    let printed = session.hilrig(&["wireshark", "--print"]);
    fs::write(session.folder.join("hilrig.lua"), printed.stdout).expect("writable");
    fs::write(session.folder.join("c.pcapng"), &chunks.0).expect("writable");
    let mut tshark = Command::new("tshark");
    tshark.current_dir(&session.folder);
    tshark.args(["-n", "-X", "lua_script:hilrig.lua", "-r", "c.pcapng"]);
    tshark.args(["-T", "fields", "-E", "separator=|"]);
    tshark.args(fields.iter().flat_map(|field| ["-e", *field]));
    match tshark.output() {
        Ok(output) => {
            let errors = text(&output.stderr);
            let is_sound = output.status.success() && !errors.contains("Lua");
            assert!(is_sound, "{errors}");
            Some(text(&output.stdout).lines().map(str::to_owned).collect())
        }
        Err(error) if std::env::var_os("CI").is_none() => {
            skipped(&format!("no tshark: {error}"));
            None
        }
        Err(error) => panic!("tshark: {error}"),
    }
}

const UP: Direction = Direction::ToMaster;
const DOWN: Direction = Direction::ToDevice;

/// Packets of the capture "hand in box", fw 2.4. The first one is split over two records, with a
/// record of the other direction in between. One has a weak reading of 271 mm and strength 80, one
/// has three readings without a dot (0x35).
#[test]
fn packets_of_a_lidar_show_angles_distances_and_codes() {
    let plain = b"\xFA\xA0\x4E\x4A\x27\x01\x05\x04\x27\x01\xD7\x03\x26\x01\x29\x04\x26\x01\xF0\x03\
        \x3C\x5C";
    let weak = b"\xFA\xB0\x53\x4A\x0F\x41\x50\x00\x0A\x01\x64\x01\x07\x01\xD2\x01\x07\x01\xAC\x01\
        \xD4\x30";
    let none = b"\xFA\xAF\x53\x4A\xBA\x01\x92\x01\x35\x80\x00\x00\x35\x80\x00\x00\x35\x80\x00\x00\
        \xB3\x14";
    let session = Session::new("wireshark-lidar");
    let mut chunks = Chunks::of(&["lidar"]);
    chunks.add(0, UP, &plain[..9]);
    chunks.add(0, DOWN, b"\x1B");
    chunks.add(0, UP, &[&plain[9..], &weak[..]].concat());
    chunks.add(0, UP, none);
    let fields = [
        "hilrig.protocol",
        "hilrig.xv11.index",
        "hilrig.xv11.angle",
        "hilrig.xv11.distance",
        "hilrig.xv11.strength",
        "hilrig.xv11.code",
    ];
    let Some(lines) = dissect(&session, &chunks, &fields) else {
        return;
    };
    let both = "xv11,xv11|0,16|0,1,2,3,64,65,66,67|295,295,294,294,271,266,263,263|\
                1029,983,1065,1008,80,356,466,428|";
    let last = "xv11|15|60,61,62,63|442|402,0,0,0|0x35,0x35,0x35";
    assert_eq!(lines, ["|||||", "|||||", both, last]);

    let speed = ["hilrig.xv11.rpm", "hilrig.xv11.weak"];
    let lines = dissect(&session, &chunks, &speed).expect("it was there");
    // The speeds 0x4A4E and 0x4A53 are 19022 and 19027 in 64ths of a rpm.
    let [rpm, weak] = lines[2].split('|').collect::<Vec<_>>()[..] else {
        panic!("{lines:?}")
    };
    let rpm: Vec<f64> = rpm
        .split(',')
        .map(|rpm| rpm.parse().expect("a number"))
        .collect();
    assert!((rpm[0] - 297.21875).abs() < 1e-3 && (rpm[1] - 297.296875).abs() < 1e-3);
    let weak: Vec<bool> = weak.split(',').map(|w| matches!(w, "1" | "True")).collect();
    assert_eq!(
        weak,
        [false, false, false, false, true, false, false, false]
    );
}

/// A whole turn of fw 2.1 in records of 64 bytes: the period word of the SparkFun trace, and no dot
/// except at 7 degrees, with 1000 mm (0x03E8) and strength 133.
#[test]
fn a_turn_of_the_old_firmware_is_put_together() {
    let mut turn = b"\x5A\xA5\x00\xC0\x94\xD1".to_vec();
    turn.extend(b"\x35\x80\x00\x00".repeat(360));
    turn[6 + 28..6 + 32].copy_from_slice(&[0xE8, 0x03, 133, 0]);
    let session = Session::new("wireshark-turn");
    let mut chunks = Chunks::of(&["lidar"]);
    for chunk in turn.chunks(64) {
        chunks.add(0, UP, chunk);
    }
    let fields = [
        "hilrig.protocol",
        "hilrig.xv11.period",
        "hilrig.xv11.distance",
    ];
    let Some(lines) = dissect(&session, &chunks, &fields) else {
        return;
    };
    assert_eq!(
        lines.last().map(String::as_str),
        Some("xv11-turn|0xd194|1000")
    );
    assert!(lines[..lines.len() - 1].iter().all(|line| line == "||"));
}

/// Vectors of the fielded bus (high byte first) and the seed report's order on a second link. The
/// reply's values are by hand: 0x0102 ticks left, -1 right, speeds 5 and -5.
#[test]
fn frames_of_the_bus_show_register_names_and_values_in_both_orders() {
    let reply = b"\xAB\x24\x8A\x02\x01\x00\x00\xFF\xFF\xFF\xFF\x05\xFB\x06\x58";
    let session = Session::new("wireshark-bus");
    let mut chunks = Chunks::of(&["base", "other"]);
    chunks.add(0, DOWN, b"\xAB\x24\x0A\x00\xD9");
    chunks.add(0, UP, &reply[..7]);
    chunks.add(0, UP, &reply[7..]);
    chunks.add(0, DOWN, b"\xAB\x2E\x83\x14\xEC\x00\x02\x5C");
    chunks.add(0, UP, b"\xAB\xFF\x00\x01\xAA");
    chunks.add(1, DOWN, b"\xAB\x24\x0A\xD9\x00");
    let fields = [
        "hilrig.bus.order",
        "hilrig.bus.register",
        "hilrig.bus.count",
        "hilrig.bus.name",
        "hilrig.bus.value",
    ];
    let Some(lines) = dissect(&session, &chunks, &fields) else {
        return;
    };
    let names = "encoder_left,encoder_right,speed_left_is,speed_right_is";
    let high = "high byte first";
    let expected = [
        format!("{high}|36|10|{names}|"),
        "||||".to_owned(),
        format!("{high}|36|10|{names}|258,-1,5,-5"),
        format!("{high}|46|3|speed_left_to,speed_right_to,motor_standby|20,-20,0"),
        format!("{high}|255|0||"),
        format!("low byte first|36|10|{names}|"),
    ];
    assert_eq!(lines, expected);
}

/// The fielded robot's start pose, its row of unknown cells (255 + 44 pixels), an order to explore
/// that comes in pieces of three bytes, and two waypoints by hand.
#[test]
fn messages_of_the_pc_link_show_their_content() {
    let map = b"PCUI_MSG\x0D\x00\x53\x03\x00\x00MPD\
        \x14\x70\x17\x70\x17\x01\xE8\x03\xE8\x03\x00\x5A\x00";
    let row = b"PCUI_MSG\x07\x00\x29\x02\x00\x00MAR\x00\x00\x00\xFF\x7F\x2C\x7F";
    let order = b"PCUI_MSG\x03\x00\x04\x00\x00\x00STA\x01\x01\x02";
    // The first waypoint is at (100, 200) mm, with -1 as the number before it; the second is at
    // (-1, -2) mm. The sum is 2, and 100 + 200 + 1 + 2 * 255 for the first, 3 * 255 + 254 + 2 + 1
    // for the second: 1835 is 0x72B.
    let list = b"PCUI_MSG\x14\x00\x2B\x07\x00\x00LWP\x02\x00\
        \x64\x00\xC8\x00\x00\x01\x00\xFF\xFF\xFF\xFF\xFE\xFF\x00\x02\x00\x01\x00";
    let session = Session::new("wireshark-pc");
    let mut chunks = Chunks::of(&["radio"]);
    chunks.add(0, UP, map);
    chunks.add(0, UP, row);
    for chunk in order.chunks(3) {
        chunks.add(0, DOWN, chunk);
    }
    chunks.add(0, DOWN, list);
    let fields = [
        "hilrig.pcui.id",
        "hilrig.pcui.length",
        "hilrig.pcui.row",
        "hilrig.pcui.pixels",
        "hilrig.pcui.mode",
        "hilrig.pcui.waypoint",
        "hilrig.pcui.x",
        "hilrig.pcui.y",
        "hilrig.pcui.psi",
    ];
    let Some(lines) = dissect(&session, &chunks, &fields) else {
        return;
    };
    let told: Vec<&str> = lines
        .iter()
        .map(String::as_str)
        .filter(|l| *l != "||||||||")
        .collect();
    let expected = [
        "MPD|13|||||1000|1000|90",
        "MAR|7|0|299|||||",
        "STA|3|||1||||",
        "LWP|20||||1,2|100,-1|200,-2|",
    ];
    assert_eq!(told, expected);
}

/// Checksums by an independent CRC-16/XMODEM.
#[test]
fn frames_of_a_panel_show_window_pixels_and_pen() {
    let pen = b"\x7E\x54\x00\x05\x01\x01\x23\x0A\xBC\x0D\xE7";
    let runs = b"\x7E\xE0\x00\x0E\x00\x00\x00\x02\x00\x03\x00\x02\x03\xF8\x00\x01\x07\xE0\x08\x26";
    let bad = b"\x7E\x29\x00\x00\x18\x58";
    let session = Session::new("wireshark-panel");
    let mut chunks = Chunks::of(&["display"]);
    chunks.add(0, UP, pen);
    chunks.add(0, DOWN, b"\x7E\x29\x00\x00\x18\x57");
    chunks.add(0, DOWN, runs);
    chunks.add(0, DOWN, bad);
    chunks.add(0, DOWN, runs);
    let fields = [
        "hilrig.panel.op",
        "hilrig.panel.window",
        "hilrig.panel.pixels",
        "hilrig.panel.pen_x",
        "hilrig.panel.pen_y",
        "hilrig.bad",
    ];
    let Some(lines) = dissect(&session, &chunks, &fields) else {
        return;
    };
    let drawn = "0xe0|0,2 to 3,2|4|||";
    let expected = ["0x54|||291|2748|", "0x29|||||", drawn, "|||||6", drawn];
    assert_eq!(lines, expected);
}

/// Requests in one direction. In the other one, the first nodes of a scan of a real A1M8 (199.1 and
/// 201.2 degrees; the third one by hand, 1000 mm at 90 degrees) in two records, and the health,
/// which ends the scan.
#[test]
fn a_scan_of_an_rplidar_shows_angles_distances_and_requests() {
    let session = Session::new("wireshark-rplidar");
    let mut chunks = Chunks::of(&["lidar"]);
    chunks.add(0, DOWN, b"\xA5\x50\xA5\xF0\x02\x94\x02\xC1");
    chunks.add(0, UP, b"\xA5\x5A\x05\x00\x00\x40\x81\x02\x8F\x63\x00");
    chunks.add(
        0,
        UP,
        b"\x00\x3E\x9B\x64\x00\x00\xBD\x01\x2D\xA0\x0F\xA5\x5A\x03\x00\x00\x00\x06\x00\x00\x00",
    );
    let fields = [
        "hilrig.protocol",
        "hilrig.rplidar.command",
        "hilrig.rplidar.kind",
        "hilrig.rplidar.distance",
        "hilrig.rplidar.quality",
        "hilrig.bad",
    ];
    let Some(lines) = dissect(&session, &chunks, &fields) else {
        return;
    };
    let expected = [
        "rplidar,rplidar|0x50,0xf0||||",
        "rplidar||0x81|||",
        "rplidar,rplidar,rplidar,rplidar||0x06|0,0,1000|0,15,47|",
    ];
    assert_eq!(lines, expected);
    let lines = dissect(&session, &chunks, &["hilrig.rplidar.angle"]).expect("it was there");
    let angles = lines[2].split(',').map(|angle| angle.parse::<f64>());
    let angles: Vec<f64> = angles.map(|angle| angle.expect("a number")).collect();
    // The angles are 12743, 12877 and 5760 in 64ths of a degree.
    let expected = [199.109_375, 201.203_125, 90.0];
    assert_eq!(angles.len(), 3);
    assert!(
        angles
            .iter()
            .zip(expected)
            .all(|(found, angle)| (found - angle).abs() < 1e-3)
    );
}

/// By hand: FF - (7E + 01) = 80; 7E is sent as 7D 5E. Then a frame whose checksum is wrong.
#[test]
fn frames_of_telemetry_show_their_payload_without_escapes() {
    let session = Session::new("wireshark-telemetry");
    let mut chunks = Chunks::of(&["radio"]);
    chunks.add(0, UP, b"\x7E\x00\x02\x7D\x5E\x01\x80");
    chunks.add(0, UP, b"\x7E\x00\x02\x03\x01\x80\x7E\x00\x00\xFF");
    let fields = [
        "hilrig.telemetry.length",
        "hilrig.telemetry.payload",
        "hilrig.bad",
    ];
    let Some(lines) = dissect(&session, &chunks, &fields) else {
        return;
    };
    assert_eq!(lines, ["2|7E 01|", "0||6"]);
}

/// By hand: counters 0xFFFF and 0x8081, full ADC of channel 5, 11.5 V, button; duties of 100 and
/// 50 %, channel 2, drivers on. Between them half a frame.
#[test]
fn samples_and_outputs_of_a_motor_board_show_their_values() {
    let session = Session::new("wireshark-peripherals");
    let mut chunks = Chunks::of(&["board"]);
    chunks.add(
        0,
        UP,
        b"\x80\x7F\x7F\x03\x01\x01\x02\x7F\x1F\x7E\x08\x0D\x80\x01",
    );
    chunks.add(0, DOWN, b"\x81\x10\x4E\x08\x27\x0A");
    let fields = [
        "hilrig.peripherals.counter",
        "hilrig.peripherals.adc",
        "hilrig.peripherals.channel",
        "hilrig.peripherals.supply",
        "hilrig.peripherals.duty",
    ];
    let Some(lines) = dissect(&session, &chunks, &fields) else {
        return;
    };
    assert_eq!(lines, ["65535,32897|4095|5|11.5|", "||2||100,50"]);
}

/// A frame that was read from the board, in two pieces and with a stray zero before it; the largest
/// commands and a single steering byte; 13 cm as changed by a terminal, 10.
#[test]
fn both_ways_of_a_cars_board_show_their_values() {
    let frame = b"\x00\x0F\x0D\x00\xC8\x00\x96\x00\x00\x0D\x01\x20\x1C";
    let session = Session::new("wireshark-car-board");
    let mut chunks = Chunks::of(&["car"]);
    chunks.add(0, UP, &[b"\x00", &frame[..5]].concat());
    chunks.add(0, DOWN, b"\x94\x64\x8A\x32");
    chunks.add(0, UP, &frame[5..]);
    let fields = [
        "hilrig.protocol",
        "hilrig.car_board.range",
        "hilrig.car_board.hall",
        "hilrig.car_board.battery",
        "hilrig.car_board.level",
        "hilrig.car_board.steering",
        "hilrig.bad",
    ];
    let Some(lines) = dissect(&session, &chunks, &fields) else {
        return;
    };
    let expected = [
        "||||||",
        "car-command,car-command||||10,0|50,0|",
        "bad,car-board|13,200,150|269|7200|||1",
    ];
    assert_eq!(lines, expected);
}

/// Lines of the report, of the sketch, of its successor and with a CRC (D147, from an independent
/// CRC-16); one line whose sum is wrong by a tenth.
#[test]
fn lines_of_an_odometer_show_their_figures_in_every_dialect() {
    let session = Session::new("wireshark-odometer");
    let mut chunks = Chunks::of(&["odometer"]);
    chunks.add(
        0,
        UP,
        b"1.25*0.50*85.94*12.35*100.04*\r\n1.25*0.50*1.50*12345*12347.76*\r\n",
    );
    chunks.add(0, UP, b"1250*500*1500*12345*D147*\r\n");
    chunks.add(
        0,
        UP,
        b"#1.25*0.01*0.02*0.50*0.10*0.20*9.81*12.00*-3.00*40.00*\r\n",
    );
    chunks.add(
        0,
        UP,
        b"1.25*0.50*1.50*12345*12347.86*\r\n1250*500*1500*12345*D147*\r\n",
    );
    let fields = [
        "hilrig.odometer.dialect",
        "hilrig.odometer.distance",
        "hilrig.odometer.time",
    ];
    let Some(lines) = dissect(&session, &chunks, &fields) else {
        return;
    };
    let expected = [
        "seed,as-coded|1.25,1.25|12.35,12.345",
        "fixed|1.25|12.345",
        "raw|1.25|",
        "fixed|1.25|12.345",
    ];
    assert_eq!(lines, expected);
}

/// By hand: depths of 1000 mm and none, a marker 1500 mm ahead and 1 mm to the left; the phone's
/// emergency stop and a goal.
#[test]
fn a_camera_and_a_phone_show_their_messages() {
    let session = Session::new("wireshark-camera");
    let mut chunks = Chunks::of(&["scan", "remote"]);
    chunks.add(0, UP, b"\x44\x02\x00\x82\x14\xE8\x03\x00\x00");
    chunks.add(
        0,
        UP,
        b"\x4D\x11\x00\xFF\xFF\xFF\xFF\x02\0\0\0\xDC\x05\0\0\0\0\xF0\xD8",
    );
    chunks.add(1, UP, b"/1/kill\0,f\0\0\x3F\x80\0\0");
    chunks.add(1, UP, b"/goal\0\0\0,ff\0\x40\x20\0\0\xBF\x00\0\0");
    let fields = [
        "hilrig.perception.nearest",
        "hilrig.perception.id",
        "hilrig.perception.ahead",
        "hilrig.perception.right",
        "hilrig.osc.address",
        "hilrig.osc.float",
    ];
    let Some(lines) = dissect(&session, &chunks, &fields) else {
        return;
    };
    let expected = [
        "1000|||||",
        "|17|1500|-1||",
        "||||/1/kill|1",
        "||||/goal|2.5,-0.5",
    ];
    assert_eq!(lines, expected);
}

/// The rates of the seed report's links, as Wireshark's own tool shows them for a run's capture.
#[test]
fn a_runs_capture_tells_the_rate_of_each_link() {
    let session = Session::new("wireshark-rates");
    let short = shipped("empty-room").replace("duration = ", "duration = \"1s\" # ");
    session.write("short.toml", &short);
    session.hilrig(&["run", "short.toml", "--out", "out"]);
    let mut capinfos = Command::new("capinfos");
    let output = match capinfos
        .arg("out/capture.pcapng")
        .current_dir(&session.folder)
        .output()
    {
        Ok(output) => output,
        Err(error) if std::env::var_os("CI").is_none() => {
            return skipped(&format!("no capinfos: {error}"));
        }
        Err(error) => panic!("capinfos: {error}"),
    };
    let said = text(&output.stdout);
    let value = |key: &str| -> Vec<&str> {
        let lines = said
            .lines()
            .filter_map(|line| line.trim().strip_prefix(key));
        lines.collect()
    };
    let links: Vec<_> = value("Name = ")
        .into_iter()
        .zip(value("Speed = "))
        .collect();
    for link in [
        ("lidar", "115200"),
        ("base", "1000000"),
        ("radio", "460800"),
    ] {
        assert!(links.contains(&link), "{link:?} in {links:?}");
    }
    assert!(said.contains("Time precision = nanoseconds"), "{said}");
}

/// Numbers of the link type's events: 0 status, 7 framing, 9 break, 10 overflow.
#[test]
fn events_of_a_line_are_told_with_their_kind_and_comment() {
    let session = Session::new("wireshark-events");
    let mut chunks = Chunks::of(&["lidar"]);
    for (event, comment) in [
        (LineEvent::Opened, "port opened"),
        (LineEvent::Break, "break"),
        (LineEvent::FramingError, "2 characters without a stop bit"),
        (LineEvent::Overrun, "overrun"),
        (LineEvent::Closed, "port closed"),
    ] {
        chunks.event(0, UP, event, comment);
    }
    let fields = ["rtacser.eventtype", "rtacser.dtr", "frame.comment"];
    let Some(lines) = dissect(&session, &chunks, &fields) else {
        return;
    };
    let expected = [
        "0x00|1|port opened",
        "0x09|1|break",
        "0x07|1|2 characters without a stop bit",
        "0x0a|1|overrun",
        "0x00|0|port closed",
    ];
    assert_eq!(lines, expected);
}

#[test]
fn commands_of_the_radio_are_shown_as_text() {
    let session = Session::new("wireshark-text");
    let mut chunks = Chunks::of(&["radio"]);
    chunks.add(0, DOWN, b"AT+VERSION");
    chunks.add(0, UP, b"OKlinvorV1.8");
    chunks.add(0, UP, b"PCUI_MSG\x03\x00\x04\x00\x00\x00STA\x01\x01\x02");
    let fields = ["hilrig.text", "hilrig.pcui.id"];
    let Some(lines) = dissect(&session, &chunks, &fields) else {
        return;
    };
    assert_eq!(lines, ["AT+VERSION|", "OKlinvorV1.8|", "|STA"]);
}

/// The path is printed on standard output, so that a script can use it.
#[test]
fn the_file_is_installed_where_it_is_said_to_belong() {
    let session = Session::new("wireshark-install");
    let said = session.hilrig(&["wireshark", "--dir", "plugins"]);
    assert_eq!(text(&said.stdout), "plugins/hilrig.lua\n");
    assert!(!session.folder.join("plugins").exists());
    let installed = session.hilrig(&["wireshark", "--dir", "plugins", "--install"]);
    assert_eq!(installed.status.code(), Some(0));
    let printed = session.hilrig(&["wireshark", "--print"]);
    assert_eq!(session.read("plugins/hilrig.lua"), text(&printed.stdout));

    session.write("file", "");
    let refused = session.hilrig(&["wireshark", "--install", "--dir", "file/below"]);
    assert_eq!(refused.status.code(), Some(2));
    let error = text(&refused.stderr);
    assert!(
        error.contains("--install") && error.contains("file/below"),
        "{error}"
    );
    assert!(!Path::new("file/below").exists());
}
