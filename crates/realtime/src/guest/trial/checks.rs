//! The verdicts on a program that still runs.

use super::Trial;
use crate::exec::{Ending, SoFar};
use crate::process::Farewell;
use engine::run::check::Check;
use engine::run::own_breaks;

/// The check that needs the program's end.
const OF_THE_END: &str = "no-children-left";

impl Trial {
    /// The checks of the program and of the run, as they would be if the run ended now.
    pub fn checks_now(&mut self) -> Vec<Check> {
        self.supervisor.stage.look();
        let each = self.programs.iter();
        let each = each.map(|one| (one.name.clone(), one.ended)).collect();
        let ended = self.first_end();
        let stage = &self.supervisor.stage;
        let run = &stage.run;
        let (rig, faults) = (&run.rig, &run.scenario().fault);
        let so_far = run.checks();
        let spins = self.spins.clone().or_else(|| stage.busy.clone());
        let ending = Ending {
            ports: &stage.ports,
            foreign: &self.foreign,
            ended,
            each,
            waits: &[],
            farewell: &Farewell::default(),
            is_over: true,
            more: None,
        };
        let mut checks = ending.own_checks(&SoFar {
            now: stage.now(),
            checks: &so_far,
            faults,
            was_heard: rig.was_asked(),
            breaks: &own_breaks(rig, faults),
        });
        checks.retain(|check| check.name != OF_THE_END);
        checks.extend(spins.map(|spins| Check::new("program-yields", false, spins)));
        // The checks of the run itself observed no program in this process.
        let own: Vec<_> = checks.iter().map(|check| check.name.clone()).collect();
        checks.extend(
            so_far
                .into_iter()
                .filter(|check| !own.contains(&check.name)),
        );
        checks
    }
}
