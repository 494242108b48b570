mod applied;

use core::time::Duration;

use super::consoles::{reaches, switched_off_and_on};
use super::dice::Draw;
use super::fault_targets::{Device, FaultTargets};
use super::limits::{blinds, comes_in_spells, is_deceived, limit};
use super::profile::{Faults, Profile};
use engine::scenario::{
    BudgetSpec, DirectionSpec, FaultKind, FaultPlace, FaultSpec, PhasesSpec, RegisterName, Span,
    WhenSpec,
};

/// Wrong baud rates of a sender.
const BAUDS: [u32; 7] = [9_600, 38_400, 57_600, 111_111, 230_400, 921_600, 1_040_000];
/// Minimum time before the first fault, if the run is long enough.
const WARM_UP_MS: u64 = 5_000;

/// In a run with phases the robot works before the first fault, and must work again afterwards.
const fn phases(until_ms: u64) -> PhasesSpec {
    PhasesSpec {
        warm_up: Span::from_millis(WARM_UP_MS),
        adversity: Span::from_millis(until_ms - WARM_UP_MS),
        recovery: Span::from_millis(6_000),
        judgement: Span::from_millis(4_000),
    }
}

pub(super) fn millis(span: Span) -> u64 {
    u64::try_from(span.0.as_millis()).unwrap_or(u64::MAX)
}

/// The length of a run with faults, if the scenario takes `duration`.
fn length(profile: &Profile, duration: Span) -> Span {
    let heal = profile.time.heal.unwrap_or_default();
    // Faults need some time before they are healed.
    let least = Span(heal.0 + profile.time.from.0 + LEAST);
    let most = profile.time.length_max.unwrap_or(duration);
    duration.min(most).max(least)
}

/// The end of the last fault, milliseconds, if the scenario takes `duration`.
pub(super) fn end_of_trouble(profile: &Profile, duration: Span) -> u64 {
    let heal = profile.time.heal.unwrap_or_default();
    let before_healing = length(profile, duration).0.saturating_sub(heal.0);
    millis(profile.time.until.unwrap_or(Span(before_healing)))
}

/// Minimum time with faults.
const LEAST: Duration = Duration::from_secs(5);

/// Number of kinds of noise on a noisy link.
const NOISES: usize = 3;

/// All faults of a mission.
pub(super) struct Adversity {
    faults: Vec<FaultSpec>,
    budget: Option<BudgetSpec>,
    phases: Option<PhasesSpec>,
    /// The end of the last fault, milliseconds.
    until_ms: u64,
    /// The length of the run, if the profile limits it.
    length: Span,
    /// Links with faults that are not healed.
    stays_broken: Vec<String>,
    /// Time from which a sensor deceives the robot, or its drive may run on.
    blind_from: Option<Span>,
    /// Whether an operator alone disturbs the mission.
    is_operator: bool,
}

/// The context of drawing faults.
struct Drawn<'a> {
    profile: &'a Profile,
    targets: &'a FaultTargets,
    places: &'a [[f64; 2]],
    until_ms: u64,
}

impl Adversity {
    /// Draws the faults of a mission, which uses only some kinds. `duration` is that of the
    /// scenario.
    pub(super) fn draw(
        profile: &Profile,
        targets: &FaultTargets,
        places: &[[f64; 2]],
        duration: Span,
        dice: &mut Draw,
    ) -> Self {
        let until_ms = end_of_trouble(profile, duration);
        let mut made = Self {
            faults: Vec::new(),
            budget: None,
            phases: None,
            until_ms,
            length: length(profile, duration),
            stays_broken: Vec::new(),
            blind_from: None,
            is_operator: false,
        };
        let without = profile.faults.without_percent;
        if without > 0 && dice.below(100) < without {
            return made;
        }
        let alone = profile.mission.operator_alone_percent;
        if alone > 0 && dice.below(100) < alone {
            made.is_operator = true;
            return made;
        }
        let drawn = Drawn {
            profile,
            targets,
            places,
            until_ms,
        };
        drawn.fill(&mut made, dice);
        let blinds = |fault: &&FaultSpec| {
            blinds(fault, targets.drives(fault.device.as_deref())) || targets.lets_run_on(fault)
        };
        let blinding = made.faults.iter().filter(blinds);
        made.blind_from = blinding.map(|fault| fault.from.unwrap_or_default()).min();
        made
    }

    /// Whether the mission has faults, or the profile judges it as if it had.
    pub(super) fn has_faults(&self) -> bool {
        self.is_operator || !self.faults.is_empty()
    }

    /// Whether an operator alone disturbs it.
    pub(super) const fn is_operator(&self) -> bool {
        self.is_operator
    }
}

impl Drawn<'_> {
    fn fill(&self, made: &mut Adversity, dice: &mut Draw) {
        let (targets, keys) = (self.targets, &self.profile.faults);
        let may_phase = self.profile.time.phases;
        made.phases = (may_phase && dice.below(3) == 1).then(|| phases(self.until_ms));
        made.budget = (dice.below(4) == 1).then(|| BudgetSpec {
            total: Some(dice.between(1, 200)),
            at_once: (dice.below(2) == 1).then(|| dice.narrow(1, 5)),
        });
        let kinds = some_kinds(targets, dice);
        let count = dice.below(keys.count_max + 1);
        let faults = &mut made.faults;
        for _ in 0..count.min(kinds.len() as u64 * keys.count_max) {
            let kind = kinds[dice.index(kinds.len())];
            let mut fault = somewhere(kind, targets, dice);
            self.detail(&mut fault, dice);
            let is_lasting = targets.consoles().any(|(link, _)| reaches(&fault, link));
            let is_late = made.phases.is_some();
            if keys.permanent_percent > 0 && dice.below(100) < keys.permanent_percent {
                self.permanent(&mut fault, dice);
            } else if is_late || is_lasting || !self.profile.time.triggered || dice.below(5) > 0 {
                self.foreseen(&mut fault, is_late, dice);
            } else {
                self.unforeseen(&mut fault, dice);
            }
            faults.push(fault);
        }
        let share = keys.needed_link_percent;
        let may_cut = keys.count_max > 0 && targets.kinds().any(|kind| kind == FaultKind::Cut);
        let needs: Vec<&str> = targets.needs().filter(|_| may_cut).collect();
        if share > 0 && dice.below(100) < share && !needs.is_empty() {
            let link = needs[dice.index(needs.len())];
            // Replaces another fault if the maximum number is reached.
            faults.truncate(usize::try_from(keys.count_max - 1).unwrap_or(usize::MAX));
            let mut fault = FaultSpec::on(link, DirectionSpec::ToMaster, FaultKind::Cut);
            self.permanent(&mut fault, dice);
            faults.push(fault);
        }
        let share = keys.noisy_orders_percent;
        if share > 0 && dice.below(100) < share {
            let orders = targets.orders.link.map(|(link, _)| link);
            self.noise(
                orders.map(|link| (link, DirectionSpec::ToMaster)),
                1,
                faults,
                dice,
            );
        }
        let share = keys.noisy_link_percent;
        if share > 0 && dice.below(100) < share {
            let lanes = targets.lanes();
            let lane = (!lanes.is_empty()).then(|| lanes[dice.index(lanes.len())]);
            self.noise(lane, NOISES, faults, dice);
        }
        if self.profile.afterwards.power_cycle {
            for (link, device) in targets.consoles() {
                if faults.iter().any(|fault| reaches(fault, link)) {
                    faults.push(switched_off_and_on(device, self.until_ms));
                }
            }
        }
        let share = keys.stays_broken_percent;
        if share > 0 && dice.below(100) < share {
            self.leave_one_broken(made, dice);
        }
    }

    /// Adds noise on `lane`: up to `count` of the kinds that the profile allows.
    fn noise(
        &self,
        lane: Option<(&str, DirectionSpec)>,
        count: usize,
        faults: &mut Vec<FaultSpec>,
        dice: &mut Draw,
    ) {
        let count_max = usize::try_from(self.profile.faults.count_max).unwrap_or(usize::MAX);
        let strikes: Vec<_> = self
            .targets
            .kinds()
            .filter(|kind| kind.is_strike())
            .collect();
        let Some((link, direction)) = lane.filter(|_| !strikes.is_empty()) else {
            return;
        };
        let room = count_max.saturating_sub(faults.len());
        for _ in 0..count.min(room) {
            let kind = strikes[dice.index(strikes.len())];
            let mut fault = FaultSpec::on(link, direction, kind);
            self.detail(&mut fault, dice);
            self.foreseen(&mut fault, false, dice);
            faults.push(fault);
        }
    }

    /// Exempts one of the permanent faults from being healed.
    fn leave_one_broken(&self, made: &mut Adversity, dice: &mut Draw) {
        let end = Span::from_millis(self.until_ms);
        let lasts = |fault: &&mut FaultSpec| {
            let is_whole = fault.every.is_none() && fault.lasting.is_none();
            is_whole && fault.until == Some(end) && fault.devices.is_none() && fault.with.is_none()
        };
        let mut lasting: Vec<&mut FaultSpec> = made.faults.iter_mut().filter(lasts).collect();
        if lasting.is_empty() {
            return;
        }
        let fault = lasting.swap_remove(dice.index(lasting.len()));
        fault.until = None;
        let device = self.targets.device(fault.device.as_deref());
        let links = device.map(|device| device.links.clone());
        made.stays_broken = links
            .into_iter()
            .flatten()
            .chain(fault.link.clone())
            .collect();
    }
}

/// A quarter, a half or three quarters of the kinds. Two numbers choose eight of them, so that a
/// short string of bytes still selects faults.
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

/// A fault of `kind` on a random target that can have it.
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
            // If there are more than two devices, one keeps its power.
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

/// Makes the fault intermittent.
fn spells(fault: &mut FaultSpec, dice: &mut Draw) {
    let every = dice.between(50, 2_000);
    fault.every = Some(Span::from_millis(every));
    fault.lasting = Some(Span::from_millis(dice.between(1, every)));
}

impl Drawn<'_> {
    /// Draws the keys of individual kinds.
    fn detail(&self, fault: &mut FaultSpec, dice: &mut Draw) {
        use FaultKind as K;
        let (targets, kind) = (self.targets, fault.kind);
        let Faults { rates, factors, .. } = &self.profile.faults;
        if kind.is_strike() {
            fault.rate = Some(rates[dice.index(rates.len())]);
            fault.count = (dice.below(4) == 1).then(|| dice.narrow(1, 20));
        }
        let mut millis = |most| Some(Span::from_millis(dice.between(1, most)));
        match kind {
            K::Idle => fault.by = millis(50),
            K::Latency | K::Delayed => fault.by = millis(300),
            K::Jitter => fault.by = millis(100),
            K::Burst => fault.len = Some(dice.narrow(1, 16)),
            K::Insert if self.profile.faults.stray_starts => {
                let start = self.targets.start(fault).unwrap_or_default();
                let known = [Some(start), Some(0), None, None];
                fault.value = known[dice.index(known.len())];
            }
            K::Truncate => fault.len = (dice.below(2) == 1).then(|| dice.narrow(1, 40)),
            K::Overrun => fault.fifo = Some(dice.narrow(1, 64)),
            K::ShortRead => fault.len = Some(dice.narrow(1, 8)),
            K::Wrong => fault.factor = Some(factors[dice.index(factors.len())]),
            K::WrongBaud => match dice.below(3) {
                0 => fault.baud = Some(BAUDS[dice.index(BAUDS.len())]),
                1 => fault.ppm = Some(dice.other_than_0(60_000)),
                _ => fault.ppm_per_s = Some(dice.other_than_0(20_000)),
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

    /// Draws fixed times.
    fn foreseen(&self, fault: &mut FaultSpec, is_late: bool, dice: &mut Draw) {
        let time = &self.profile.time;
        let earliest = [millis(time.from), WARM_UP_MS][usize::from(is_late)];
        let most = limit(time, fault).map_or(self.until_ms, millis);
        let from = dice.between(earliest, self.until_ms - 100);
        let until = (from + dice.between(10, most)).min(self.until_ms);
        fault.from = Some(Span::from_millis(from));
        fault.until = Some(Span::from_millis(until));
        if comes_in_spells(fault.kind) || dice.below(6) == 1 {
            spells(fault, dice);
        }
    }

    /// Makes the fault permanent until it is healed.
    fn permanent(&self, fault: &mut FaultSpec, dice: &mut Draw) {
        let from = dice.between(millis(self.profile.time.from), self.until_ms - 100);
        fault.from = Some(Span::from_millis(from));
        fault.until = Some(Span::from_millis(self.until_ms));
        if comes_in_spells(fault.kind) {
            spells(fault, dice);
        }
    }

    /// Lets the fault wait for a byte, a frame, a position or a register.
    fn unforeseen(&self, fault: &mut FaultSpec, dice: &mut Draw) {
        if comes_in_spells(fault.kind) {
            return self.foreseen(fault, false, dice);
        }
        let (time, targets, places) = (&self.profile.time, self.targets, self.places);
        let most = if is_deceived(fault) {
            time.stuck_max
        } else {
            time.triggered_max
        };
        let most = most.map_or(self.until_ms, millis);
        fault.lasting = Some(Span::from_millis(dice.between(10, most)));
        let registers = targets.with_registers();
        match dice.below(4) {
            0 if fault.is_on_line_only() => fault.at_byte = Some(dice.below(20_000)),
            1 if fault.is_on_line_only() => fault.at_frame = Some(dice.below(500)),
            2 if !registers.is_empty() => {
                fault.when = Some(WhenSpec {
                    device: Some(registers[dice.index(registers.len())].name.clone()),
                    register: Some(RegisterName::Number(dice.narrow(0, 63))),
                    at_least: Some(f64::from(dice.narrow::<u8>(1, 30)).into()),
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
                self.foreseen(fault, false, dice);
            }
        }
    }
}
