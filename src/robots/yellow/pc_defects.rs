//! Ways of the fielded PC program, each behind its own number.

use firmware_core::localise::Votes;
use firmware_core::robots::yellow::pc::{Following, NextView, PcConfig, Planning};

/// Switches one on.
type Switch = fn(&mut PcConfig);

/// Every one that the program can have.
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

/// All numbers.
pub(super) fn ids() -> impl Iterator<Item = &'static str> {
    SWITCHES.iter().map(|(id, _)| *id)
}

/// Switches the one called `id` on; whether there is such a one.
pub(super) fn switch_on(config: &mut PcConfig, id: &str) -> bool {
    let found = SWITCHES.iter().find(|(known, _)| *known == id);
    if let Some((_, switch)) = found {
        switch(config);
    }
    found.is_some()
}
