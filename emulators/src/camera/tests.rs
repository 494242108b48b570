use core::f64::consts::PI;

use protocols::perception::Message;

use super::*;
use crate::world::{BodyConfig, Fixture, Point, Pose, Shape};

fn wall(x: f64, y: f64, half: f64, height_m: f64) -> Fixture {
    let shape = Shape::Wall {
        from: Point::new(x, y - half),
        to: Point::new(x, y + half),
    };
    Fixture {
        height_m,
        is_glass: false,
        ..shape.into()
    }
}

/// A robot at the origin that looks along x.
fn world(fixtures: Vec<Fixture>) -> World {
    let scene = Scene::new(fixtures, Vec::new()).expect("sound");
    World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free")
}

fn exact() -> CameraConfig {
    CameraConfig {
        noise_m: 0.0,
        gaps: 0.0,
        ..CameraConfig::default()
    }
}

/// All messages of `port` of the first `ms` milliseconds.
fn sent(camera: &mut Camera, world: &mut World, port: Port, ms: u64) -> Vec<Vec<u8>> {
    let mut messages = Vec::new();
    for ms in 0..=ms {
        let now = Instant::ZERO + Duration::from_millis(ms);
        world.advance(now);
        camera.poll(now, world);
        let mut buf = [0; 1472];
        loop {
            let len = camera.transmit(port, &mut buf);
            if len == 0 {
                break;
            }
            messages.push(buf[..len].to_vec());
        }
    }
    messages
}

fn depths(message: &[u8]) -> Vec<u16> {
    match Message::decode(message) {
        Ok(Message::DepthRow(row)) => row.depths_mm().collect(),
        Ok(Message::Scan(scan)) => scan.ranges_mm().collect(),
        other => panic!("{other:?}"),
    }
}

/// 30 rows a second of 640 columns; a wall 2 m ahead of the camera has the same depth in each. Half
/// of 640 columns over tan(31.3 degrees) = 0.6080 is a focal length of 526.3 pixels.
#[test]
fn a_wall_ahead_is_a_row_of_equal_depths() {
    let mut world = world(vec![wall(2.3, 0.0, 5.0, 2.0)]);
    let config = CameraConfig {
        x_m: 0.3,
        ..exact()
    };
    let mut camera = Camera::new(config, 1, "camera");
    let rows = sent(&mut camera, &mut world, Camera::SCAN, 1_000);
    assert_eq!(rows.len(), 30);
    let Ok(Message::DepthRow(row)) = Message::decode(&rows[0]) else {
        panic!("no row");
    };
    assert_eq!(row.focal_tenths, 5_263);
    assert!(row.depths_mm().eq([2_000; 640]));
}

/// A scan of 71 columns over 70 degrees has one a degree: 2 m ahead in the middle, 2 m / cos 35 =
/// 2.442 m at both ends.
#[test]
fn a_scan_has_ranges() {
    let mut world = world(vec![wall(2.0, 0.0, 5.0, 2.0)]);
    let config = CameraConfig {
        output: Output::Scan,
        columns: 71,
        field_rad: 70_f64.to_radians(),
        ..exact()
    };
    let mut camera = Camera::new(config, 1, "camera");
    let scans = sent(&mut camera, &mut world, Camera::SCAN, 40);
    let Ok(Message::Scan(scan)) = Message::decode(&scans[0]) else {
        panic!("no scan");
    };
    assert_eq!((scan.first_urad, scan.step_urad), (-610_865, 17_453));
    let ranges: Vec<u16> = scan.ranges_mm().collect();
    assert_eq!((ranges[35], ranges[0], ranges[70]), (2_000, 2_442, 2_442));
}

/// Report, page 15: a box of 30 cm is not in the scan, one of 40 cm is. Nearer than 0.45 m and
/// farther than 10 m the camera measures nothing.
#[test]
fn only_what_is_high_and_in_range_is_seen() {
    let first = |fixtures: Vec<Fixture>| {
        let mut camera = Camera::new(exact(), 1, "camera");
        let rows = sent(&mut camera, &mut world(fixtures), Camera::SCAN, 40);
        depths(&rows[0])[320]
    };
    let behind = wall(3.0, 0.0, 5.0, 2.0);
    assert_eq!(
        first(vec![wall(1.0, 0.0, 1.0, 0.30), behind.clone()]),
        3_000
    );
    assert_eq!(first(vec![wall(1.0, 0.0, 1.0, 0.40), behind]), 1_000);
    assert_eq!(first(vec![wall(0.44, 0.0, 1.0, 2.0)]), 0);
    assert_eq!(first(vec![wall(10.1, 0.0, 1.0, 2.0)]), 0);
    assert_eq!(first(vec![wall(9.9, 0.0, 1.0, 2.0)]), 9_900);
}

/// The noise of 1.43 mm at 1 m is 5.72 mm at 2 m and 22.9 mm at 4 m. The deviation of 640 values
/// must agree within 10 %.
#[test]
fn noise_grows_with_the_square_of_the_depth() {
    for (at_m, expected_mm) in [(2.0, 5.72), (4.0, 22.88)] {
        let mut world = world(vec![wall(at_m, 0.0, 9.0, 2.0)]);
        let mut camera = Camera::new(CameraConfig::default(), 7, "camera");
        let rows = sent(&mut camera, &mut world, Camera::SCAN, 40);
        let depths = depths(&rows[0]);
        let found = depths.iter().filter(|mm| **mm > 0);
        let off = found.map(|mm| f64::from(*mm) - at_m * 1e3);
        let squares: Vec<f64> = off.map(|off| off * off).collect();
        // Without a depth are 2 % of 640 columns: 13, with a deviation of 3.5.
        assert!((600..=640).contains(&squares.len()), "{}", squares.len());
        let deviation = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        assert!((deviation / expected_mm - 1.0).abs() < 0.1, "{deviation}");
    }
}

/// A marker 1.5 m ahead, 0.3 m to the left, 0.14 m below the camera, that looks back at it: its
/// normal has no part to the right and is -1 ahead.
#[test]
fn a_marker_is_told_in_the_cameras_axes() {
    let marker = PlacedMarker {
        id: 17,
        at_m: [1.5, 0.3, 0.20],
        facing_rad: PI,
    };
    let told = |marker: PlacedMarker, fixtures: Vec<Fixture>| {
        let config = CameraConfig {
            markers: vec![marker],
            ..exact()
        };
        let mut camera = Camera::new(config, 1, "camera");
        let mut messages = sent(&mut camera, &mut world(fixtures), Camera::MARKERS, 40);
        messages.pop()
    };
    let message = told(marker, Vec::new()).expect("it is in view");
    let Ok(Message::Marker(found)) = Message::decode(&message) else {
        panic!("no marker");
    };
    assert_eq!((found.id, found.normal), (17, [0, -10_000]));
    let [right, down, ahead] = found.place_mm;
    // The tolerance of 30 mm is four deviations of 7.5 mm.
    assert!((right + 300).abs() <= 30 && down == 140 && (ahead - 1_500).abs() <= 30);
    // Turned by 30 degrees, it looks back and to the camera's left.
    let askew = PlacedMarker {
        facing_rad: 150_f64.to_radians(),
        ..marker
    };
    let message = told(askew, Vec::new()).expect("it is in view");
    let Ok(Message::Marker(found)) = Message::decode(&message) else {
        panic!("no marker");
    };
    assert_eq!(found.normal, [-5_000, -8_660]);
    let aside = [1.5, 1.0, 0.20];
    let away = PlacedMarker {
        facing_rad: 0.0,
        ..marker
    };
    assert_eq!(told(away, Vec::new()), None);
    let outside = PlacedMarker {
        at_m: aside,
        ..marker
    };
    assert_eq!(told(outside, Vec::new()), None);
    // The box that it is glued to does not hide it, one before it does, a low one does not.
    assert!(told(marker, vec![wall(1.5, 0.3, 0.1, 0.4)]).is_some());
    assert_eq!(told(marker, vec![wall(1.0, 0.2, 0.2, 0.4)]), None);
    assert!(told(marker, vec![wall(1.0, 0.2, 0.2, 0.1)]).is_some());
}

/// The robot looks along y. A marker 1.5 m along y and 0.3 m against x is ahead to the left; a
/// marker ahead along x is not in view.
#[test]
fn a_marker_is_told_as_the_robot_stands() {
    let told = |at_m| {
        let marker = PlacedMarker {
            id: 3,
            at_m,
            facing_rad: -PI / 2.0,
        };
        let config = CameraConfig {
            markers: vec![marker],
            ..exact()
        };
        let scene = Scene::new(Vec::<Fixture>::new(), Vec::new()).expect("sound");
        let pose = Pose {
            theta: PI / 2.0,
            ..Pose::default()
        };
        let mut world = World::new(scene, BodyConfig::default(), pose, 1).expect("free");
        let mut camera = Camera::new(config, 1, "camera");
        sent(&mut camera, &mut world, Camera::MARKERS, 40).pop()
    };
    let message = told([-0.3, 1.5, 0.20]).expect("it is in view");
    let Ok(Message::Marker(found)) = Message::decode(&message) else {
        panic!("no marker");
    };
    let [right, down, ahead] = found.place_mm;
    assert!((right + 300).abs() <= 30 && down == 140 && (ahead - 1_500).abs() <= 30);
    assert_eq!(told([1.5, 0.3, 0.20]), None);
}

#[test]
fn faults_do_what_they_say() {
    let mut world = world(vec![wall(2.0, 0.0, 5.0, 2.0)]);
    let with = |fault: &str, figure| {
        let mut camera = Camera::new(exact(), 1, "camera");
        camera.set_fault(Instant::ZERO, fault, figure, true);
        camera
    };
    let mut rows = |camera: &mut Camera| sent(camera, &mut world, Camera::SCAN, 1_000);
    assert!(rows(&mut with("off", None)).is_empty());
    // One row comes at 33 ms, then one each 200 ms.
    assert_eq!(rows(&mut with("slow", None)).len(), 5);
    assert!(
        depths(&rows(&mut with("blind", None))[0])
            .iter()
            .all(|mm| *mm == 0)
    );
    let half = depths(&rows(&mut with("blind", Some(0.5)))[0]);
    // Half of 640 columns have no depth: 320, with a deviation of 12.6.
    assert!((257..383).contains(&half.iter().filter(|mm| **mm == 0).count()));
    let garbage = rows(&mut with("garbage", None));
    assert!(garbage.iter().all(|bytes| bytes.len() == 1_285));
    let decoded = garbage
        .iter()
        .filter(|bytes| Message::decode(bytes).is_ok());
    assert_eq!(decoded.count(), 0);
    let mut camera = Camera::new(CameraConfig::default(), 1, "camera");
    let before = rows(&mut camera);
    camera.set_fault(Instant::ZERO, "stuck", None, true);
    let mut after = Vec::new();
    camera.take_picture(Instant::ZERO, &world);
    after.extend(camera.out[0].pop_front());
    assert_eq!(after.last(), before.last());
}

/// Half of 640 columns, then nothing: of the fifteen pictures of half a second the last would come
/// just as it ends. With another pack there is one each 33 ms again.
#[test]
fn a_battery_that_collapses_takes_depths_first_and_then_all() {
    let mut world = world(vec![wall(2.0, 0.0, 5.0, 2.0)]);
    let mut camera = Camera::new(exact(), 1, "camera");
    camera.set_fault(Instant::ZERO, "battery", Some(0.5), true);
    let rows = sent(&mut camera, &mut world, Camera::SCAN, 1_000);
    assert_eq!(rows.len(), 14);
    let gaps = depths(&rows[0]).iter().filter(|mm| **mm == 0).count();
    assert!((257..383).contains(&gaps), "{gaps}");
    let told: Vec<_> = camera.take_events().iter().map(|it| it.rule).collect();
    assert_eq!(told, ["undervoltage"]);
    camera.set_fault(Instant::from_secs(1), "battery", None, false);
    assert_eq!(
        camera.poll_at(),
        Some(Instant::from_secs(1) + Duration::from_nanos(33_333_333))
    );
}

/// From (1, 2) an object on the line to a marker at (2.5, 2.3) hides it. An object on the line from
/// the origin does not.
#[test]
fn a_marker_is_hidden_by_what_stands_before_it_as_the_robot_stands() {
    let told = |fixtures: Vec<Fixture>| {
        let config = CameraConfig {
            markers: vec![PlacedMarker {
                id: 3,
                at_m: [2.5, 2.3, 0.20],
                facing_rad: PI,
            }],
            ..exact()
        };
        let scene = Scene::new(fixtures, Vec::new()).expect("sound");
        let pose = Pose::new(1.0, 2.0, 0.0);
        let mut world = World::new(scene, BodyConfig::default(), pose, 1).expect("free");
        let mut camera = Camera::new(config, 1, "camera");
        sent(&mut camera, &mut world, Camera::MARKERS, 40).pop()
    };
    assert!(told(Vec::new()).is_some());
    assert_eq!(told(vec![wall(2.0, 2.2, 0.1, 0.4)]), None);
    assert!(told(vec![wall(2.0, 2.45, 0.1, 0.4)]).is_some());
    assert!(told(vec![wall(2.0, 1.95, 0.1, 0.4)]).is_some());
}

/// A camera that is blind in all columns recognises no marker; one that sees a hundredth of them
/// does.
#[test]
fn a_blind_camera_recognises_no_marker() {
    let told = |share| {
        let config = CameraConfig {
            markers: vec![PlacedMarker {
                id: 3,
                at_m: [2.5, 2.3, 0.20],
                facing_rad: PI,
            }],
            ..exact()
        };
        let scene = Scene::new(Vec::<Fixture>::new(), Vec::new()).expect("sound");
        let pose = Pose::new(1.0, 2.0, 0.0);
        let mut world = World::new(scene, BodyConfig::default(), pose, 1).expect("free");
        let mut camera = Camera::new(config, 1, "camera");
        camera.set_fault(Instant::ZERO, "blind", share, true);
        sent(&mut camera, &mut world, Camera::MARKERS, 40)
            .pop()
            .is_some()
    };
    assert_eq!(
        [Some(0.99), Some(1.0), None].map(told),
        [true, false, false]
    );
}

/// A wall 0.4 m before the marker hides it from any place.
#[test]
fn a_marker_is_hidden_wherever_the_robot_stands() {
    let told = |x: f64, y: f64, fixtures: Vec<Fixture>| {
        let config = CameraConfig {
            markers: vec![PlacedMarker {
                id: 3,
                at_m: [x + 1.5, y + 0.3, 0.20],
                facing_rad: PI,
            }],
            ..exact()
        };
        let scene = Scene::new(fixtures, Vec::new()).expect("sound");
        let mut world =
            World::new(scene, BodyConfig::default(), Pose::new(x, y, 0.0), 1).expect("free");
        let mut camera = Camera::new(config, 1, "camera");
        sent(&mut camera, &mut world, Camera::MARKERS, 40)
            .pop()
            .is_some()
    };
    for (x, y) in [(0.0, 0.0), (3.0, 2.0), (-2.0, 5.0), (4.0, -3.0)] {
        assert!(told(x, y, Vec::new()), "{x} {y}");
        assert!(
            !told(x, y, vec![wall(x + 1.1, y + 0.22, 0.1, 0.4)]),
            "{x} {y}"
        );
        assert!(
            told(x, y, vec![wall(x + 1.1, y + 0.5, 0.1, 0.4)]),
            "{x} {y}"
        );
        assert!(
            told(x, y, vec![wall(x + 1.1, y - 0.05, 0.1, 0.4)]),
            "{x} {y}"
        );
    }
}

/// A camera that looks to the left sees the wall there, at 2 m, and not the one ahead, at 1 m.
#[test]
fn a_camera_looks_where_it_is_turned() {
    let left = Shape::Wall {
        from: Point::new(-5.0, 2.0),
        to: Point::new(5.0, 2.0),
    };
    let left = Fixture {
        height_m: 2.0,
        is_glass: false,
        ..left.into()
    };
    let mut world = world(vec![left, wall(1.0, 0.0, 0.5, 2.0)]);
    let config = CameraConfig {
        yaw_rad: PI / 2.0,
        ..exact()
    };
    let mut camera = Camera::new(config, 1, "camera");
    let rows = sent(&mut camera, &mut world, Camera::SCAN, 40);
    assert_eq!(depths(&rows[0]), [2_000; 640]);
}
