//! The museum: the defects of the robots' fielded programs, each reproducible.
//!
//! A [`Bug`] is a row of the catalogue. If it can be reproduced, its exhibit is a function. The
//! function feeds the same stimulus to the defective and to the sound [`Variant`] and records bytes
//! on the wire and named figures. No result is stored in advance: all results come from the code
//! that runs, in virtual time.

mod apollo13;
mod base;
mod bus;
mod client;
pub mod experiment;
mod field;
mod frames;
mod hidden;
mod lidar;
mod mapper;
mod navigation;
mod observation;
mod pc;
mod robot;
mod yellow;

pub use hidden::{Hidden, hidden};
pub use observation::{Difference, Exchange, Figure, Observation};

/// Variant of a program, firmware or client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    /// The fielded program, with the defect of the exhibit.
    Defective,
    /// The same program without the defect.
    Sound,
}

impl Variant {
    /// Whether this is the defective variant.
    pub fn is_defective(self) -> bool {
        self == Self::Defective
    }

    /// Name for the user.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Defective => "defective",
            Self::Sound => "sound",
        }
    }
}

/// A defect of the catalogue.
#[derive(Clone, Copy, Debug)]
pub struct Bug {
    /// Its number, e.g. `AV-02`.
    pub id: &'static str,
    /// The affected program, and the link.
    pub place: &'static str,
    /// The trigger, and the effect that the user sees.
    pub sees: &'static str,
    /// The demonstration.
    pub live: Live,
}

/// Demonstration of a defect.
#[derive(Clone, Copy, Debug)]
pub enum Live {
    /// An exhibit.
    Exhibit {
        /// The switched element: a firmware of the base, a defect of the program, or a client.
        by: &'static str,
        /// Observes one of the two variants.
        show: fn(Variant) -> Observation,
    },
    /// No demonstration, for this reason.
    Not(&'static str),
}

impl Bug {
    const fn new(
        id: &'static str,
        place: &'static str,
        sees: &'static str,
        by: &'static str,
        show: fn(Variant) -> Observation,
    ) -> Self {
        let live = Live::Exhibit { by, show };
        Self {
            id,
            place,
            sees,
            live,
        }
    }

    /// A defect that a switch in the robot's program enables.
    const fn mutant(
        id: &'static str,
        place: &'static str,
        sees: &'static str,
        show: fn(Variant) -> Observation,
    ) -> Self {
        Self::new(id, place, sees, "the program with this defect", show)
    }

    /// Runs both variants with the same stimulus; `None` if the defect has no exhibit.
    pub fn reproduce(&self) -> Option<Reproduction> {
        self.reproduce_telling(|_| {})
    }

    /// As `reproduce`; calls `begins` with each variant before the variant runs.
    pub fn reproduce_telling(&self, mut begins: impl FnMut(Variant)) -> Option<Reproduction> {
        let Live::Exhibit { by, show } = self.live else {
            return None;
        };
        let mut look = |variant| {
            begins(variant);
            show(variant)
        };
        Some(Reproduction {
            by,
            defective: look(Variant::Defective),
            sound: look(Variant::Sound),
        })
    }
}

/// Observations of a defect in both variants.
#[derive(Clone, Debug)]
pub struct Reproduction {
    /// The switched element.
    pub by: &'static str,
    /// With the defect.
    pub defective: Observation,
    /// Without the defect.
    pub sound: Observation,
}

impl Reproduction {
    /// Whether the defective variant has the defect and the sound one does not.
    pub const fn holds(&self) -> bool {
        self.defective.has_defect && !self.sound.has_defect
    }

    /// The figures that differ between the variants.
    pub fn differences(&self) -> Vec<Difference> {
        self.defective.differences(&self.sound)
    }
}

/// The defects of the programs of one robot.
#[derive(Clone, Copy, Debug)]
pub struct Wing {
    /// The robot's name, as in a scenario.
    pub robot: &'static str,
    rooms: &'static [&'static [Bug]],
}

impl Wing {
    /// The robot's defects, in the order of the catalogue.
    pub fn bugs(&self) -> impl Iterator<Item = &'static Bug> + use<> {
        self.rooms.iter().copied().flatten()
    }
}

const WINGS: [Wing; 3] = [
    Wing {
        robot: "rescue",
        rooms: &[
            &base::ROWS,
            &bus::ROWS,
            &lidar::ROWS,
            &mapper::ROWS,
            &pc::ROWS,
            &navigation::ROWS,
            &client::ROWS,
            &field::ROWS,
        ],
    },
    Wing {
        robot: "yellow",
        rooms: &yellow::ROOMS,
    },
    Wing {
        robot: "apollo13",
        rooms: &[&apollo13::ROWS],
    },
];

/// The robots, each with the defects of its programs.
pub fn wings() -> impl Iterator<Item = &'static Wing> {
    WINGS.iter()
}

/// All defects, robot by robot, in the order of the catalogue.
pub fn catalogue() -> impl Iterator<Item = &'static Bug> {
    wings().flat_map(Wing::bugs)
}

/// The defect with this id; upper and lower case are equal.
pub fn find(id: &str) -> Option<&'static Bug> {
    catalogue().find(|bug| bug.id.eq_ignore_ascii_case(id))
}

/// The ids most similar to `id`, for an error message about a mistyped id.
pub fn suggestions(id: &str) -> Vec<&'static str> {
    let wanted = id.to_ascii_uppercase();
    let mut ranked: Vec<_> = catalogue()
        .map(|bug| (edits(&bug.id.to_ascii_uppercase(), &wanted), bug.id))
        .collect();
    ranked.sort_by_key(|&(edits, _)| edits);
    ranked.into_iter().take(3).map(|(_, id)| id).collect()
}

/// Number of insertions, removals and replacements that turn `a` into `b`.
fn edits(a: &str, b: &str) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.bytes().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.bytes().enumerate() {
            let replaced = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mistyped_number_finds_its_neighbours() {
        assert_eq!((edits("AV-02", "AV-02"), edits("AV-02", "AV2")), (0, 2));
        assert_eq!(edits("AV-02", "MA-2"), 3);
        assert_eq!(suggestions("av-3c")[0], "AV-03c");
        assert_eq!(find("h-av-1").map(|bug| bug.id), Some("H-AV-1"));
    }
}
