use super::{Effort, Judged};
use engine::scenario::Scenario;

/// What a case fails for, as far as it can be taken out of it: what is left of the case must
/// continue failing for it, and not for what was left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Culprit {
    /// Everything that goes wrong.
    Faults,
    /// A thing of a list, by its number in the first case.
    Thing(List, usize),
}

/// Lists of a scenario whose parts may be in the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum List {
    Push,
    Moving,
    Pillar,
    Polygon,
    Wall,
    Step,
}

const LISTS: [List; 6] = [
    List::Push,
    List::Moving,
    List::Pillar,
    List::Polygon,
    List::Wall,
    List::Step,
];

impl List {
    fn len(self, case: &Scenario) -> usize {
        match self {
            Self::Push => case.world.push.len(),
            Self::Moving => case.world.moving.len(),
            Self::Pillar => case.world.pillar.len(),
            Self::Polygon => case.world.polygon.len(),
            Self::Wall => case.world.wall.len(),
            Self::Step => case.mission.step.len(),
        }
    }

    fn remove(self, case: &mut Scenario, index: usize) {
        match self {
            Self::Push => drop(case.world.push.remove(index)),
            Self::Moving => drop(case.world.moving.remove(index)),
            Self::Pillar => drop(case.world.pillar.remove(index)),
            Self::Polygon => drop(case.world.polygon.remove(index)),
            Self::Wall => drop(case.world.wall.remove(index)),
            Self::Step => drop(case.mission.step.remove(index)),
        }
    }

    /// Whether these two things of the list are one.
    fn is_same(self, [a, b]: [&Scenario; 2], [i, j]: [usize; 2]) -> bool {
        match self {
            Self::Push => a.world.push[i] == b.world.push[j],
            Self::Moving => a.world.moving[i] == b.world.moving[j],
            Self::Pillar => a.world.pillar[i] == b.world.pillar[j],
            Self::Polygon => a.world.polygon[i] == b.world.polygon[j],
            Self::Wall => a.world.wall[i] == b.world.wall[j],
            Self::Step => a.mission.step[i] == b.mission.step[j],
        }
    }
}

/// The case that a search begins with, its culprit, and what it comes to without it.
pub(super) struct Cause<'a> {
    start: &'a Scenario,
    culprit: Option<Culprit>,
    cured: Judged,
}

impl<'a> Cause<'a> {
    /// Finds what `start` fails for: its faults, or else the first thing without which it passes.
    pub(super) fn of(
        start: &'a Scenario,
        judge: &mut impl FnMut(&Scenario) -> Judged,
        effort: &mut Effort<'_>,
    ) -> Self {
        let found = |culprit, cured| Self {
            start,
            culprit: Some(culprit),
            cured,
        };
        if !start.fault.is_empty() && effort.spend() {
            let cured = judge(&without_faults(start));
            if cured != Judged::FailsAlike {
                return found(Culprit::Faults, cured);
            }
        }
        for list in LISTS {
            for index in 0..list.len(start) {
                let mut cured = start.clone();
                list.remove(&mut cured, index);
                if effort.spend() && judge(&cured) == Judged::Passes {
                    return found(Culprit::Thing(list, index), Judged::Passes);
                }
            }
        }
        Self {
            start,
            culprit: None,
            cured: Judged::FailsAlike,
        }
    }

    /// Whether something is to blame.
    pub(super) const fn is_known(&self) -> bool {
        self.culprit.is_some()
    }

    /// Whether `case`, which fails, fails for this cause: it has the culprit, and without it the
    /// result is the first case's result without it.
    pub(super) fn is_of(
        &self,
        case: &Scenario,
        judge: &mut impl FnMut(&Scenario) -> Judged,
    ) -> bool {
        let cured = match self.culprit {
            None => return true,
            Some(Culprit::Faults) if case.fault.is_empty() => return false,
            Some(Culprit::Faults) => without_faults(case),
            Some(Culprit::Thing(list, index)) => {
                let is_it = |&at: &usize| list.is_same([self.start, case], [index, at]);
                let Some(at) = (0..list.len(case)).find(is_it) else {
                    return false;
                };
                let mut cured = case.clone();
                list.remove(&mut cured, at);
                cured
            }
        };
        match (judge(&cured), self.cured) {
            (now, Judged::Passes) => now == Judged::Passes,
            (now, _) => now != Judged::FailsAlike,
        }
    }
}

fn without_faults(case: &Scenario) -> Scenario {
    Scenario {
        fault: Vec::new(),
        ..case.clone()
    }
}
