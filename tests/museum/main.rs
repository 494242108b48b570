//! The museum: every exhibit shows its defect with the switch on, and not with it off; the figures
//! are those of the field-bug catalogue.

mod base;
mod bus;
mod lidar;
mod pc;

use hilrig::museum::{self, Observation, Reproduction};

/// The exhibit of `id`, reproduced; it must hold.
fn shown(id: &str) -> Reproduction {
    let bug = museum::find(id).unwrap_or_else(|| panic!("{id} is not in the catalogue"));
    let reproduction = bug
        .reproduce()
        .unwrap_or_else(|| panic!("{id} is not live"));
    assert!(reproduction.holds(), "{id}: {reproduction:#?}");
    reproduction
}

/// A figure of an observation.
fn figure<'a>(observation: &'a Observation, name: &str) -> &'a str {
    let found = observation.value(name);
    found.unwrap_or_else(|| panic!("no \"{name}\" in {observation:#?}"))
}

/// Asserts a figure's value in the defective and in the sound variant.
fn assert_figure(id: &str, name: &str, defective: &str, sound: &str) {
    let reproduction = shown(id);
    let found = [&reproduction.defective, &reproduction.sound].map(|side| figure(side, name));
    assert_eq!(found, [defective, sound], "{id}: {name}");
}

/// What holds for all of them is one test a wing, so that they run side by side.
fn wing_holds(prefixes: &[&str]) {
    let of_wing = |id: &str| prefixes.iter().any(|prefix| id.starts_with(prefix));
    let mut shown = 0;
    for bug in museum::catalogue().filter(|bug| of_wing(bug.id)) {
        if let Some(reproduction) = bug.reproduce() {
            assert!(reproduction.holds(), "{}: {reproduction:#?}", bug.id);
            assert!(
                !reproduction.differences().is_empty(),
                "{}: no figure differs",
                bug.id
            );
            shown += 1;
        }
    }
    assert!(shown > 0, "{prefixes:?}");
}
