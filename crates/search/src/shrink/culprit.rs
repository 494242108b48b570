use super::{Effort, Judged};
use engine::scenario::Scenario;

/// The removable cause of a failure. A smaller case must fail because of it, not because other
/// parts were removed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Culprit {
    /// All faults.
    Faults,
    /// An element of a list, by its index in the first case.
    Thing(List, usize),
}

/// Lists of a scenario whose elements may prevent the mission.
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

    /// Whether the two elements of the list are equal.
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

/// The first case of a search, its culprit, and its result without the culprit.
pub(super) struct Cause<'a> {
    start: &'a Scenario,
    culprit: Option<Culprit>,
    cured: Judged,
}

impl<'a> Cause<'a> {
    /// Finds the culprit of `start`: its faults, or the first element without which it passes.
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

    /// Whether there is a culprit.
    pub(super) const fn is_known(&self) -> bool {
        self.culprit.is_some()
    }

    /// Whether the failing `case` fails for this cause: it contains the culprit, and without the
    /// culprit its result equals that of the first case.
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
