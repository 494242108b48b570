//! Lists the processes of a supervised program, and puts the program back to an earlier moment.

use super::Trial;
use crate::guest::supervisor::Moment;

/// A program at one moment.
pub struct TrialMoment(Moment);

impl Trial {
    /// The processes of the program.
    pub fn processes(&self) -> Vec<u32> {
        let roots = self.programs.iter().map(|one| one.root);
        let pids = roots.chain(self.supervisor.others());
        pids.filter_map(|pid| u32::try_from(pid).ok()).collect()
    }

    /// The current moment, if [`put_back`](Self::put_back) can put the program back to it: the
    /// program has one thread, which waits for its ports, and no other files.
    pub fn moment(&mut self) -> Option<TrialMoment> {
        let is_running = self.programs.len() == 1 && self.first_end().is_none();
        let moment = is_running.then(|| self.supervisor.moment())?;
        moment.map(TrialMoment)
    }

    /// Puts the program back to `moment`; returns whether this was possible. If not, the program
    /// must be started again. The rig continues.
    pub fn put_back(&mut self, moment: &TrialMoment) -> bool {
        self.first_end().is_none() && self.supervisor.put_back(&moment.0)
    }
}
