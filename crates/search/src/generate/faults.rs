use super::dice::Draw;
use super::fault_targets::{Device, FaultTargets};
use super::{ADVERSITY_FROM_MS, ADVERSITY_UNTIL_MS, mission};
use engine::scenario::{
    Action, BudgetSpec, DirectionSpec, FaultKind, FaultPlace, FaultSpec, PhasesSpec, Scenario,
    Span, Step, WhenSpec,
};

/// Maximum number of faults of a mission.
const FAULTS_MAX: u64 = 12;
/// Chances per byte, from one in ten thousand to one in thirty.
const RATES: [f64; 6] = [0.0001, 0.0003, 0.001, 0.003, 0.01, 0.03];
/// Rates at which a sender runs instead of its own.
const BAUDS: [u32; 7] = [9_600, 38_400, 57_600, 111_111, 230_400, 921_600, 1_040_000];
/// Factors by which a device measures wrongly. By more, what it says contradicts nothing that the
/// robot knows, and leads any robot astray: into walls, or into a map of another size.
const FACTORS: [f64; 4] = [0.98, 0.99, 1.01, 1.02];
/// Longest time for which something may get through nothing at all, milliseconds.
const SILENCE_MAX_MS: u64 = 3_000;
/// Longest time for which something may seem to stand still that moves: the mapper follows what the
/// wheels say, and a turn of more than 12 degrees that they do not tell of is beyond its search.
const STUCK_MAX_MS: u64 = 500;
/// Longest time for which something may be bad otherwise.
const TROUBLE_MAX_MS: u64 = 12_000;
/// Longest time of what comes unforeseen: there must be time to recover from it, too.
const SURPRISE_MAX_MS: u64 = 2_000;

/// Time before anything goes wrong, if there is such a time.
const WARM_UP_MS: u64 = 5_000;
/// How near a waypoint is passed, or the last one come to rest at, is no matter of precision while
/// something is wrong: a map that is begun with a lidar that is 2 % off stays so, 60 mm for walls
/// 3 m away. Millimetres.
const WITHIN_MM: f64 = 150.0;

/// The same if an operator steers by hand through the mission's script: an order one second late
/// also acts one second later, and the robot has no means to correct for that.
const BY_HAND_WITHIN_MM: f64 = 400.0;
/// And where it rests if the order to stop came late as well.
const BY_HAND_REST_MM: f64 = 800.0;

/// With phases the robot is at work before anything goes wrong, and must be again afterwards.
const PHASES: PhasesSpec = PhasesSpec {
    warm_up: Span::from_millis(WARM_UP_MS),
    adversity: Span::from_millis(ADVERSITY_UNTIL_MS - WARM_UP_MS),
    recovery: Span::from_millis(6_000),
    judgement: Span::from_millis(4_000),
};

/// All that goes wrong in a mission.
pub(super) struct Adversity {
    faults: Vec<FaultSpec>,
    budget: Option<BudgetSpec>,
    phases: Option<PhasesSpec>,
}

impl Adversity {
    /// Whole kinds are off in some missions and on in others.
    pub(super) fn draw(targets: &FaultTargets, places: &[[f64; 2]], dice: &mut Draw) -> Self {
        let phases = (dice.below(3) == 1).then_some(PHASES);
        let budget = (dice.below(4) == 1).then(|| BudgetSpec {
            total: Some(dice.between(1, 200)),
            at_once: (dice.below(2) == 1).then(|| dice.narrow(1, 5)),
        });
        let kinds = some_kinds(targets, dice);
        let count = dice.below(FAULTS_MAX + 1);
        let mut faults = Vec::new();
        for _ in 0..count.min(kinds.len() as u64 * FAULTS_MAX) {
            let kind = kinds[dice.index(kinds.len())];
            let mut fault = somewhere(kind, targets, dice);
            detail(&mut fault, targets, dice);
            let is_lasting = targets.consoles().any(|(link, _)| reaches(&fault, link));
            if phases.is_some() || is_lasting || dice.below(5) > 0 {
                foreseen(&mut fault, phases.is_some(), dice);
            } else {
                unforeseen(&mut fault, targets, places, dice);
            }
            faults.push(fault);
        }
        for (link, device) in targets.consoles() {
            if faults.iter().any(|fault| reaches(fault, link)) {
                faults.push(switched_off_and_on(device));
            }
        }
        Self {
            faults,
            budget,
            phases,
        }
    }

    /// Lets it happen in `mission`, which must succeed within `recovery` afterwards.
    pub(super) fn apply(self, mission: &mut Scenario, recovery: Span) {
        let recovery = mission.duration.max(recovery);
        mission.duration = Span(Span::from_millis(ADVERSITY_UNTIL_MS).0 + recovery.0);
        if mission::takes_orders(mission) {
            let once_more = mission::once_more(&mission.mission);
            mission.mission.step.extend(once_more);
        }
        mission.fault = self.faults;
        mission.budget = self.budget;
        mission.phases = self.phases;
        // A bad line is not the fault of the sender, and this case does not judge where the robot
        // believes to be while it cannot see.
        mission.expect.violations_max = None;
        let is_by_hand = |step: &Step| matches!(step.action, Action::Drive(_));
        let [visit_mm, rest_mm] = match mission.mission.step.iter().any(is_by_hand) {
            true => [BY_HAND_WITHIN_MM, BY_HAND_REST_MM],
            false => [WITHIN_MM; 2],
        };
        let expect = &mut mission.expect;
        expect.visit_within_mm = expect.visit_within_mm.map(|mm| mm.max(visit_mm));
        expect.return_within_mm = expect.return_within_mm.map(|mm| mm.max(rest_mm));
        mission.expect.pose_rms_mm_max = None;
        mission.expect.heading_rms_deg_max = None;
        mission.expect.map_received = None;
        // A map that is begun while a lidar is 2 % off stays so: 60 mm for a wall 3 m away. An
        // unreported motion of 10 cm in a corridor lies between all walls before and behind.
        let is_wrong = |fault: &FaultSpec| fault.kind == FaultKind::Wrong;
        let asked = mission.expect.wall_overlap_min;
        mission.expect.wall_overlap_min = match mission.fault.iter().any(is_wrong) {
            true => None,
            false => asked.map(|share| share.min(WALLS_MIN)),
        };
    }
}

/// Of a map that was drawn while something failed so much is asked at most.
const WALLS_MIN: f64 = 0.5;

/// A quarter, a half or three quarters of the kinds. Eight of them are chosen by two numbers, so
/// that a short string of bytes still says something about what goes wrong.
fn some_kinds(targets: &FaultTargets, dice: &mut Draw) -> Vec<FaultKind> {
    let all: Vec<FaultKind> = targets.kinds().collect();
    let share = dice.below(3);
    let mut enabled = Vec::new();
    for eight in all.chunks(8) {
        let [a, b] = [dice.below(256), dice.below(256)];
        let off = [a | b, a, a & b][usize::try_from(share).expect("below 3")];
        let on = |(bit, _): &(usize, &FaultKind)| off >> bit & 1 == 0;
        enabled.extend(eight.iter().enumerate().filter(on).map(|(_, kind)| *kind));
    }
    enabled
}

/// Whether it puts something on the wire to the device of `link`.
fn reaches(fault: &FaultSpec, link: &str) -> bool {
    let is_to = |way| fault.direction == Some(way);
    let comes_back = fault.kind == FaultKind::Echo && is_to(DirectionSpec::ToMaster);
    let is_on = fault.link.as_deref() == Some(link) || fault.with.as_deref() == Some(link);
    is_on && (is_to(DirectionSpec::ToDevice) || comes_back)
}

/// Power cycle, as a person does it, of a device that does not recover by itself.
fn switched_off_and_on(device: &str) -> FaultSpec {
    FaultSpec {
        device: Some(device.to_owned()),
        from: Some(Span::from_millis(ADVERSITY_UNTIL_MS)),
        until: Some(Span::from_millis(ADVERSITY_UNTIL_MS + 100)),
        ..FaultSpec::new(FaultKind::Restart)
    }
}

/// A fault of `kind` on something that can have it.
fn somewhere(kind: FaultKind, targets: &FaultTargets, dice: &mut Draw) -> FaultSpec {
    let devices = targets.devices(kind);
    match kind.place() {
        FaultPlace::Line => {
            let lanes = targets.lanes();
            let (link, direction) = lanes[dice.index(lanes.len())];
            FaultSpec::on(link, direction, kind)
        }
        FaultPlace::Device => FaultSpec {
            device: Some(devices[dice.index(devices.len())].name.clone()),
            ..FaultSpec::new(kind)
        },
        FaultPlace::Devices => {
            // One of them keeps its supply, if there are more than two.
            let spared = dice.index(devices.len());
            let dips = |&(index, _): &(usize, &&Device)| devices.len() == 2 || index != spared;
            let names = devices.iter().enumerate().filter(dips);
            FaultSpec {
                devices: Some(names.map(|(_, device)| device.name.clone()).collect()),
                ..FaultSpec::new(kind)
            }
        }
    }
}

/// The keys that only some kinds have.
fn detail(fault: &mut FaultSpec, targets: &FaultTargets, dice: &mut Draw) {
    use FaultKind as K;
    let kind = fault.kind;
    if kind.is_strike() {
        fault.rate = Some(RATES[dice.index(RATES.len())]);
        fault.count = (dice.below(4) == 1).then(|| dice.narrow(1, 20));
    }
    let mut millis = |most| Some(Span::from_millis(dice.between(1, most)));
    match kind {
        K::Idle => fault.by = millis(50),
        K::Latency | K::Delayed => fault.by = millis(300),
        K::Jitter => fault.by = millis(100),
        K::Burst => fault.len = Some(dice.narrow(1, 16)),
        K::Truncate => fault.len = (dice.below(2) == 1).then(|| dice.narrow(1, 40)),
        K::Overrun => fault.fifo = Some(dice.narrow(1, 64)),
        K::ShortRead => fault.len = Some(dice.narrow(1, 8)),
        K::Wrong => fault.factor = Some(FACTORS[dice.index(FACTORS.len())]),
        K::WrongBaud => match dice.below(3) {
            0 => fault.baud = Some(BAUDS[dice.index(BAUDS.len())]),
            1 => fault.ppm = Some(dice.between(0, 120_000) as f64 - 60_000.0),
            _ => fault.ppm_per_s = Some(dice.between(0, 40_000) as f64 - 20_000.0),
        },
        K::Swizzle => {
            let others: Vec<&str> = targets
                .links()
                .filter(|&link| fault.link.as_deref() != Some(link))
                .collect();
            fault.with = Some(others[dice.index(others.len())].to_owned());
        }
        K::Device => {
            let mut all = targets.devices(kind).into_iter();
            let name = fault.device.as_deref();
            let device = all.find(|device| Some(device.name.as_str()) == name);
            let own: Vec<&str> = device.into_iter().flat_map(Device::of_its_own).collect();
            fault.fault = Some(own[dice.index(own.len())].to_owned());
        }
        _ => {}
    }
}

/// Whether nothing sensible gets through, rather than less.
fn silences(kind: FaultKind) -> bool {
    use FaultKind as K;
    matches!(
        kind,
        K::Cut
            | K::Unplugged
            | K::Break
            | K::Stall
            | K::Overrun
            | K::WrongBaud
            | K::Swizzle
            | K::PowerDip
            | K::Off
    )
}

/// Whether something that is there seems not to be, or to stand still: a robot can know no better,
/// and one that does not steer hits what it was to pass.
fn is_deceived(fault: &FaultSpec) -> bool {
    let name = fault.fault.as_deref().unwrap_or_default();
    fault.kind == FaultKind::Stuck || ["blind", "servo"].contains(&name)
}

/// Whether it comes and goes by its nature.
fn comes_in_spells(kind: FaultKind) -> bool {
    matches!(kind, FaultKind::Clog | FaultKind::Intermittent)
}

/// Times that are known beforehand.
fn foreseen(fault: &mut FaultSpec, is_late: bool, dice: &mut Draw) {
    let earliest = [ADVERSITY_FROM_MS, WARM_UP_MS][usize::from(is_late)];
    let most = match fault.kind {
        _ if is_deceived(fault) => STUCK_MAX_MS,
        kind if silences(kind) => SILENCE_MAX_MS,
        _ => TROUBLE_MAX_MS,
    };
    let from = dice.between(earliest, ADVERSITY_UNTIL_MS - 100);
    let until = (from + dice.between(10, most)).min(ADVERSITY_UNTIL_MS);
    fault.from = Some(Span::from_millis(from));
    fault.until = Some(Span::from_millis(until));
    if comes_in_spells(fault.kind) || dice.below(6) == 1 {
        spells(fault, dice);
    }
}

/// Comes again and again.
fn spells(fault: &mut FaultSpec, dice: &mut Draw) {
    let every = dice.between(50, 2_000);
    fault.every = Some(Span::from_millis(every));
    fault.lasting = Some(Span::from_millis(dice.between(1, every)));
}

/// Waits for a byte, a frame, a place or a register.
fn unforeseen(fault: &mut FaultSpec, targets: &FaultTargets, places: &[[f64; 2]], dice: &mut Draw) {
    if comes_in_spells(fault.kind) {
        return foreseen(fault, false, dice);
    }
    let most = if is_deceived(fault) {
        STUCK_MAX_MS
    } else {
        SURPRISE_MAX_MS
    };
    fault.lasting = Some(Span::from_millis(dice.between(10, most)));
    let registers = targets.with_registers();
    match dice.below(4) {
        0 if fault.is_on_line_only() => fault.at_byte = Some(dice.below(20_000)),
        1 if fault.is_on_line_only() => fault.at_frame = Some(dice.below(500)),
        2 if !registers.is_empty() => {
            fault.when = Some(WhenSpec {
                device: Some(registers[dice.index(registers.len())].name.clone()),
                register: Some(dice.narrow(0, 63)),
                at_least: Some(dice.narrow(1, 30)),
                ..WhenSpec::default()
            });
        }
        _ if !places.is_empty() => {
            fault.when = Some(WhenSpec {
                near_m: Some(places[dice.index(places.len())]),
                within_m: Some(dice.between(1, 6) as f64 / 10.0),
                ..WhenSpec::default()
            });
        }
        _ => {
            fault.lasting = None;
            foreseen(fault, false, dice);
        }
    }
}
