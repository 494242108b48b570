//! Signs of a defect at the end of a run.

use emulators::pc::Pc;
use firmware_core::Inspect;
use hilrig::robots::instruments::in_metres;
use hilrig::run::Run;
use protocols::pcui::message::Mode;

use super::program;

fn counter(run: &Run, name: &str) -> u64 {
    let mut found = None;
    program(run).counters(&mut |known, value| {
        if known == name {
            found = Some(value);
        }
    });
    found.unwrap_or_else(|| panic!("no counter {name}"))
}

fn pc(run: &Run) -> &Pc {
    run.rig.device("pc").expect("the PC is emulated")
}

pub(super) fn memory_is_hurt(run: &Run) -> bool {
    let mut writes = 0;
    program(run).stray_writes(&mut |_, stray| writes += stray.count);
    writes > 0
}

pub(super) fn encoders_jump(run: &Run) -> bool {
    counter(run, "encoder readings disbelieved") > 0
}

pub(super) fn base_is_believed(run: &Run) -> bool {
    counter(run, "base failures") > 0 && counter(run, "base silences") == 0
}

pub(super) fn base_complains(run: &Run) -> bool {
    run.rig
        .events()
        .iter()
        .any(|event| event.source == "base" && event.is_violation())
}

pub(super) fn battery_is_empty(run: &Run) -> bool {
    program(run)
        .battery()
        .is_some_and(|battery| battery.percent == 0)
}

/// A speed of 226 mm/s is reported as 2.
pub(super) fn speed_is_told_in_tenths(run: &Run) -> bool {
    let (_, state) = pc(run).record().state.expect("five a second");
    state.speed.iter().any(|ticks| *ticks > 8) && state.speed_mm_s.iter().all(|speed| *speed < 10)
}

pub(super) fn no_scan(run: &Run) -> bool {
    counter(run, "scans") == 0
}

/// Cells near the edge of the map are known, 200 mm behind the walls.
pub(super) fn draws_beyond_the_walls(run: &Run) -> bool {
    let map = program(run).map().expect("it has one");
    let cell = |at: usize| map.get(if at < 300 { 5 } else { 294 }, at % 300);
    (0..600).any(|at| cell(at) != Some(127))
}

/// One packet of four is lost. If packet 0 ends a turn, one turn of four is lost: of 36 in 8 s.
pub(super) fn turns_are_lost(run: &Run) -> bool {
    counter(run, "lidar turns") < 33
}

pub(super) fn pc_hears_nothing(run: &Run) -> bool {
    let (at, _) = pc(run).record().state.expect("five a second");
    (run.rig.now() - at).as_secs() >= 2
}

/// Seven candidates for a frame are bad, because the PC connects in the middle of a frame.
pub(super) fn pc_hears_noise(run: &Run) -> bool {
    pc(run).record().counts.bad_frames > 50 || pc(run).record().text_bytes() > 2_000
}

pub(super) fn moves(run: &Run) -> bool {
    run.rig.world.is_moving()
}

pub(super) fn scan_takes_long(run: &Run) -> bool {
    run.rig.last_cost().expect("in this process").as_millis() > 400
}

fn cells_above(run: &Run, value: u8) -> usize {
    let map = program(run).map().expect("it has one");
    let cells = map.cells();
    cells.iter().filter(|&&cell| cell > value).count()
}

/// The first scans are those of a robot at rest: about four, with weight 10, together 147.
pub(super) fn only_what_it_saw_at_rest(run: &Run) -> bool {
    cells_above(run, 165) == 0
}

pub(super) fn hardly_a_wall_in_the_map(run: &Run) -> bool {
    cells_above(run, 165) < 300
}

/// The ceiling of weight 10 is 230.
pub(super) fn no_black_in_the_map(run: &Run) -> bool {
    cells_above(run, 230) == 0
}

fn error_mm(run: &Run) -> f64 {
    let (now, truth) = (run.rig.now(), run.rig.world.pose());
    in_metres(program(run).pose_at(now))
        .point()
        .distance(truth.point())
        * 1000.0
}

pub(super) fn believes_wrong(run: &Run) -> bool {
    error_mm(run) > 60.0
}

pub(super) fn is_lost(run: &Run) -> bool {
    error_mm(run) > 200.0
}

pub(super) fn has_ended(run: &Run) -> bool {
    program(run).is_dead()
}

pub(super) fn phantoms(run: &Run) -> bool {
    let all = program(run).waypoints().all();
    all.iter().filter(|one| one.position_mm == [0, 0]).count() > 40
}

/// The room's robot starts at (1.5, 1.2).
pub(super) fn stays_on_the_spot(run: &Run) -> bool {
    let pose = run.rig.world.pose();
    libm::hypot(pose.x - 1.5, pose.y - 1.2) < 0.1
}

pub(super) fn no_waypoints(run: &Run) -> bool {
    program(run).waypoints().is_empty()
}

/// The stored bytes are not a complete frame.
pub(super) fn half_a_list(run: &Run) -> bool {
    counter(run, "radio bad frames") > 0
}

pub(super) fn target_is_nowhere(run: &Run) -> bool {
    program(run)
        .target()
        .is_some_and(|target| target.position_mm == [-1, -1])
}

pub(super) fn explores(run: &Run) -> bool {
    program(run).mode() == Mode::Exploration
}

pub(super) fn hand_is_forgotten(run: &Run) -> bool {
    program(run).set_point() != [10, -10]
}

pub(super) fn hand_is_obeyed(run: &Run) -> bool {
    program(run).set_point() == [10, -10]
}

pub(super) fn turned_right(run: &Run) -> bool {
    run.rig.world.pose().theta < -0.6
}
