//! Actions of an operator at a page, kept so that they can be repeated: a run that continues from
//! an earlier time must first reach that time in the same way.

use protocols::Instant;

use engine::rig::fault::FaultId;
use engine::robots::Gesture;
use engine::run::Run;
use engine::scenario::FaultSpec;

/// Something that was done.
#[derive(Clone, Debug)]
pub(super) enum Deed {
    /// By the robot's station.
    Gesture(Gesture),
    /// Something went wrong from then on.
    Fault(Box<FaultSpec>),
    /// A fault ended.
    EndFault(FaultId),
    /// A finger touched the display.
    Tap([u16; 2]),
}

impl Deed {
    /// Does it now.
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

/// All that was done, in the order of time.
#[derive(Clone, Debug, Default)]
pub(super) struct Deeds(Vec<(Instant, Deed)>);

impl Deeds {
    /// Does `deed` now and keeps it, if it could be done.
    pub(super) fn perform(&mut self, run: &mut Run, deed: Deed) -> Result<(), String> {
        deed.perform(run)?;
        self.0.push((run.rig.now(), deed));
        Ok(())
    }

    /// Takes out what was done at `until` or later, and copies what was done between `since` and
    /// then, to be done again.
    pub(super) fn split(&mut self, since: Instant, until: Instant) -> Vec<(Instant, Deed)> {
        self.0
            .truncate(self.0.partition_point(|(at, _)| *at < until));
        let first = self.0.partition_point(|(at, _)| *at < since);
        self.0[first..].to_vec()
    }
}
