//! Verdicts of the safety checkers on single moments; whole runs are in `tests/rig/safety.rs`.

use core::time::Duration;
use std::sync::Arc;

use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use emulators::{Event, EventKind};

use super::*;
use crate::robots::checker::{Look, Status};
use crate::robots::instruments::Unknown;
use crate::robots::{Axis, Figure};

/// A robot that reported `told` while the true value is `truth`.
struct Telling {
    told: f64,
    truth: f64,
}

impl Instruments for Telling {
    fn figures(&self, rig: &Rig) -> Vec<Figure> {
        vec![Figure {
            name: "the battery, V",
            at: rig.now(),
            told: self.told,
            truth: self.truth,
            tolerance: 0.5,
            wrong_min: Figure::CHANGING,
        }]
    }
}

pub(in crate::run) fn nowhere() -> Scenario {
    let text = "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"60s\"\n\
        [world]\nstart = { x_m = 1, y_m = 1, heading_deg = 0 }\n";
    Scenario::from_text(text).expect("sound").0
}

pub(in crate::run) fn rig() -> Rig {
    let scene = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("empty");
    let body = BodyConfig::default().ideal();
    Rig::new(World::new(scene, body, Pose::default(), 1).expect("free"))
}

fn observed(checker: &mut dyn Checker, looks: u64) -> Check {
    let mut rig = rig();
    for look in 1..=looks {
        rig.run_until(Instant::from_millis(10 * look));
        checker.observe(&Look {
            rig: &rig,
            axes: &[],
            contacts: &[],
        });
    }
    checker.verdict()
}

/// Half a volt is within the tolerance. The first report has no earlier true value; three wrong
/// reports in a row are a failure, so the fourth update decides.
#[test]
fn three_wrong_reports_in_a_row_are_a_failure() {
    let told = |told, looks| {
        let telling = Telling { told, truth: 12.0 };
        observed(
            &mut TelemetryTrue::new(Arc::new(telling), Calm::default()),
            looks,
        )
    };
    assert_eq!(told(12.5, 9).status, Status::Pass);
    assert_eq!(told(12.6, 3).status, Status::Pass);
    let wrong = told(12.6, 4);
    assert_eq!(wrong.status, Status::Fail);
    let detail = "at 0.040000 s the battery, V is reported as 12.60, the true value is 12.00";
    assert_eq!(wrong.detail, detail);
    let none = observed(
        &mut TelemetryTrue::new(Arc::new(Unknown), Calm::default()),
        9,
    );
    assert_eq!(none.status, Status::NotObserved);
}

/// A robot without needed links is not judged, and the verdict names the missing key.
#[test]
fn nothing_is_observed_without_links() {
    let within = Duration::from_secs(1);
    let mut rests = RestsAfterSilence::new(Vec::new(), Vec::new(), Calm::default(), within);
    let check = observed(&mut rests, 3);
    assert_eq!(check.status, Status::NotObserved);
    assert!(check.detail.ends_with("set rests_without"));
    let unknown: Arc<dyn Instruments> = Arc::new(Unknown);
    let mut says = NoticesSilence::listening(&nowhere(), &mut rig(), &unknown, within);
    assert_eq!(observed(&mut says, 3).status, Status::NotObserved);
}

/// Two queues overflowed; a wrong baud rate does not count. Notes count as well, because a device
/// that only notes an overflow has also lost bytes.
#[test]
fn queues_that_overflowed_are_counted() {
    let mut rig = rig();
    for (kind, rule) in [
        (EventKind::Violation, "fifo-overflow"),
        (EventKind::Violation, "baud"),
        (EventKind::Note, "overrun"),
    ] {
        let event = Event {
            at: Instant::from_millis(5),
            kind,
            rule,
            detail: "64 bytes".to_owned(),
            bytes: Vec::new(),
        };
        rig.log("radio", event);
    }
    let judged = |most| overruns(most, &rig, rig.events());
    assert_eq!(judged(2).status, Status::Pass);
    let check = judged(1);
    assert_eq!(check.status, Status::Fail);
    assert!(
        check
            .detail
            .starts_with("2 queues overflowed, at most 1; first: "),
        "{}",
        check.detail
    );
    assert!(check.detail.contains("fifo-overflow"), "{}", check.detail);
}

fn in_a_room(duration: &str, more: &str) -> String {
    format!(
        "schema = 1\nname = \"r\"\nrobot = \"rescue\"\nduration = \"{duration}\"\n{more}\
         [mission]\nto_the_end = true\nwaypoints_m = [[1.5, 2.2], [0.8, 1.5]]\n\
         [world]\nstart = {{ x_m = 0.8, y_m = 1.4, heading_deg = 90 }}\n[[world.wall]]\n\
         path_m = [[0.2, 0.2], [2.8, 0.2], [2.8, 2.8], [0.2, 2.8], [0.2, 0.2]]\n"
    )
}

fn named(outcome: crate::run::Outcome, name: &str) -> Check {
    let mut checks = outcome.checks.into_iter();
    let found = checks.find(|check| check.name == name);
    found.expect("it is asked for")
}

/// A link that was never needed, or never silent, proves nothing. A lidar that falls silent while
/// the robot drives does. A PC that only manual driving needs is not named.
#[test]
fn only_silences_of_needed_links_are_observed() {
    let judged = |fault: &str| {
        let safety = "[expect.safety]\nrests_within = \"1s\"\n";
        let text = in_a_room("9s", &format!("{fault}{safety}"));
        named(
            crate::run::judge(&text).expect("sound"),
            "rests-after-silence",
        )
    };
    let calm = judged("");
    assert_eq!(calm.status, Status::NotObserved, "{}", calm.detail);
    let cut = "[[fault]]\nkind = \"cut\"\nlink = \"lidar\"\ndirection = \"to-master\"\n\
        from = \"5s\"\n";
    let dark = judged(cut);
    assert_eq!(dark.status, Status::Pass, "{}", dark.detail);
    assert!(
        dark.detail.ends_with("silences of lidar"),
        "{}",
        dark.detail
    );
}

/// The mode of a foreign program is unknown, and so are the links that only some modes need.
#[test]
fn what_a_mode_needs_is_unknown_without_a_mode() {
    let rows = [
        (Need::always("a"), [true, true, true]),
        (Need::always("a").only(&["x"]), [true, false, false]),
        (Need::always("a").except(&["x"]), [false, true, false]),
    ];
    for (need, expected) in rows {
        let needed = [Some("x"), Some("y"), None].map(|mode| need.is_needed(mode));
        assert_eq!(needed, expected, "{need:?}");
    }
}

/// Along a wall the car needs its board, and not its camera.
#[test]
fn a_car_along_a_wall_needs_its_board() {
    let text = include_str!("../../../../../../scenarios/apollo13-wall.toml");
    for (link, expected) in [("car", Status::Pass), ("scan", Status::NotObserved)] {
        let text = format!(
            "{text}\n[expect.safety]\nrests_within = \"1s\"\n[[fault]]\nkind = \"cut\"\n\
             link = \"{link}\"\ndirection = \"to-master\"\nfrom = \"3s\"\n"
        );
        let (mut scenario, source) = Scenario::from_text(&text).expect("sound");
        scenario.duration = crate::scenario::Span::from_millis(6_000);
        let run = crate::run::Run::new(scenario, &source, None).expect("sound");
        let check = named(run.finish(), "rests-after-silence");
        assert_eq!(check.status, expected, "{link}: {}", check.detail);
    }
}

/// A lidar that was never at work has not fallen silent. Garbage before a silence is already
/// counted.
#[test]
fn only_a_device_at_work_falls_silent() {
    let cut = |from: &str| {
        format!(
            "[[fault]]\nkind = \"cut\"\nlink = \"lidar\"\ndirection = \"to-master\"\n\
             from = \"{from}\"\n"
        )
    };
    let garbage = "[[fault]]\nkind = \"device\"\ndevice = \"lidar\"\nfault = \"garbage\"\n";
    let rows = [
        (cut("4s"), Status::Pass),
        (
            format!("{garbage}from = \"4s\"\n{}", cut("6500ms")),
            Status::Pass,
        ),
        (
            format!("{garbage}from = \"0s\"\n{}", cut("6500ms")),
            Status::NotObserved,
        ),
    ];
    for (faults, expected) in rows {
        let text = in_a_room(
            "10s",
            &format!("{faults}[expect.safety]\nsays_within = \"3s\"\n"),
        );
        let outcome = crate::run::judge(&text).expect("sound");
        let check = named(outcome, "notices-silence");
        assert_eq!(check.status, expected, "{faults}{}", check.detail);
    }
}

/// A lidar whose head stops again and again from its start sends valid frames, but no turn with a
/// distance. It was never at work, so the cut of its cable is no new failure.
#[test]
fn a_lidar_that_was_never_at_work_cannot_fall_silent() {
    let judged = |faults: &str| {
        let safety = "[expect.safety]\nsays_within = \"3s\"\n";
        let text = in_a_room("20s", &format!("{faults}{safety}"));
        let outcome = crate::run::judge(&text).expect("sound");
        named(outcome, "notices-silence")
    };
    let cut =
        "[[fault]]\nkind = \"cut\"\nlink = \"lidar\"\ndirection = \"to-master\"\nfrom = \"12s\"\n";
    let stuck = "[[fault]]\nkind = \"stuck\"\ndevice = \"lidar\"\nfrom = \"661ms\"\n\
                 lasting = \"265ms\"\nevery = \"736ms\"\n";
    for (faults, expected) in [
        (cut.to_owned(), Status::Pass),
        (format!("{stuck}{cut}"), Status::NotObserved),
    ] {
        let check = judged(&faults);
        assert_eq!(check.status, expected, "{faults}{}", check.detail);
    }
}

/// The program sends nothing to this lidar. Bytes that come back to it for six seconds are an echo:
/// when it ends, no line of the program has fallen silent.
#[test]
fn an_echo_is_no_line_at_work() {
    let echo = "[[fault]]\nkind = \"echo\"\nlink = \"lidar\"\ndirection = \"to-master\"\n\
                from = \"2s\"\nuntil = \"8s\"\n";
    let safety = "[expect.safety]\nalive_for = \"4s\"\nalive_without = [\"radio\", \"pc\"]\n";
    let text = in_a_room("16s", &format!("{echo}{safety}"));
    let check = named(crate::run::judge(&text).expect("sound"), "alive-at-the-end");
    let is_blamed = check.detail.contains("lidar to-device");
    assert!(
        check.status != Status::NotObserved && !is_blamed,
        "{}",
        check.detail
    );
}

/// A rig with one link, and the nodes of its device and of its master. A byte takes 10 us.
pub(in crate::run) fn linked(name: &str) -> (Rig, [usize; 2]) {
    let (rig, [ends]) = crate::rig::bare::linked([name], 1_000_000);
    (rig, ends.map(|end| end.node))
}

pub(in crate::run) fn drive(set_point: f64) -> Axis {
    Axis {
        name: "drive".into(),
        unit: "m/s",
        set_point,
        limit: None,
        actual: None,
    }
}

/// Looks at `rig` at a millisecond, with a drive at this set-point.
pub(in crate::run) fn look_at(
    checker: &mut dyn Checker,
    rig: &mut Rig,
    millis: u64,
    set_point: f64,
) {
    rig.run_until(Instant::from_millis(millis));
    checker.observe(&Look {
        rig,
        axes: &[drive(set_point)],
        contacts: &[],
    });
}

/// Commands at 10 and 20 ms. At a set-point the next one may be 300 ms later.
#[test]
fn a_drive_is_fed_while_it_drives() {
    let fed = |looks: &[(u64, f64)]| {
        let (mut rig, [_, master]) = linked("base");
        let links = vec!["base".to_owned()];
        let within = Duration::from_millis(300);
        let mut fed = DriveFed::new(&rig, links, within, Calm::default());
        for millis in [10, 20] {
            rig.inject(master, &[1]);
            look_at(&mut fed, &mut rig, millis, 1.0);
        }
        for &(millis, set_point) in looks {
            look_at(&mut fed, &mut rig, millis, set_point);
        }
        fed.verdict()
    };
    let held = fed(&[(320, 1.0)]);
    assert_eq!(
        (held.status, &*held.detail),
        (Status::Pass, "commands at most 300 ms apart at set-points")
    );
    let late = fed(&[(321, 1.0), (900, 1.0)]);
    assert_eq!(late.status, Status::Fail);
    assert!(
        late.detail
            .starts_with("at 0.321000 s no command for 301 ms at"),
        "{}",
        late.detail
    );
    assert_eq!(fed(&[(250, 0.0), (550, 1.0)]).status, Status::Pass);
    let (mut rig, _) = linked("base");
    let within = Duration::from_millis(300);
    let mut none = DriveFed::new(&rig, Vec::new(), within, Calm::default());
    look_at(&mut none, &mut rig, 900, 1.0);
    assert_eq!(none.verdict().status, Status::NotObserved);
}

/// A watchdog of a device on the drive's links has fired, between two looks at the logs.
#[test]
fn a_watchdog_of_the_drive_is_told() {
    let stopped = |source: &str| {
        let (mut rig, _) = linked("base");
        let links = vec!["base".to_owned()];
        let within = Duration::from_secs(9);
        let mut fed = DriveFed::new(&rig, links, within, Calm::default());
        fed.watch("base");
        look_at(&mut fed, &mut rig, 10, 1.0);
        let event = Event {
            at: Instant::from_millis(50),
            kind: EventKind::Note,
            rule: "watchdog",
            detail: String::new(),
            bytes: Vec::new(),
        };
        rig.log(source, event);
        look_at(&mut fed, &mut rig, 100, 1.0);
        let early = fed.verdict().status;
        look_at(&mut fed, &mut rig, 110, 1.0);
        (early, fed.verdict().detail)
    };
    let (early, detail) = stopped("base");
    assert_eq!(early, Status::Pass);
    assert!(
        detail.starts_with("at 0.050000 s base stopped by itself"),
        "{detail}"
    );
    assert!(stopped("other").1.starts_with("commands at most"));
}

/// 60 bytes a second to the device, for some seconds, are a busy line. The last part of the run
/// begins at 10 s; a second of it is enough.
#[test]
fn a_line_that_was_busy_is_alive_at_the_end() {
    let judged = |bytes: usize, busy_s: u64, last_s: u64, until_s: u64, exempt: &str| {
        let (mut rig, [_, master]) = linked("base");
        let last = Duration::from_secs(4);
        let exempt = vec![exempt.to_owned()];
        let mut alive = AliveAtTheEnd::new(Instant::from_secs(10), last, exempt, false);
        look_at(&mut alive, &mut rig, 0, 0.0);
        for second in 1..=until_s {
            if second <= busy_s || second == last_s {
                rig.inject(master, &vec![7; bytes]);
            }
            look_at(&mut alive, &mut rig, 1_000 * second, 0.0);
        }
        let check = alive.verdict();
        (check.status, check.detail)
    };
    let silent = (
        Status::Fail,
        "silent since 10.000000 s: base to-device".to_owned(),
    );
    assert_eq!(judged(60, 4, 0, 14, ""), silent);
    assert_eq!(judged(60, 10, 11, 14, "").0, Status::Pass);
    for (bytes, busy_s, until_s, exempt) in [
        (59, 10, 14, ""),
        (60, 3, 14, ""),
        (60, 9, 14, "base"),
        (60, 9, 10, ""),
    ] {
        assert_eq!(
            judged(bytes, busy_s, 0, until_s, exempt).0,
            Status::NotObserved,
            "{bytes} {busy_s}"
        );
    }
}

/// A robot that believes this pose.
struct Believing(Pose);

impl Instruments for Believing {
    fn estimate(&self, rig: &Rig) -> Option<(Instant, Pose)> {
        Some((rig.now(), self.0))
    }
}

/// The robot stands at the origin and may be wrong by 300 mm and 20 degrees, or for less than three
/// seconds.
#[test]
fn a_pose_is_wrong_if_it_is_so_for_three_seconds() {
    let judged = |x: f64, degrees: f64, until_ms: u64, hit_ms: Option<u64>| {
        let pose = Pose::new(x, 0.0, degrees.to_radians());
        let mut quiet = Undisturbed::default();
        if let Some(hit) = hit_ms {
            quiet.hit_at(Instant::from_millis(hit));
        }
        let mut believed = PoseBelieved::new(Arc::new(Believing(pose)), 300.0, quiet);
        let mut rig = rig();
        for millis in (1_000..=until_ms).step_by(500) {
            look_at(&mut believed, &mut rig, millis, 0.0);
        }
        let check = believed.verdict();
        (check.status, check.detail)
    };
    assert_eq!(judged(0.3, 19.9, 9_000, None).0, Status::Pass);
    let wrong = "since 1.000000 s the believed pose is wrong, by 310 mm and 0 degrees";
    assert_eq!(
        judged(0.31, 0.0, 4_000, None),
        (Status::Fail, wrong.to_owned())
    );
    assert_eq!(judged(0.31, 0.0, 3_500, None).0, Status::Pass);
    assert_eq!(judged(0.0, -20.1, 4_000, None).0, Status::Fail);
    assert_eq!(judged(0.31, 0.0, 9_000, Some(3_000)).0, Status::Pass);
    assert_eq!(judged(0.31, 0.0, 9_000, Some(1_000)).0, Status::NotObserved);
}

/// A lidar sends until 2 s. The robot may drive for one more second, the limit. Then it has half a
/// second to brake, and 0.3 s until commands could have stopped it.
#[test]
fn a_robot_rests_after_a_silence() {
    use emulators::world::Command;
    let judged = |stops_ms: u64, from_ms: u64| {
        let (mut rig, [lidar, _]) = linked("lidar");
        let needs = vec![Need::always("lidar")];
        let within = Duration::from_secs(1);
        let mut rests = RestsAfterSilence::new(needs, Vec::new(), Calm::default(), within);
        for millis in (100..=6_000).step_by(100) {
            if millis <= 2_000 {
                rig.inject(lidar, &[1]);
            }
            let speed = if (from_ms..stops_ms).contains(&millis) {
                0.2
            } else {
                0.0
            };
            for wheel in ["left", "right"] {
                rig.world
                    .actuate(wheel, Command::Speed(speed))
                    .expect("a wheel");
            }
            rig.run_until(Instant::from_millis(millis));
            rests.observe(&Look {
                rig: &rig,
                axes: &[],
                contacts: &[],
            });
        }
        let check = rests.verdict();
        (check.status, check.detail)
    };
    assert_eq!(
        judged(3_000, 500),
        (
            Status::Pass,
            "at rest in each of 1 silences of lidar".into()
        )
    );
    assert_eq!(judged(3_500, 500).0, Status::Pass);
    let (status, detail) = judged(9_000, 500);
    assert_eq!(status, Status::Fail);
    assert!(
        detail.ends_with(" s after the last byte of lidar"),
        "{detail}"
    );
    let at = detail
        .strip_prefix("still moving at ")
        .and_then(|rest| rest.split(' ').next());
    assert_eq!(at, Some("3.900000"), "{detail}");
    assert_eq!(judged(0, 0).0, Status::NotObserved, "it never moved");
}

/// A contact of a robot that a person steers, and a step that may wait: only failures are excused.
#[test]
fn a_scenario_excuses_failures() {
    let spec = |by_hand, steps_may_wait| SafetySpec {
        by_hand,
        steps_may_wait,
        ..SafetySpec::default()
    };
    let excused = |spec: SafetySpec, name: &str, passed: bool| {
        let mut check = Check::new(name, passed, "so");
        spec.excuse(&mut check);
        (check.status, check.detail)
    };
    let kept = |status| (status, "so".to_owned());
    let waits = (Status::NotObserved, "so; it may wait".to_owned());
    let steers = (Status::NotObserved, "so; a person steers".to_owned());
    let (collision, step) = ("no-collision-at-speed", "mission-step-2");
    assert_eq!(excused(spec(true, false), collision, false), steers);
    assert_eq!(
        excused(spec(true, false), collision, true),
        kept(Status::Pass)
    );
    assert_eq!(excused(spec(true, false), step, false), kept(Status::Fail));
    assert_eq!(excused(spec(false, true), step, false), waits);
    assert_eq!(
        excused(spec(false, true), collision, false),
        kept(Status::Fail)
    );
    assert_eq!(
        excused(spec(true, true), "other", false),
        kept(Status::Fail)
    );
}

/// Links of the scenario keep what the robot itself knows about them.
#[test]
fn needed_links_are_those_of_the_scenario_if_it_names_some() {
    struct Needing;
    impl Instruments for Needing {
        fn needs(&self) -> Vec<Need> {
            vec![Need::always("lidar").except(&["stop"]), Need::always("pc")]
        }
    }
    let of = |links: &[&str]| {
        let spec = SafetySpec {
            rests_without: links.iter().map(|&link| link.to_owned()).collect(),
            ..SafetySpec::default()
        };
        needs(&spec, &Needing)
    };
    assert_eq!(of(&[]), Needing.needs());
    let lidar = Need::always("lidar").except(&["stop"]);
    assert_eq!(of(&["camera", "lidar"]), [Need::always("camera"), lidar]);
}

/// A radio counts its overflows by itself, three of them in one entry of the log; another device
/// only logs them.
#[test]
fn overflows_that_a_device_counts_are_counted_once() {
    use emulators::{BrokenRules, Device};
    use protocols::{LineConfig, Port};

    #[derive(Clone, Default)]
    struct Radio(BrokenRules);

    impl Device for Radio {
        fn receive(&mut self, _: Port, _: Instant, _: &[u8]) {}
        fn poll(&mut self, _: Instant, _: &mut World) {}
        fn transmit(&mut self, _: Port, _: &mut [u8]) -> usize {
            0
        }
        fn poll_at(&self) -> Option<Instant> {
            None
        }
        fn line_config(&self, _: Port) -> LineConfig {
            LineConfig::new_8n1(9600)
        }
        fn take_events(&mut self) -> Vec<Event> {
            Vec::new()
        }
        fn broken_rules(&self) -> Option<&BrokenRules> {
            Some(&self.0)
        }
    }

    let mut radio = Radio::default();
    for rule in [
        "fifo-overflow",
        "fifo-overflow",
        "fifo-overflow",
        "too-soon",
    ] {
        radio.0.count(Instant::ZERO, rule);
    }
    let mut rig = rig();
    rig.add_device("radio", radio);
    for source in ["radio", "camera"] {
        let event = Event {
            at: Instant::from_millis(5),
            kind: EventKind::Violation,
            rule: "fifo-overflow",
            detail: "64 bytes".to_owned(),
            bytes: Vec::new(),
        };
        rig.log(source, event);
    }
    let judged = |most| {
        let check = overruns(most, &rig, rig.events());
        (check.status, check.detail)
    };
    let words = |most| format!("4 queues overflowed, at most {most}; first: radio fifo-overflow");
    assert_eq!(judged(4), (Status::Pass, words(4)));
    assert_eq!(judged(3), (Status::Fail, words(3)));
    assert_eq!(
        overruns(0, &self::rig(), &[]).detail,
        "0 queues overflowed, at most 0"
    );
}

/// A robot that does everything wrong: it believes another pose, reports another charge and no
/// line of the wall before it, and measures half of its path.
struct Wrong;

impl Instruments for Wrong {
    fn drive_links(&self) -> Vec<String> {
        vec!["base".to_owned()]
    }

    fn station_links(&self) -> &'static [&'static str] {
        &["radio"]
    }

    fn orders_link(&self) -> Option<&'static str> {
        Some("orders")
    }

    fn needs(&self) -> Vec<Need> {
        vec![Need::always("lidar")]
    }

    fn estimate(&self, rig: &Rig) -> Option<(Instant, Pose)> {
        Some((rig.now(), Pose::new(-9.0, 0.0, 0.0)))
    }

    fn figures(&self, rig: &Rig) -> Vec<Figure> {
        let telling = Telling {
            told: 8.0,
            truth: 12.0,
        };
        telling.figures(rig)
    }

    fn told_lines(&self, rig: &Rig) -> Option<(Instant, Vec<[[f64; 2]; 2]>)> {
        Some((rig.now(), Vec::new()))
    }

    fn searched_points(&self, _: &Rig) -> Vec<[f64; 2]> {
        (0..20_u8).map(|at| [50.0 * f64::from(at), 0.0]).collect()
    }

    fn reckoned(&self, rig: &Rig) -> Option<(Instant, Pose)> {
        Some((rig.now(), Pose::new(rig.world.pose().x / 2.0, 0.0, 0.0)))
    }
}

/// The checks of these keys, of a robot that drives for 12 s at 0.2 m/s. Its lidar falls silent at
/// 2 s, an order to rest arrives at 5.1 s, and no command reaches its base. A fault on `faulty`
/// lasts all the time.
fn asked(keys: &str, faulty: Option<&str>) -> Vec<(String, Status)> {
    use emulators::world::Command;
    let order = "[mission]\nstep = [{ at = \"5s\", do = { mode = \"stop\" } }]\n";
    let (mut scenario, _) = puppet::scenario(&format!("{order}[expect.safety]\n{keys}"));
    scenario
        .fault
        .extend(faulty.map(|link| puppet::cut(link, 0, 60)));
    let names = ["base", "radio", "orders", "lidar"];
    let (mut rig, [_, _, orders, lidar]) = crate::rig::bare::linked(names, 1_000_000);
    rig.world = self::rig().world;
    let robot: Arc<dyn Instruments> = Arc::new(Wrong);
    let mut checkers = asked_for(&scenario, &mut rig, &robot);
    for tenth in 1..=120 {
        for wheel in ["left", "right"] {
            let speed = Command::Speed(0.2);
            rig.world.actuate(wheel, speed).expect("a wheel");
        }
        if tenth <= 20 {
            rig.inject(lidar[0].node, &[1]);
        }
        if tenth == 51 {
            rig.inject(orders[0].node, &[1]);
        }
        rig.run_until(Instant::from_millis(100 * tenth));
        for checker in &mut checkers {
            checker.observe(&Look {
                rig: &rig,
                axes: &[drive(1.0)],
                contacts: &[],
            });
        }
    }
    let checks = checkers.iter().map(|checker| checker.verdict());
    checks.map(|check| (check.name, check.status)).collect()
}

/// Each checker excuses faults of the links that its property depends on, and of no others.
#[test]
fn faults_excuse_what_they_can_cause() {
    use Status::{Fail, NotObserved, Pass};
    let keys = "rests_within = \"1s\"\ncommands_within = \"300ms\"\ntrue_telemetry = true\n\
                motion_within_percent = 5\npose_within_mm = 300\nobeys_within = \"1s\"\n";
    let links = [
        None,
        Some("base"),
        Some("radio"),
        Some("orders"),
        Some("lidar"),
    ];
    let found = links.map(|faulty| asked(keys, faulty));
    let expected = [
        ("rests-after-silence", [Fail, NotObserved, Fail, Fail, Fail]),
        ("lines-true", [Fail, NotObserved, NotObserved, Fail, Fail]),
        (
            "telemetry-true",
            [Fail, NotObserved, NotObserved, Fail, Fail],
        ),
        ("drive-fed", [Fail, Pass, Fail, Fail, Fail]),
        (
            "pose-believed",
            [Fail, NotObserved, Fail, NotObserved, NotObserved],
        ),
        (
            "does-as-ordered",
            [Fail, NotObserved, NotObserved, NotObserved, Fail],
        ),
        (
            "motion-true",
            [Fail, NotObserved, Fail, NotObserved, NotObserved],
        ),
    ];
    for (index, (name, statuses)) in expected.into_iter().enumerate() {
        for (checks, status) in found.iter().zip(statuses) {
            assert_eq!(checks[index], (name.to_owned(), status), "{index}");
        }
    }
    assert!(found.iter().all(|checks| checks.len() == 7));
}

/// Each key asks for its own checkers.
#[test]
fn a_key_asks_for_its_checkers() {
    for (key, expected) in [
        ("", &[][..]),
        ("sound_orders = true", &["moves-on-sound-orders"]),
        ("says_within = \"3s\"", &["notices-silence"]),
        ("alive_for = \"4s\"", &["alive-at-the-end"]),
        ("true_telemetry = true", &["lines-true", "telemetry-true"]),
        ("true_counts = true", &["counts-true"]),
        ("sound_frames = true", &["sends-sound-frames"]),
        ("sends_within = \"3s\"", &["sends-on"]),
        ("short_turns = true", &["turns-short"]),
        ("sends_cyclically = true", &["sends-in-time"]),
        ("asks_again = true", &["asks-again"]),
        ("true_complaints = true", &["complaints-true"]),
    ] {
        let names: Vec<String> = asked(key, None).into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, expected, "{key}");
    }
}
