//! The rescue robot's search: it explores all reachable space, then goes home. These are a few
//! mazes of many, and the mutants that must fail.

use hilrig::run::Run;
use hilrig::scenario::{Action, Scenario};

use super::{failures, shipped};
use crate::thorough::few;

fn judged(name: &str, more: &str, change: impl FnOnce(&mut Scenario)) -> Vec<String> {
    let (_, source) = shipped(name);
    let text = source
        .text
        .replace("[expect]", &format!("{more}\n[expect]"));
    let (mut scenario, source) = Scenario::parse(&source.path, text).expect("sound");
    change(&mut scenario);
    let run = Run::new(scenario, &source, None).expect("can be wired");
    failures(&run.finish())
}

/// The maze of this seed and size.
fn maze(seed: u64, [columns, rows]: [usize; 2]) -> impl FnOnce(&mut Scenario) {
    move |scenario| {
        scenario.seed = seed;
        let maze = scenario.world.maze.as_mut().expect("it has one").get_mut();
        (maze.seed, maze.columns, maze.rows) = (seed, columns, rows);
    }
}

#[test]
fn a_flat_is_searched_to_its_last_corner_and_left_for_home() {
    assert_eq!(judged("rescue-explore", "", |_| {}), [""; 0]);
}

/// Two panes and a threshold of 4 cm, which the lidar does not see. The infrared sensors help only
/// if the program reads them.
#[test]
fn glass_and_thresholds_are_seen_by_infrared() {
    assert_eq!(judged("rescue-glass", "", |_| {}), [""; 0]);
    let unread = |scenario: &mut Scenario| {
        scenario.program.tuning = None;
        scenario.duration = "60s".parse().expect("a minute");
    };
    let failed = judged("rescue-glass", "", unread);
    assert!(
        failed.iter().any(|it| it.starts_with("no-collision")),
        "{failed:?}"
    );
}

/// Tiles of 45 cm are searched by a robot of 12 cm radius. Tiles of 30 cm, as in the report's
/// arena, are not searched by a robot that fits: in the middle of a tile the boards are 14 cm from
/// the lidar, which measures from 14.5 cm on.
#[test]
fn a_maze_of_tiles_of_45_cm_is_searched_and_of_30_cm_is_not() {
    let failed = |tile_cm: u32, [radius_mm, clearance_mm, axle_mm]: [u32; 3]| {
        let (_, source) = shipped("rescue-maze");
        let (half_m, tile_m) = (f64::from(tile_cm) / 200.0 + 0.1, f64::from(tile_cm) / 100.0);
        let [radius_m, axle_m] = [radius_mm, axle_mm].map(|mm| f64::from(mm) / 1000.0);
        let body = format!(
            "[program.tuning]\nradius_mm = {radius_mm}\nclearance_mm = {clearance_mm}\n\
             [world.body]\nradius_m = {radius_m}\naxle_m = {axle_m}\n[world]\n"
        );
        let text = source
            .text
            .replace("[world]\n", &body)
            .replace("0.375", &half_m.to_string())
            .replace(
                "columns = 5, rows = 5, victims = 3",
                &format!("columns = 3, rows = 3, victims = 1, tile_m = {tile_m}"),
            )
            .replace("1500s", "250s");
        let (scenario, source) = Scenario::parse(&source.path, text).expect("sound");
        let run = Run::new(scenario, &source, None).expect("can be wired");
        failures(&run.finish())
    };
    assert_eq!(failed(45, [120, 30, 200]), [""; 0]);
    let narrow = failed(30, [90, 15, 140]);
    let is_lost = |check: &String| check.starts_with("pose-rms: ");
    assert!(narrow.iter().any(is_lost), "{narrow:?}");
}

#[test]
fn mazes_of_all_sizes_are_searched() {
    for (seed, size) in few(2, [(2, [3, 3]), (3, [4, 3]), (4, [4, 4])]) {
        let failed = judged("rescue-maze", "", maze(seed, size));
        assert_eq!(failed, [""; 0], "seed {seed}, {size:?}");
    }
}

/// A person walks through the door to and fro. The person may block the robot for some time; the
/// robot tries an unreached target again.
#[test]
fn something_that_moves_keeps_the_robot_from_nothing() {
    let walker = "[[world.moving]]\npath_m = [[2.2, 2.6], [2.2, 1.3]]\nspeed_m_s = 0.1\n\
        radius_m = 0.08\nrepeat = \"ping-pong\"\n";
    let failed = judged("rescue-explore", walker, |_| {});
    let in_earnest = |check: &&String| !check.starts_with("no-collision");
    assert_eq!(failed.iter().find(in_earnest), None);
}

/// Each tenth packet of the lidar and each fiftieth frame of the base is damaged.
#[test]
fn faults_on_the_links_cost_time_only() {
    let faults = "[[fault]]\nlink = \"lidar\"\ndirection = \"to-master\"\nkind = \"flip\"\n\
        rate = 0.005\n[[fault]]\nlink = \"base\"\ndirection = \"to-master\"\nkind = \"flip\"\n\
        rate = 0.002\n";
    assert_eq!(judged("rescue-maze", faults, maze(5, [3, 3])), [""; 0]);
}

/// A battery of 3 percent from 2 s on is believed after five readings, one a second. From 8 s on
/// the robot averages at most 0.15 m/s over each second (its law: 136 mm/s) instead of 0.2 m/s and
/// more. It leaves a third of the flat unexplored, goes home, and says so.
#[test]
fn r117_a_low_battery_slows_the_robot_and_sends_it_home() {
    let (_, source) = shipped("rescue-explore");
    let low = "[[fault]]\nkind = \"device\"\ndevice = \"base\"\nfault = \"battery-low\"\n\
        from = \"2s\"\n\n[expect]";
    let text = source.text.replacen("[expect]", low, 1);
    let (mut scenario, source) = Scenario::parse(&source.path, text).expect("sound");
    scenario.duration = "60s".parse().expect("a minute");
    let outcome = Run::new(scenario, &source, None)
        .expect("can be wired")
        .finish();
    let fastest = |from: u128, until: u128| {
        let seconds = outcome.truth.iter().zip(outcome.truth.iter().skip(20));
        let within = seconds.filter(|((begin, _), (end, _))| {
            u128::from(begin.as_millis()) >= from && u128::from(end.as_millis()) <= until
        });
        let speeds = within.map(|((begin, from), (end, to))| {
            from.point().distance(to.point()) / (*end - *begin).as_secs_f64()
        });
        speeds.fold(0.0, f64::max)
    };
    let [before, after] = [fastest(0, 5_000), fastest(8_000, 60_000)];
    assert!(before > 0.2, "{before} m/s");
    assert!((0.05..0.15).contains(&after), "{after} m/s");
    let failed = failures(&outcome);
    assert!(
        failed.len() == 1 && failed[0].starts_with("explored"),
        "{failed:?}"
    );
}

/// The mutants: a robot that follows walls forever is not home, and a robot stopped early has not
/// seen everything.
#[test]
fn a_robot_that_does_not_search_is_told_from_one_that_does() {
    let told = |mode: &str, at: &str| {
        let order = format!("[[mission.step]]\nat = \"{at}\"\ndo = {{ mode = \"{mode}\" }}\n");
        let failed = judged("rescue-explore", &order, |scenario| {
            if at == "1s" {
                scenario.mission.step.remove(0);
            }
            scenario.duration = "40s".parse().expect("a span");
        });
        failed
            .iter()
            .map(|check| check.split(':').next().unwrap_or_default().to_owned())
            .collect()
    };
    let (walls, stopped): (Vec<String>, Vec<String>) =
        (told("exploration", "1s"), told("stop", "8s"));
    assert!(walls.contains(&"home".to_owned()), "{walls:?}");
    assert_eq!(stopped, ["home", "explored"]);
    let (scenario, _) = shipped("rescue-explore");
    let order = &scenario.mission.step[0].action;
    assert_eq!(*order, Action::Mode("explore".to_owned()));
}
