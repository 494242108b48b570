//! Variants of the fielded PC program, each behind its own number.

use super::config::{Following, NextView, PcConfig, Planning};
use crate::localise::Votes;

/// Function that enables a variant.
type Switch = fn(&mut PcConfig);

/// All defects of the program.
const SWITCHES: [(&str, Switch); 11] = [
    ("YP-01", |c| c.sending.one_per_frame = true),
    ("YP-02", |c| c.sending.byte_per_ms = true),
    ("YP-03", |c| c.sending.requests_clear_queue = true),
    ("YP-04", |c| c.sending.ask_once = true),
    ("YP-05", |c| c.framing.deliver_corrupt = true),
    ("YP-06", |c| c.mapping.eight_bits = true),
    ("YP-07", |c| c.mapping.wide_margin = true),
    ("YP-08", |c| c.mapping.odometry_alone = true),
    ("YP-09", |c| {
        c.view = NextView::Random;
        c.planning = Planning::Once;
    }),
    ("YP-10", |c| c.following = Following::Moved),
    ("YP-11", |c| c.votes = Votes::Multiplied),
];

impl PcConfig {
    /// Numbers of the variants that [`with_defect`](Self::with_defect) knows.
    pub fn defects() -> impl Iterator<Item = &'static str> {
        SWITCHES.iter().map(|(id, _)| *id)
    }

    /// The program with the variant `id` of the fielded one; `None` if the id is unknown.
    pub fn with_defect(mut self, id: &str) -> Option<Self> {
        let (_, switch) = SWITCHES.iter().find(|(known, _)| *known == id)?;
        switch(&mut self);
        Some(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_way_of_the_fielded_program_is_switched_by_its_number() {
        let told = |config: &PcConfig| alloc::format!("{config:?}");
        let sound = told(&PcConfig::default());
        for id in PcConfig::defects() {
            let with = PcConfig::default().with_defect(id).map(|with| told(&with));
            assert!(with.is_some_and(|with| with != sound), "{id}");
        }
        assert!(PcConfig::default().with_defect("none").is_none());
        assert!(PcConfig::defects().count() > 2);
    }
}
