//! The figures that the seed report measured, each stated by a test. S9 (waypoint list) and S10
//! (memory) are proved in `firmware_core`; S4 also in `hilrig::rig::cpu`.

use core::time::Duration;

use emulators::pc::Pc;
use emulators::rng::Rng;
use firmware_core::Inspect;
use firmware_core::robots::rescue::Rescue;
use hilrig::rig::Rig;
use hilrig::rig::cpu::CpuModel;
use hilrig::rig::fault::{DamageKind, FaultId, Window};
use hilrig::rig::line::{Direction, End};
use hilrig::robots::instruments::in_metres;
use protocols::rle::Dialect;
use protocols::xv11::{self, Reading};
use protocols::{Decode, Instant, LineConfig, Port, pcui};

use super::{in_a_room, start};
use crate::Run;
use crate::thorough::few;

const SECOND: Duration = Duration::from_secs(1);

fn delivered(rig: &Rig, link: &str, direction: Direction) -> u64 {
    rig.link(link)
        .expect("a link of the robot")
        .line(direction)
        .traffic()
        .delivered
}

/// S1: 90 packets and 1980 bytes per revolution at 5 Hz; 9900 bytes a second are 86 % of the
/// 11520 that 115200 baud carry. One packet more or less may end inside the window.
#[test]
fn s1_the_lidar_sends_1980_bytes_a_turn_at_86_per_cent_of_its_line() {
    let mut run = start(in_a_room("60s", ""));
    run.rig.run_for(5 * SECOND);
    let before = delivered(&run.rig, "lidar", Direction::ToMaster);
    run.rig.run_for(10 * SECOND);
    let bytes = delivered(&run.rig, "lidar", Direction::ToMaster) - before;
    assert!(
        bytes.abs_diff(99_000) <= 2 * 22,
        "{bytes} bytes in ten seconds"
    );
    let load = bytes as f64 / 10.0 / 11_520.0;
    assert!((load - 0.86).abs() < 0.005, "load {load}");
}

/// Records the lidar's readings by their time.
#[derive(Default)]
struct Beams {
    decoder: xv11::Decoder,
    /// Time of the packet's end, degree, distance.
    readings: Vec<(Instant, usize, f64)>,
}

/// Readings of degree 0 while the robot passes a wall that recedes at 45 degrees.
fn ranges_of_beam_0(rig: &mut Rig, node: usize, turns: u32) -> Vec<f64> {
    let mut beams = Beams::default();
    for _ in 0..turns * 100 {
        rig.run_for(Duration::from_millis(2));
        let now = rig.now();
        let bytes = rig.take_output(node);
        for frame in beams.decoder.push(&bytes).flatten() {
            let degree = usize::from(frame.index()) * 4;
            if let Reading::Range { distance_mm, .. } = frame.readings()[0] {
                beams.readings.push((now, degree, f64::from(distance_mm)));
            }
        }
    }
    beams
        .readings
        .iter()
        .filter(|(_, degree, _)| *degree == 0)
        .map(|&(_, _, mm)| mm)
        .collect()
}

/// S2: at 0.3 m/s the robot moves 60 mm during one revolution, and the raw scan shows it. Beam 0
/// looks to the right at a wall at 45 degrees to the path. Each millimetre forwards makes it one
/// millimetre longer, so the seam between the end and the beginning of a turn is 60 mm high. The
/// world sets the speed, without the program.
#[test]
fn s2_the_raw_scan_is_smeared_by_60_mm_at_0_3_m_s() {
    use emulators::world::{BodyConfig, Drive, Point, Pose, Scene, Shape, Wheel, World};
    use emulators::xv11::{Config, Xv11};

    let wall = Shape::Wall {
        from: Point::new(0.1, -0.2),
        to: Point::new(2.3, 2.0),
    };
    let scene = Scene::new([wall], Vec::new()).expect("one wall");
    let body = BodyConfig {
        full_speed_m_s: 0.3,
        ..BodyConfig::default().ideal()
    };
    let start = Pose::new(0.0, 0.0, core::f64::consts::FRAC_PI_2);
    let mut rig = Rig::new(World::new(scene, body, start, 1).expect("room enough"));
    let lidar = rig.add_device("lidar", Xv11::new("lidar", 1, Config::default()));
    let node = rig.add_outside("program", LineConfig::new_8n1(xv11::BAUD));
    let (device, master) = (
        End {
            node: lidar,
            port: Xv11::UART,
        },
        End {
            node,
            port: Port(0),
        },
    );
    rig.connect("lidar", device, master, 22);
    rig.run_for(3 * SECOND);
    for wheel in [Wheel::Left, Wheel::Right] {
        rig.world.set_drive(wheel, Drive::Power(255));
    }
    rig.run_for(SECOND);
    rig.take_output(node);

    let ranges = ranges_of_beam_0(&mut rig, node, 5);
    assert!(ranges.len() >= 4, "{ranges:?}");
    for pair in ranges.windows(2) {
        let smear = pair[1] - pair[0];
        assert!(
            (smear - 60.0).abs() <= 3.0,
            "{smear} mm between turns: {ranges:?}"
        );
    }
}

/// S3: a push of 400 mm within a second at rest. The robot knows its pose again after six searches
/// (1.2 s) of about a thousand tries, with the document's algorithm and constants. "Again" means
/// within 50 mm, an eighth of the push. The search is random, so the median of five seeds counts.
#[test]
fn s3_a_push_of_400_mm_is_made_good_in_six_searches() {
    let mut errors: Vec<f64> = (1..=5)
        .map(|seed| error_after_push("document", seed, 6))
        .collect();
    errors.sort_by(f64::total_cmp);
    assert!(errors[2] < 50.0, "{errors:?}");
    assert!(errors[4] < 100.0, "{errors:?}");
}

/// The same push with the robot's default mapper. The robot knows its pose within two searches, and
/// more accurately, with every seed: 0.3 to 6.5 mm were measured.
#[test]
fn s3_the_default_mapper_is_there_after_two_searches() {
    let errors: Vec<f64> = few(5, 0..20)
        .into_iter()
        .map(|seed| error_after_push("best", seed, 2))
        .collect();
    assert!(errors.iter().all(|error| *error < 15.0), "{errors:?}");
}

/// Error in mm of the n-th pose that was found after the end of the push.
fn error_after_push(mapper: &str, seed: u64, searches: u32) -> f64 {
    use hilrig::scenario::{Span, world::PushSpec};

    let (mut scenario, source) = in_a_room("20s", &format!("[program]\nmapper = \"{mapper}\"\n"));
    scenario.world.push = vec![PushSpec {
        at: Span::from_millis(10_000),
        by_m: [0.0, 0.4],
        turn_deg: 0.0,
        over: Span::from_millis(1_000),
    }];
    let mut run = Run::new(scenario, &source, Some(seed)).expect("can be wired");
    let pushed = Instant::from_secs(11);
    let (mut found_poses, mut last) = (0, pushed);
    loop {
        run.step();
        assert!(
            run.rig.now() < Instant::from_secs(15),
            "too few searches in four seconds"
        );
        let found = run.rig.program().and_then(|program| program.estimate());
        let Some((at, estimate)) = found.filter(|(at, _)| *at > last) else {
            continue;
        };
        (found_poses, last) = (found_poses + 1, at);
        if found_poses == searches {
            let truth = run.rig.world.pose();
            assert!(
                (truth.y - 1.6).abs() < 0.01,
                "the push moves the robot: {truth:?}"
            );
            return in_metres(estimate).point().distance(truth.point()) * 1000.0;
        }
    }
}

/// S6: search time is regulated to 150 ms of each 200 ms scan. In the model of the processor a
/// scan of `n` tries takes 14 ms + 0.15 n ms; the regulator holds it within 10 ms of 150.
#[test]
fn s6_the_search_is_held_at_150_ms() {
    let mut run = start(in_a_room("60s", "[program]\nmapper = \"document\"\n"));
    run.rig.run_for(20 * SECOND);
    let mut longest = Duration::ZERO;
    let mut shortest = SECOND;
    for _ in 0..50 {
        run.rig.run_for(Duration::from_millis(200));
        let took = run.rig.last_cost().expect("the program is in this process");
        longest = longest.max(took);
        shortest = shortest.min(took);
    }
    let range = Duration::from_millis(140)..=Duration::from_millis(160);
    assert!(
        range.contains(&shortest) && range.contains(&longest),
        "{shortest:?}..{longest:?}"
    );
}

/// S4: search time is linear in the tries, and 360 points cost 8.47 times as much as 36.
#[test]
fn s4_search_time_is_linear_in_tries() {
    let cost = |tries: u32, points: u32| {
        let work = firmware_core::Work {
            scans: 0,
            tries,
            points: tries * points,
        };
        CpuModel::STM32F4.cost(work).as_secs_f64()
    };
    assert!((cost(1000, 36) - 0.150).abs() < 0.001);
    assert!((cost(2000, 36) / cost(1000, 36) - 2.0).abs() < 0.001);
    assert!((cost(1000, 360) / cost(1000, 36) - 8.47).abs() < 0.01);
}

/// S7: a raw map of 300 x 300 cells takes 1.953125 s at 460800 baud with ten bits a byte (the seed
/// report counts eight and gets 1.5625 s).
#[test]
fn s7_a_raw_map_takes_1_95_s_on_the_wire() {
    let (mut rig, from, to) = bare_line(LineConfig::new_8n1(460_800));
    rig.inject(from, &[127; 90_000]);
    let mut arrived = 0;
    let mut last = Instant::ZERO;
    while arrived < 90_000 {
        let next = rig.next_event().expect("bytes are on their way");
        rig.run_until(next);
        let bytes = rig.take_output(to).len();
        arrived += bytes;
        if bytes > 0 {
            last = rig.now();
        }
    }
    let error = last.as_nanos().abs_diff(1_953_125_000);
    // One nanosecond of rounding for each piece of 64 bytes.
    assert!(error < 2_000, "{last}");
}

/// S7: run-length rows shorten the map by a quarter and more, and all of it arrives.
#[test]
fn s7_run_length_rows_bring_the_map_across_sooner() {
    let mut run = start(in_a_room("60s", ""));
    let there =
        run.rig
            .run_until_condition(Duration::from_millis(10), Instant::from_secs(30), |rig| {
                let pc = rig.device::<Pc>("pc").expect("emulated");
                pc.map_complete_at().is_some()
            });
    assert!(there, "the map never arrived");
    let program = run.rig.program_as::<Rescue>().expect("the rescue robot");
    let map = program.map().expect("it has one");
    let bytes: usize = map
        .rows()
        .map(|row| {
            let mut frame = [0; pcui::FRAME_MAX];
            pcui::message::encode_row(0, 0, row, Dialect::Lossless, &mut frame).expect("fits")
        })
        .sum();
    let raw = 300 * (300 + 3 + pcui::HEADER_LEN);
    assert!(bytes * 4 < raw * 3, "{bytes} of {raw} bytes");
}

/// Two outside ends and a line between them.
fn bare_line(line: LineConfig) -> (Rig, usize, usize) {
    use emulators::world::{BodyConfig, Fixture, Pose, Scene, World};
    let scene = Scene::new(Vec::<Fixture>::new(), Vec::new()).expect("empty is fine");
    let start = Pose::new(0.0, 0.0, 0.0);
    let world = World::new(scene, BodyConfig::default(), start, 1).expect("nothing is near");
    let mut rig = Rig::new(world);
    let [from, to] = ["from", "to"].map(|name| rig.add_outside(name, line));
    let [device, master] = [from, to].map(|node| End {
        node,
        port: Port(0),
    });
    rig.connect("wire", device, master, 64);
    (rig, from, to)
}

/// S8: with bits flipped, bytes lost, doubled and inserted on the register bus, in both directions,
/// the base never acts on a wrong set-point. It takes only set-points that the program sent, and
/// lost writes are repeated. The checksum is a plain sum, so a damaged frame sometimes passes by
/// chance (two flips: 5.9 %, measured); at this rate of single flips none does.
#[test]
fn s8_no_set_point_is_ever_wrong_on_a_bad_line() {
    let more = "[mission]\nwaypoints_m = [[1.5, 2.2], [0.9, 1.5], [1.5, 1.0]]\n";
    let mut run = start(in_a_room("60s", more));
    let link = run.rig.link_mut("base").expect("the register bus");
    for (index, line) in link.lines.iter_mut().enumerate() {
        for kind in [DamageKind::Flip, DamageKind::Drop, DamageKind::Duplicate] {
            let rng = Rng::stream(8, &format!("{kind:?} {index}"));
            line.faults
                .add_rate(FaultId(0), kind, Window::ALWAYS, 0.003, rng);
        }
    }
    let mut sent = vec![[0, 0]];
    while run.rig.now() < Instant::from_secs(60) {
        run.step();
        let program = run.rig.program_as::<Rescue>().expect("the rescue robot");
        let wanted = program.set_point().map(i16::from);
        if !sent.contains(&wanted) {
            sent.push(wanted);
        }
        let base = run
            .rig
            .device::<emulators::avr_base::AvrBase>("base")
            .expect("emulated");
        let found = base.set_points();
        assert!(
            sent.contains(&found),
            "{found:?} at {} was never sent",
            run.rig.now()
        );
    }
    assert!(sent.len() > 5, "the robot must have driven: {sent:?}");
    let outcome = run.judge();
    assert!(
        outcome.counters["base retries"] > 0,
        "{:?}",
        outcome.counters
    );
}
