//! The PC program in the whole rig: over the radio, through loss and disconnections.

use core::time::Duration;

use emulators::hc06::{Hc06, Radio};
use emulators::pc::{Connection, Pc};
use firmware_core::robots::rescue::Rescue;
use hilrig::rig::Rig;
use hilrig::robots::rescue::pc_program::{self, Gesture, Refusal};
use hilrig::run::Run;
use hilrig::scenario::SetPoint;
use protocols::Instant;
use protocols::pcui::message::Mode;

use super::{in_a_room, start};

const SECOND: Duration = Duration::from_secs(1);

fn pc(run: &Run) -> &Pc {
    run.rig.device("pc").expect("the PC is emulated")
}

fn does(run: &mut Run, gesture: Gesture) -> Result<(), Refusal> {
    let action = pc_program::answer(pc(run), gesture)?;
    run.command(action).expect("within the limits");
    Ok(())
}

fn robot(rig: &Rig) -> &Rescue {
    let program: &dyn core::any::Any = rig.program().expect("in this process");
    program.downcast_ref().expect("the rescue robot")
}

/// Runs until `condition` holds; returns the elapsed time.
fn wait_for(run: &mut Run, most: Duration, condition: impl Fn(&Run) -> bool) -> Duration {
    let begin = run.rig.now();
    while !condition(run) {
        assert!(run.rig.now() - begin < most, "not within {most:?}");
        run.go_on_until(run.rig.now() + Duration::from_millis(1));
    }
    run.rig.now() - begin
}

fn connected(more: &str) -> Run {
    let mut run = start(in_a_room("1h", more));
    wait_for(&mut run, 5 * SECOND, |run| pc(run).map().is_some());
    run
}

fn add(run: &mut Run, x: i32, y: i32) {
    does(run, Gesture::Add { at: [x, y] }).expect("on the map");
}

fn on_the_robot(run: &Run) -> Vec<[i16; 2]> {
    let list = robot(&run.rig).waypoints().all();
    list.iter().map(|waypoint| waypoint.position_mm).collect()
}

/// The longest list of the report is sent back while the map passes: the radio's buffer of 700
/// bytes does not overflow.
#[test]
fn a_list_of_100_waypoints_passes_the_radio() {
    for seed in 1..=6 {
        let places = (0..100_u32).map(|n| [n % 10, n / 10].map(|step| 1.0 + 0.1 * f64::from(step)));
        let (mut scenario, source) = in_a_room("8s", "[expect]\nviolations_max = 0\n");
        scenario.seed = seed;
        scenario.mission.waypoints_m = places.collect();
        let mut run = start((scenario, source));
        run.go_on_until(Instant::from_secs(8));
        assert_eq!(on_the_robot(&run).len(), 100, "seed {seed}");
        assert_eq!(run.rig.all_broken_rules(), [], "seed {seed}");
    }
}

/// One byte in 10,000 lost and one in 10,000 flipped between robot and radio: some 3 % of the map's
/// rows are damaged, and hardly one in 30,000 is lost three times. Three passes of 300 rows later
/// every row has arrived and equals the robot's. A pass takes 5.9 s at most: 320 B a row at 12
/// kB/s, of which poses take 5 %.
#[test]
fn over_a_lossy_radio_the_map_is_whole_and_right_within_three_passes() {
    let fault = |kind| {
        format!(
            "[[fault]]\nlink = \"radio\"\ndirection = \"to-device\"\nkind = \"{kind}\"\n\
             rate = 0.0001\n"
        )
    };
    let mut run = connected(&(fault("drop") + &fault("flip")));
    let before = rows_sent(&run);
    let whole = |run: &Run| pc(run).map_complete_at().is_some();
    wait_for(&mut run, 60 * SECOND, whole);
    let sent = rows_sent(&run) - before;
    assert!(sent <= 3 * 300, "{sent} rows");
    assert!(pc(&run).record().counts.bad_frames > 0, "nothing was lost");

    // Without a lidar the robot's map stays unchanged: three passes later the PC's map is equal.
    does(&mut run, Gesture::Mode("stop".to_owned())).expect("connected");
    let cut = r#"{"link":"lidar","direction":"to-master","kind":"cut"}"#;
    run.inject(serde_json::from_str(cut).expect("a fault"))
        .expect("there is a lidar");
    run.go_on_until(run.rig.now() + 2 * SECOND);
    let before = rows_sent(&run);
    wait_for(&mut run, 60 * SECOND, |run| {
        rows_sent(run) >= before + 3 * 300
    });
    // Time of the last row through the radio.
    run.go_on_until(run.rig.now() + Duration::from_millis(200));
    let wrong = wrong_cells(&run);
    assert!(wrong.is_empty(), "{wrong:?}");
}

fn rows_sent(run: &Run) -> u64 {
    let mut sent = 0;
    let program = run.rig.program().expect("in here");
    program.counters(&mut |name, value| {
        if name == "map rows sent" {
            sent = value;
        }
    });
    sent
}

/// Cells that differ from the robot's: x, y, the PC's value, the robot's value.
fn wrong_cells(run: &Run) -> Vec<[usize; 4]> {
    let (seen, held) = (pc(run).map().expect("known"), run.rig.program());
    let held = held.and_then(|program| program.map()).expect("has a map");
    let cells = (0..seen.height).flat_map(|y| (0..seen.width).map(move |x| [x, y]));
    let both = cells.map(|[x, y]: [usize; 2]| {
        let held = held.row(y).expect("as high")[x];
        [
            x,
            y,
            usize::from(seen.pixels[y * seen.width + x]),
            usize::from(held),
        ]
    });
    both.filter(|[.., seen, held]| seen != held).collect()
}

/// The radio is gone for 25 s, longer than the 20 s after which both ends give up. Two seconds
/// after it is back the program receives the robot again, without an action of the operator.
#[test]
fn after_a_lost_radio_the_program_is_back_within_two_seconds() {
    for away in [21_000, 25_300, 27_777, 60_000] {
        let mut run = connected("");
        let now = run.rig.now();
        radio(&mut run).set_radio(now, Radio::Lost);
        run.go_on_until(now + Duration::from_millis(away));
        assert_eq!(pc(&run).connection(), Connection::Opening);
        let heard = pc(&run).record().counts.map_properties;

        let now = run.rig.now();
        radio(&mut run).set_radio(now, Radio::InReach);
        let heard_again = |run: &Run| pc(run).record().counts.map_properties > heard;
        let took = wait_for(&mut run, 2 * SECOND, heard_again);
        assert!(took <= 2 * SECOND, "{took:?}");
    }
}

fn radio(run: &mut Run) -> &mut Hc06 {
    run.rig.device_mut("radio").expect("emulated")
}

/// PU-10: while the fielded robot drove to the third waypoint, it got a list with one waypoint, and
/// drove to (-1, -1).
#[test]
fn pu_10_a_shorter_list_changes_the_target() {
    let mut run = connected("");
    for (x, y) in [(1500, 1250), (1500, 1300), (1500, 2200)] {
        add(&mut run, x, y);
    }
    let third = |run: &Run| robot(&run.rig).target().map(|t| t.position_mm) == Some([1500, 2200]);
    wait_for(&mut run, 20 * SECOND, third);
    does(&mut run, Gesture::Clear).expect("connected");
    add(&mut run, 900, 900);
    let only = |run: &Run| on_the_robot(run) == [[900, 900]];
    wait_for(&mut run, SECOND, only);
    let target = robot(&run.rig).target().map(|target| target.position_mm);
    assert_eq!(target, Some([900, 900]));
}

/// PU-11: an empty list made the robot explore; here it stops.
#[test]
fn pu_11_a_robot_without_waypoints_stops() {
    let mut run = connected("");
    add(&mut run, 1500, 2200);
    wait_for(&mut run, 10 * SECOND, |run| run.rig.world.is_moving());
    does(&mut run, Gesture::Clear).expect("connected");
    wait_for(&mut run, SECOND, |run| on_the_robot(run).is_empty());
    run.go_on_until(run.rig.now() + SECOND);
    assert_eq!(robot(&run.rig).mode(), Mode::Stop);
    assert!(!run.rig.world.is_moving());
}

/// PU-12 and PU-14: 21 waypoints overflowed the robot's queue of 200 bytes, and each byte waited
/// for a row of the map. The longest list, 523 bytes, is confirmed within a second, although the
/// robot sends the map all the time: 26 ms through the radio, the echo behind one row, its way
/// back.
#[test]
fn pu_12_and_14_the_longest_list_is_confirmed_within_a_second() {
    let mut run = connected("");
    does(&mut run, Gesture::Clear).expect("connected");
    for x in 0..56 {
        add(&mut run, 700 + 20 * x, 1500);
        run.go_on_until(run.rig.now() + Duration::from_millis(200));
    }
    let last = Gesture::Move {
        index: 55,
        from: [1800, 1500],
        to: [1800, 1501],
    };
    does(&mut run, last).expect("is there");
    let confirmed = |run: &Run| pc(run).unconfirmed_waypoints().is_none();
    let took = wait_for(&mut run, SECOND, confirmed);
    assert_eq!(on_the_robot(&run).len(), 56);
    assert!(took <= SECOND, "{took:?}");
}

/// PU-15, PU-20 and PU-21: driving by hand works, the order is repeated at least once a second, and
/// a robot whose PC disconnects stops.
#[test]
fn a_hand_drives_the_robot_until_it_is_gone() {
    let mut run = connected("");
    let before = run.rig.world.pose();
    does(&mut run, Gesture::Drive(SetPoint::list([-10, 10]))).expect("connected");
    run.go_on_until(run.rig.now() + 3 * SECOND);
    assert_eq!(robot(&run.rig).mode(), Mode::Manual);
    // 10 ticks of 0.454 mm in 40 ms are 113 mm/s a wheel, 0.87 rad/s on an axle of 260 mm.
    let turned = emulators::world::wrap_angle(run.rig.world.pose().theta - before.theta);
    assert!((2.0..2.8).contains(&turned), "{turned} rad");
    does(&mut run, Gesture::Disconnect).expect("always");
    run.go_on_until(run.rig.now() + 3 * SECOND);
    assert_ne!(robot(&run.rig).mode(), Mode::Manual);
    assert!(run.rig.now() > Instant::from_secs(6));
}
