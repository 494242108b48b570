//! Actions of an operator at a page, recorded so that they can be repeated: a branched run must
//! first reach its time in the same way.

use protocols::Instant;

use engine::rig::fault::FaultId;
use engine::robots::Gesture;
use engine::run::Run;
use engine::scenario::FaultSpec;

/// An action.
#[derive(Clone, Debug)]
pub(super) enum Deed {
    /// An action of the robot's station.
    Gesture(Gesture),
    /// The start of a fault.
    Fault(Box<FaultSpec>),
    /// The end of a fault.
    EndFault(FaultId),
    /// A touch on the display.
    Tap([u16; 2]),
}

impl Deed {
    /// Executes the action now.
    pub(super) fn perform(&self, run: &mut Run) -> Result<(), String> {
        match self {
            Self::Gesture(gesture) => {
                let station = run.instruments().station(&run.rig);
                let station = station
                    .ok_or("the PC's end of the radio is a port: this page cannot use it")?;
                let action = station.answer(gesture.clone())?;
                run.command(action).map_err(|error| error.to_string())
            }
            Self::Fault(fault) => {
                let added = run.inject((**fault).clone());
                added.map(drop).map_err(|flaw| flaw.to_string())
            }
            Self::EndFault(id) => run.withdraw(*id).map_err(|flaw| flaw.to_string()),
            Self::Tap(place) => run.tap(*place).map_err(|error| error.to_string()),
        }
    }
}

/// All actions in order of time.
#[derive(Clone, Debug, Default)]
pub(super) struct Deeds(Vec<(Instant, Deed)>);

impl Deeds {
    /// Executes `deed` now, and records it if it succeeded.
    pub(super) fn perform(&mut self, run: &mut Run, deed: Deed) -> Result<(), String> {
        deed.perform(run)?;
        self.0.push((run.rig.now(), deed));
        Ok(())
    }

    /// Removes the actions at `until` or later, and copies those between `since` and `until`, to be
    /// repeated.
    pub(super) fn split(&mut self, since: Instant, until: Instant) -> Vec<(Instant, Deed)> {
        self.0
            .truncate(self.0.partition_point(|(at, _)| *at < until));
        let first = self.0.partition_point(|(at, _)| *at < since);
        self.0[first..].to_vec()
    }
}
