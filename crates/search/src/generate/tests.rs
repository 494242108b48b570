use core::time::Duration;
use std::collections::BTreeSet;
use std::path::Path;

use super::*;
use engine::scenario::{Action, FaultKind, FaultSpec, PhasesSpec, SetPoint, Step};

mod of_data;

/// [`super::scenario`] for a scenario that names no files.
fn scenario(base: &Scenario, vary: Vary, profile: &Profile, dice: &mut Dice) -> Scenario {
    let source = Source {
        path: "<test>".into(),
        text: String::new(),
    };
    super::scenario(base, &source, vary, profile, dice)
}

fn base() -> Scenario {
    let text = "schema = 1\nname = \"base\"\nrobot = \"rescue\"\nduration = \"5s\"\n\
        [world]\nstart = { x_m = 1.5, y_m = 1.5, heading_deg = 90 }\n[[world.wall]]\n\
        path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7]]\n";
    let parsed = Scenario::parse(Path::new("<test>"), text.to_owned());
    parsed.expect("sound").0
}

#[test]
fn a_seed_is_always_the_same_mission_and_its_neighbour_another() {
    let make = |seed| {
        scenario(
            &base(),
            Vary::ALL,
            &Profile::default(),
            &mut Dice::of_seed(seed, "base"),
        )
    };
    assert_eq!(make(7), make(7));
    assert_ne!(make(7), make(8));
}

/// The lanes are interleaved: byte 0 belongs to the world, byte 3 to the faults.
#[test]
fn other_bytes_for_the_faults_leave_world_mission_and_timing_alone() {
    let bytes: Vec<u8> = (0..=255).collect();
    let mut others = bytes.clone();
    others
        .iter_mut()
        .skip(3)
        .step_by(4)
        .for_each(|byte| *byte ^= 0x5A);
    let make = |bytes: &[u8]| {
        scenario(
            &base(),
            Vary::ALL,
            &Profile::default(),
            &mut Dice::of_bytes(bytes),
        )
    };
    let (one, mut other) = (make(&bytes), make(&others));
    assert_ne!(one.fault, other.fault);
    other.fault = one.fault.clone();
    (other.budget, other.phases) = (one.budget, one.phases);
    assert_eq!(one, other);
}

/// R1: a square room; half of the seeds replace it. Several worlds of both kinds occur, other
/// scenarios get different worlds, and every mission is possible for the robot.
#[test]
fn worlds_are_the_scenarios_own_or_made_up_and_every_mission_can_be_done() {
    let (mut own, mut worlds) = (0, BTreeSet::new());
    for seed in 0..60 {
        let made = scenario(
            &base(),
            Vary::ALL,
            &Profile::default(),
            &mut Dice::of_seed(seed, "base"),
        );
        let other = scenario(
            &base(),
            Vary::ALL,
            &Profile::default(),
            &mut Dice::of_seed(seed, "other"),
        );
        assert_ne!(made.world, other.world, "seed {seed}");
        own +=
            u32::from(made.world.wall.len() == 1 && made.world.wall[0].get_ref().path_m.len() == 3);
        worlds.insert(format!("{:?}", made.world.wall));
        // 16 cm of body and 5 cm, half of the margin with which the mission was generated.
        let ground = ground::Ground::of(&made, 0.05).expect("it can be built");
        let start = made.world.start_pose();
        let reach = ground.reach_from([start.x, start.y]);
        for &waypoint in &made.mission.waypoints_m {
            assert!(reach.way_m(waypoint).is_some(), "seed {seed}: {waypoint:?}");
        }
    }
    assert!(
        (15..45).contains(&own),
        "{own} of 60 are the scenario's own"
    );
    assert!(worlds.len() > 40, "{} worlds", worlds.len());
}

/// A generated mission keeps the rules that it can still judge: on its waypoints, and on places in
/// the scenario's own world only. Each can be wired.
#[test]
fn rules_of_generated_missions_name_what_these_have() {
    let rules = "\n[[expect.rule]]\nname = \"all\"\nsometimes = { visited = 2 }\n\
                 [[expect.rule]]\nname = \"place\"\nnever = { any = [{ contact = {} }, { not = { pose = \
                 { near_m = [1, 1], within_m = 9 } } }] }\n\
                 [[expect.rule]]\nname = \"slow\"\nnever = { robot = { of = \"speed-m-s\", op = \">\", value = 9 } }\n";
    let text = base().to_toml() + rules;
    let (base, source) = Scenario::from_text(&text).expect("sound");
    let mut kept = BTreeSet::new();
    for seed in 0..12 {
        let made = scenario(
            &base,
            Vary::ALL,
            &Profile::default(),
            &mut Dice::of_seed(seed, "base"),
        );
        let names: Vec<&str> = made.expect.rules().map(|rule| &*rule.name).collect();
        assert_eq!(
            names.contains(&"all"),
            made.mission.waypoints_m.len() > 1,
            "seed {seed}"
        );
        assert!(names.contains(&"slow"), "seed {seed}");
        assert!(
            engine::run::Run::new(made.clone(), &source, None).is_ok(),
            "seed {seed}"
        );
        kept.insert(names.join(" "));
    }
    assert!(kept.len() > 1, "{kept:?}");
}

/// A car with a tolerance of 300 mm stopped 203 mm from a goal with a tolerance of 200 mm.
#[test]
fn a_made_up_mission_asks_for_no_more_than_the_scenarios_own() {
    let asked = |own: Option<f64>| {
        let mut base = base();
        base.expect.visit_within_mm = own;
        let made = scenario(
            &base,
            Vary::ALL,
            &Profile::default(),
            &mut Dice::of_seed(1, "base"),
        );
        made.expect.visit_within_mm
    };
    let asked = [None, Some(100.0), Some(300.0)].map(asked);
    assert_eq!(asked, [Some(200.0), Some(200.0), Some(300.0)]);
}

/// If an operator drives by hand, a command that comes one second late also acts farther on.
#[test]
fn a_mission_by_hand_may_be_a_second_late() {
    let made = |base: &Scenario| {
        let vary = Vary {
            faults: true,
            ..Vary::default()
        };
        let made = scenario(
            base,
            vary,
            &Profile::default(),
            &mut Dice::of_seed(1, "base"),
        );
        [made.expect.visit_within_mm, made.expect.return_within_mm]
    };
    let mut base = base();
    base.expect.visit_within_mm = Some(100.0);
    base.expect.return_within_mm = Some(300.0);
    assert_eq!(made(&base), [Some(150.0), Some(300.0)]);
    let by_hand = Action::Drive(SetPoint::list([1, 1]));
    let step = Step::at(Span::from_millis(1_000), by_hand);
    base.mission.step.push(step);
    assert_eq!(made(&base), [Some(400.0), Some(800.0)]);
}

/// Steps such as "explore" and "gates" lead these missions: with waypoints instead, they would be
/// other missions. Objects at fixed positions of the scenario's world stay there.
#[test]
fn a_mission_that_its_steps_lead_stays_as_it_is() {
    let vary = Vary {
        world: true,
        mission: true,
        ..Vary::default()
    };
    let all = |base: &Scenario| {
        let made = |seed| {
            scenario(
                base,
                vary,
                &Profile::default(),
                &mut Dice::of_seed(seed, "base"),
            )
        };
        (0..20).map(made).collect::<Vec<_>>()
    };
    let mut base = base();
    let mode = Step::at(Span::from_millis(1_000), Action::Mode("explore".into()));
    base.mission.step.push(mode);
    base.expect.explored_min = Some(0.98);
    let led = |made: &Scenario| made.mission == base.mission && made.expect == base.expect;
    let free = all(&base);
    assert!(free.iter().all(led));
    assert!(free.iter().all(|made| made.world != base.world));

    let mut placed = base.clone();
    placed.mission.waypoints_m = vec![[1.0, 1.0]];
    let stays = |made: &Scenario| made.world == placed.world && made.mission == placed.mission;
    assert!(all(&placed).iter().all(stays));

    let mut tiled = base.clone();
    let maze = "seed = 1\ncolumns = 5\nrows = 4\nvictims = 3";
    tiled.world.maze = Some(toml::Spanned::new(0..0, toml::from_str(maze).expect("one")));
    let mazes = all(&tiled);
    let seeds = mazes.iter().filter_map(|made| made.world.maze.as_ref());
    let seeds: BTreeSet<u64> = seeds.map(|maze| maze.get_ref().seed).collect();
    assert_eq!(seeds.len(), 20);
}

/// A scenario cannot send orders to a user's program.
#[test]
fn a_program_that_takes_no_orders_gets_none() {
    let text = include_str!("../../scenarios/custom-robot.toml");
    let path = Path::new("custom-robot.toml");
    let (base, source) = Scenario::parse(path, text.to_owned()).expect("sound");
    for seed in 0..20 {
        let made = scenario(
            &base,
            Vary::ALL,
            &Profile::default(),
            &mut Dice::of_seed(seed, "base"),
        );
        assert_eq!(made.mission.waypoints_m, base.mission.waypoints_m);
        let run = engine::run::Run::new(made, &source, None);
        assert!(run.is_ok(), "seed {seed}");
    }
}

#[test]
fn any_bytes_are_a_mission() {
    for bytes in [&[][..], &[0], &[255; 9], &[255; 600]] {
        let made = scenario(
            &base(),
            Vary::ALL,
            &Profile::default(),
            &mut Dice::of_bytes(bytes),
        );
        assert!(!made.mission.waypoints_m.is_empty());
    }
}

#[test]
fn what_is_not_varied_stays() {
    assert_eq!(
        scenario(
            &base(),
            Vary::default(),
            &Profile::default(),
            &mut Dice::of_seed(3, "base")
        ),
        base()
    );
}

fn kinds(seed: u64) -> BTreeSet<&'static str> {
    let made = scenario(
        &base(),
        Vary::ALL,
        &Profile::default(),
        &mut Dice::of_seed(seed, "base"),
    );
    made.fault.iter().map(|fault| fault.kind.name()).collect()
}

/// The rescue robot has links, and devices that support all device faults. Kinds are off in some
/// missions and on in others.
#[test]
fn every_kind_of_fault_comes_up() {
    let missions: Vec<_> = (0..400).map(kinds).collect();
    let with = missions[..200].iter().filter(|kinds| kinds.contains("cut"));
    let with = with.count();
    assert!(
        (10..190).contains(&with),
        "{with} of 200 missions have cuts"
    );
    let seen: BTreeSet<&str> = missions.into_iter().flatten().collect();
    let all: BTreeSet<&str> = FaultKind::ALL.iter().map(|kind| kind.name()).collect();
    assert_eq!(seen, all);
}

/// Links and devices are those of the robot as the scenario equips it.
#[test]
fn a_display_is_disturbed_if_there_is_one() {
    let mut fitted = base();
    let display = toml::from_str("[touch-panel]").expect("a display");
    fitted.device.insert("display".to_owned(), display);
    let places = |base: &Scenario| -> BTreeSet<String> {
        let made = |seed| {
            scenario(
                base,
                Vary::ALL,
                &Profile::default(),
                &mut Dice::of_seed(seed, "base"),
            )
        };
        let faults = (0..50).flat_map(|seed| made(seed).fault);
        faults.filter_map(|fault| fault.link).collect()
    };
    let [without, with] = [places(&base()), places(&fitted)];
    assert_eq!(Vec::from_iter(without), ["base", "lidar", "pc", "radio"]);
    assert_eq!(
        Vec::from_iter(with),
        ["base", "display", "lidar", "pc", "radio"]
    );
}

/// The registers of a chip are neither garbled nor late; the quantities behind them may have
/// faults.
#[test]
fn registers_of_the_chip_are_no_wire() {
    let mut other = base();
    other.robot = "yellow".into();
    let made = |seed| {
        scenario(
            &other,
            Vary::ALL,
            &Profile::default(),
            &mut Dice::of_seed(seed, "base"),
        )
    };
    let all: Vec<Scenario> = (0..100).map(made).collect();
    assert!(all.iter().all(|made| !made.link.contains_key("board")));
    let faults = || all.iter().flat_map(|made| &made.fault);
    let links: BTreeSet<_> = faults()
        .flat_map(|fault| [&fault.link, &fault.with])
        .flatten()
        .map(String::as_str)
        .collect();
    assert_eq!(Vec::from_iter(links), ["lidar", "telemetry"]);
    let of_board = faults().filter(|fault| fault.device.as_deref() == Some("board"));
    let kinds: BTreeSet<_> = of_board.map(|fault| fault.kind.name()).collect();
    assert!(
        kinds.contains("stuck") && !kinds.contains("delayed"),
        "{kinds:?}"
    );
}

/// A robot cannot detect that its lidar is mounted differently, or that a sensor overlooks an
/// object. The first fault never occurs, the second for at most half a second.
#[test]
fn no_sensor_deceives_for_long() {
    let mut other = base();
    other.robot = "yellow".into();
    let made = |seed| {
        scenario(
            &other,
            Vary::ALL,
            &Profile::default(),
            &mut Dice::of_seed(seed, "base"),
        )
    };
    let faults: Vec<_> = (0..300).flat_map(|seed| made(seed).fault).collect();
    let called = |name: &'static str| {
        let faults = faults.iter();
        faults.filter(move |fault| fault.fault.as_deref() == Some(name))
    };
    assert_eq!(called("turned").chain(called("mirrored")).count(), 0);
    let lasts = |fault: &FaultSpec| {
        let window = fault
            .from
            .zip(fault.until)
            .map(|(from, until)| until.0 - from.0);
        window
            .or(fault.lasting.map(|lasting| lasting.0))
            .expect("it ends")
    };
    let longest = called("blind").map(lasts).max().expect("it comes");
    assert!(longest <= Duration::from_millis(500), "{longest:?}");
}

/// A generated scenario is valid, and reading its file gives the same scenario.
#[test]
fn a_mission_survives_its_file() {
    for seed in 0..100 {
        let made = scenario(
            &base(),
            Vary::ALL,
            &Profile::default(),
            &mut Dice::of_seed(seed, "base"),
        );
        let text = made.to_toml();
        let (read, source) = Scenario::parse(Path::new("<made>"), text).expect("sound");
        assert_eq!(read.to_toml(), made.to_toml(), "seed {seed}");
        let run = engine::run::Run::new(read, &source, None);
        assert!(
            run.is_ok(),
            "seed {seed}: {}",
            run.err().expect("it is none")
        );
    }
}

/// A map keeps the errors of a sensor that was wrong while it was drawn. An error of 25 cm, which
/// exists to test decoders, does not occur.
#[test]
fn no_map_is_judged_that_a_wrong_sensor_began() {
    let vary = Vary {
        faults: true,
        ..Vary::default()
    };
    let mut base = base();
    base.expect.wall_overlap_min = Some(0.8);
    let mut wrong = 0;
    for seed in 0..100 {
        let made = scenario(
            &base,
            vary,
            &Profile::default(),
            &mut Dice::of_seed(seed, "base"),
        );
        let is_wrong = made
            .fault
            .iter()
            .any(|fault| fault.kind == FaultKind::Wrong);
        let asked = made.expect.wall_overlap_min;
        let expected = (!is_wrong).then_some(0.5);
        assert_eq!(asked, expected, "seed {seed}");
        wrong += u32::from(is_wrong);
        let mut own = made.fault.iter().filter_map(|fault| fault.fault.as_deref());
        assert!(own.all(|name| name != "dense-starts"), "seed {seed}");
    }
    assert!(wrong > 0);
}

/// Generator 2 computed this value. If it changes, stored campaigns cannot be continued:
/// [`GENERATOR`] must grow.
#[test]
fn gentle_draws_what_was_drawn_before() {
    let mut sum = 0xcbf2_9ce4_8422_2325_u64;
    for seed in 0..20 {
        let gentle = Profile::default();
        let mut made = scenario(
            &base(),
            Vary::ALL,
            &gentle,
            &mut Dice::of_seed(seed, "base"),
        );
        // The judgement of violations is newer than this value, and draws no random number.
        if made.expect.violations_from.take().is_some() {
            made.expect.violations_max = None;
        }
        for byte in made.to_toml().bytes() {
            sum = (sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
    assert_eq!((GENERATOR, sum), (2, 3_868_069_943_777_180_385));
}

/// With the profile harsh, faults occur in the whole run except its last 12 s, and some are
/// permanent. The scenario lists faults that are not healed. Without faults the scenario's own
/// expectations apply.
#[test]
fn harsh_faults_come_at_any_time_and_a_core_is_healed() {
    let harsh = Profile::find("harsh").expect("it is built in");
    let mut base = base();
    base.duration = Span::from_millis(90_000);
    let (mut late, mut for_good, mut broken, mut without, mut long) = (0, 0, 0, 0, 0);
    let (mut cycles, mut alone) = (0, 0);
    for seed in 0..200 {
        let made = scenario(&base, Vary::ALL, &harsh, &mut Dice::of_seed(seed, "base"));
        let safety = made.expect.safety.as_ref().expect("it is always judged");
        assert!(safety.rests_within.is_some() && safety.true_telemetry);
        if made.fault.is_empty() && made.expect.visit_within_mm.is_none() {
            // An operator alone disturbs the run.
            alone += 1;
            assert!(made.mission.step.len() > 3);
            continue;
        }
        if made.fault.is_empty() {
            without += 1;
            let is_long = made.duration > Span::from_millis(300_000);
            // A long run is judged at its end, and must still carry bytes then.
            let [ends, returns, lives] = [
                made.mission.to_the_end,
                made.expect.return_within_mm.is_some(),
                safety.alive_for.is_some(),
            ];
            assert_eq!([ends, returns, lives], [is_long; 3], "seed {seed}");
            long += u32::from(is_long);
            continue;
        }
        let healed = Some(Span::from_millis(48_000));
        assert_eq!(made.duration, Span::from_millis(60_000));
        assert!(made.mission.to_the_end && made.expect.visit_within_mm.is_none());
        for fault in &made.fault {
            assert_eq!(fault.check(), Ok(()), "{fault:?}");
            // The power cycle of a device whose console may be open.
            if fault.kind == FaultKind::Restart && fault.from == healed {
                assert_eq!(fault.device.as_deref(), Some("lidar"));
                cycles += 1;
                continue;
            }
            late += u32::from(fault.from > Some(Span::from_millis(20_000)));
            for_good += u32::from(fault.until == healed);
            match fault.until {
                Some(until) => assert!(until <= Span::from_millis(48_000), "{fault:?}"),
                None => {
                    broken += 1;
                    assert!(!safety.alive_without.is_empty());
                }
            }
        }
    }
    assert!(
        late > 100 && for_good > 100,
        "{late} late, {for_good} for good"
    );
    assert!(cycles > 20, "{cycles} power cycles");
    assert!((20..140).contains(&broken), "{broken} not healed");
    assert!((20..60).contains(&without), "{without} without a fault");
    assert!((1..12).contains(&long), "{long} long runs");
    assert!((10..50).contains(&alone), "{alone} with an operator alone");
}

/// The link that becomes silent counts as one of the faults, and is left out if the profile has no
/// cuts. The scenario's own phases are removed, and its own broken links stay excused.
#[test]
fn the_added_cut_keeps_to_the_profile() {
    let mut base = base();
    base.duration = Span::from_millis(90_000);
    let mut safety = Profile::find("harsh").expect("built in").judge.safety;
    let own = safety.as_mut().expect("it judges safety");
    own.alive_without = vec!["radio".to_owned()];
    base.expect.safety = safety;
    base.phases = Some(PhasesSpec {
        warm_up: Span::from_millis(5_000),
        adversity: Span::from_millis(9_000),
        recovery: Span::from_millis(6_000),
        judgement: Span::from_millis(4_000),
    });
    let made = |change: fn(&mut Profile)| {
        let mut profile = Profile::find("harsh").expect("it is built in");
        profile.faults.needed_link_percent = 100;
        change(&mut profile);
        let mut made = Vec::new();
        for seed in 0..40 {
            let dice = &mut Dice::of_seed(seed, "base");
            made.push(scenario(&base, Vary::ALL, &profile, dice));
        }
        made
    };
    let is_cut = |made: &Scenario| made.fault.iter().any(|fault| fault.kind == FaultKind::Cut);
    let one = made(|profile| profile.faults.count_max = 1);
    assert!(one.iter().all(|made| made.fault.len() < 2));
    assert!(one.iter().filter(|made| is_cut(made)).count() > 20);
    let never = made(|profile| profile.faults.never = vec!["cut".to_owned()]);
    assert!(!never.iter().any(is_cut));
    for made in never.iter().filter(|made| !made.fault.is_empty()) {
        let safety = made.expect.safety.as_ref().expect("it is judged");
        assert!(safety.alive_without.contains(&"radio".to_owned()));
        assert_eq!(made.phases, None);
    }
    let none = made(|profile| profile.faults.count_max = 0);
    assert!(none.iter().all(|made| made.fault.is_empty()));
}

/// The links that the scenario names fall silent in place of those of its robot.
#[test]
fn links_of_rests_without_fall_silent() {
    let mut profile = Profile::find("harsh").expect("it is built in");
    (profile.faults.needed_link_percent, profile.faults.count_max) = (100, 1);
    let mut base = base();
    base.duration = Span::from_millis(90_000);
    let links = |base: &Scenario| {
        let made =
            (0..40).map(|seed| scenario(base, Vary::ALL, &profile, &mut Dice::of_seed(seed, "b")));
        let links = made
            .flat_map(|made| made.fault)
            .filter_map(|fault| fault.link);
        links.collect::<BTreeSet<String>>()
    };
    assert_eq!(
        links(&base),
        BTreeSet::from(["base", "lidar", "radio"].map(str::to_owned))
    );
    let mut safety = profile.judge.safety.clone();
    let own = safety.as_mut().expect("it judges safety");
    own.rests_without = vec!["base".to_owned()];
    base.expect.safety = safety;
    assert_eq!(links(&base), BTreeSet::from(["base".to_owned()]));
}

/// Unusual orders and frames of harsh keep to the limits of the station, so that each mission can
/// be wired; empty and long lists, modes and frames come up.
#[test]
fn unusual_orders_come_up_and_can_be_wired() {
    let mut profile = Profile::find("harsh").expect("it is built in");
    (
        profile.mission.odd_orders_percent,
        profile.mission.forged_percent,
    ) = (100, 100);
    let mut base = base();
    base.duration = Span::from_millis(90_000);
    let (base, source) = Scenario::from_text(&base.to_toml()).expect("sound");
    let mut seen = BTreeSet::new();
    for seed in 0..40 {
        let made = scenario(&base, Vary::ALL, &profile, &mut Dice::of_seed(seed, "base"));
        for step in &made.mission.step {
            seen.insert(match &step.action {
                Action::WaypointsM(places) if places.is_empty() => "empty",
                Action::WaypointsM(places) if places.len() >= 18 => "long",
                Action::Mode(_) => "mode",
                Action::Inject(_) => "frame",
                _ => "other",
            });
        }
        let wired = engine::run::Run::new(made, &source, None);
        assert!(wired.is_ok(), "seed {seed}");
    }
    let expected = ["empty", "frame", "long", "mode", "other"];
    assert_eq!(seen, BTreeSet::from(expected));
}

/// An operator who uses everything: drives, many orders within a second, poses, a station that
/// leaves during a drive and comes back. Each mission can be wired, and the acts end before the
/// last phase. Alone, the operator adds no fault.
#[test]
fn an_operator_uses_everything_that_the_station_offers() {
    let mut profile = Profile::find("harsh").expect("it is built in");
    profile.faults.without_percent = 0;
    (
        profile.mission.operator_percent,
        profile.mission.operator_alone_percent,
    ) = (100, 100);
    let text = "schema = 1\nname = \"by-hand\"\nrobot = \"yellow\"\nduration = \"90s\"\n\
        [[mission.step]]\nat = \"1s\"\ndo = { mode = \"map\" }\n\
        [world]\nstart = { x_m = 0.5, y_m = 0.5, heading_deg = 0 }\n\
        [[world.wall]]\npath_m = [[0, 0], [1.5, 0], [1.5, 1.4], [0, 1.4], [0, 0]]\n";
    let (base, source) = Scenario::from_text(text).expect("sound");
    let (mut seen, mut at_once) = (BTreeSet::new(), 0);
    for seed in 0..40 {
        let mut dice = Dice::of_seed(seed, "by-hand");
        let made = super::scenario(&base, &source, Vary::ALL, &profile, &mut dice);
        assert!(made.fault.is_empty(), "seed {seed}");
        let mut drives = Vec::new();
        for step in &made.mission.step {
            assert!(step.at < Some(Span::from_millis(56_000)), "{step:?}");
            seen.insert(match &step.action {
                Action::Drive(_) => {
                    drives.extend(step.at);
                    "drive"
                }
                Action::Disconnect => "leaves",
                Action::Mode(mode) if mode.starts_with("go-to ") => "goal",
                Action::Mode(mode) if mode == "stop" => "stop",
                _ => "other",
            });
        }
        let second = Duration::from_secs(1);
        let many = drives
            .windows(5)
            .filter(|five| five[4].0 - five[0].0 < second);
        at_once += many.count();
        let wired = engine::run::Run::new(made, &source, None);
        assert!(wired.is_ok(), "seed {seed}");
    }
    let expected = ["drive", "goal", "leaves", "other", "stop"];
    assert_eq!(seen, BTreeSet::from(expected));
    assert!(at_once > 0);
    profile.mission.operator_alone_percent = 0;
    let noisy = (0..40).filter(|&seed| {
        let mut dice = Dice::of_seed(seed, "by-hand");
        let made = super::scenario(&base, &source, Vary::ALL, &profile, &mut dice);
        let flips = |fault: &FaultSpec| {
            fault.kind == FaultKind::Flip && fault.link.as_deref() == Some("telemetry")
        };
        made.fault.iter().any(flips)
    });
    assert!(noisy.count() > 10, "drives by hand under noise");
}

/// Scenarios of one campaign get different faults from one seed: ten scenarios are ten samples.
#[test]
fn two_scenarios_get_other_faults_from_one_seed() {
    let profile = Profile::find("harsh").expect("it is built in");
    let differ = (0..20).filter(|&seed| {
        let made = ["one", "other"].map(|name| {
            let mut dice = Dice::of_seed(seed, name);
            scenario(&base(), Vary::ALL, &profile, &mut dice)
        });
        made[0].fault != made[1].fault
    });
    assert!(differ.count() >= 18);
}

/// The car's board has no watchdog: from the first fault of more than 0.3 s that keeps commands
/// from it, contacts are not judged. The rescue robot's base stops by itself.
#[test]
fn a_drive_that_runs_on_excuses_contacts() {
    let harsh = Profile::find("harsh").expect("it is built in");
    let made = |robot: &str, seed| {
        let mut base = base();
        base.robot = robot.into();
        scenario(&base, Vary::ALL, &harsh, &mut Dice::of_seed(seed, "base"))
    };
    let starts = |made: &Scenario, link: &str| {
        let cut = |fault: &&FaultSpec| {
            let (from, until) = (fault.from.unwrap_or_default(), fault.until);
            let is_long = until.is_none_or(|until| until.0 - from.0 > Duration::from_millis(300));
            let is_of_drive = fault.link.as_deref() == Some(link);
            is_of_drive && is_long && fault.kind == FaultKind::Unplugged
        };
        let faults = made.fault.iter().filter(cut);
        faults.map(|fault| fault.from.unwrap_or_default()).min()
    };
    let until = |made: &Scenario| made.expect.safety.as_ref().and_then(|it| it.contacts_until);
    let (mut of_car, mut of_base) = (0, 0);
    for seed in 0..200 {
        let car = made("apollo13", seed);
        if let Some(start) = starts(&car, "car") {
            of_car += 1;
            assert!(
                until(&car).is_some_and(|until| until <= start),
                "seed {seed}"
            );
        }
        let base = made("rescue", seed);
        of_base += u64::from(starts(&base, "base").is_some() && until(&base).is_none());
    }
    assert!(of_car > 3 && of_base > 3, "{of_car} {of_base}");
}

/// Faults may stop the first robot in the path of another one, whose task is not judged then. Its
/// contacts and broken rules are.
#[test]
fn the_others_of_a_team_have_no_task_behind_faults() {
    let harsh = Profile::find("harsh").expect("it is built in");
    let text = base().to_toml()
        + "[team.blue]\nrobot = \"rescue\"\nstart = { x_m = 0.8, y_m = 0.8, heading_deg = 0 }\n\
           [team.blue.mission]\nwaypoints_m = [[1.0, 1.0]]\n[team.blue.expect]\n\
           visit_within_mm = 100\nviolations_max = 3\n";
    let base = Scenario::from_text(&text).expect("sound").0;
    let mut judged = 0;
    for seed in 0..40 {
        let made = scenario(&base, Vary::ALL, &harsh, &mut Dice::of_seed(seed, "base"));
        let expect = &made.team["blue"].expect;
        assert_eq!(expect.violations_max, Some(3), "seed {seed}");
        let safety = expect.safety.as_ref();
        let may_wait = safety.is_some_and(|safety| safety.steps_may_wait);
        let is_judged = expect.visit_within_mm == Some(100.0);
        assert_ne!(is_judged, may_wait, "seed {seed}");
        assert!(may_wait || made.fault.is_empty(), "seed {seed}");
        judged += u64::from(is_judged);
    }
    assert!((5..20).contains(&judged), "{judged}");
}
