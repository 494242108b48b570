//! The museum: the defects of the robots' fielded programs, each live.
//!
//! A [`Bug`] is a row of the catalogue. Where it can be shown, its exhibit is a function that feeds
//! the same stimulus to the defective and to the sound [`Variant`] and notes what is observed:
//! bytes on the wire, and named figures. Nothing shown is written down beforehand; all of it comes
//! from the code that runs, in virtual time.

mod apollo13;
mod base;
mod bus;
mod client;
pub mod experiment;
mod field;
mod frames;
mod lidar;
mod mapper;
mod navigation;
mod observation;
mod pc;
mod robot;
mod yellow;

pub use observation::{Difference, Exchange, Figure, Observation};

/// Which of the two programs, firmwares or clients is checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    /// The fielded one, with the defect in question.
    Defective,
    /// Without the defect.
    Sound,
}

impl Variant {
    /// Whether it is the defective one.
    pub fn is_defective(self) -> bool {
        self == Self::Defective
    }

    /// For people.
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
    /// Which program has it, and on which link.
    pub place: &'static str,
    /// What sets it off, and what the user sees.
    pub sees: &'static str,
    /// How it is shown here.
    pub live: Live,
}

/// How a defect is shown.
#[derive(Clone, Copy, Debug)]
pub enum Live {
    /// By its exhibit.
    Exhibit {
        /// What is switched on: a firmware of the base, a defect of the program, a client.
        by: &'static str,
        /// Looks at one of the two variants.
        show: fn(Variant) -> Observation,
    },
    /// Not at all, for this reason.
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

    /// One behind a switch of the robot's program.
    const fn mutant(
        id: &'static str,
        place: &'static str,
        sees: &'static str,
        show: fn(Variant) -> Observation,
    ) -> Self {
        Self::new(id, place, sees, "the program with this defect", show)
    }

    /// Both variants on the same stimulus; `None` if the defect has no exhibit.
    pub fn reproduce(&self) -> Option<Reproduction> {
        self.reproduce_telling(|_| {})
    }

    /// The same, telling which variant is checked next.
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

/// A defect shown and shown absent.
#[derive(Clone, Debug)]
pub struct Reproduction {
    /// What was switched on.
    pub by: &'static str,
    /// With the defect.
    pub defective: Observation,
    /// Without.
    pub sound: Observation,
}

impl Reproduction {
    /// Whether the defective variant shows the defect and the sound one does not.
    pub const fn holds(&self) -> bool {
        self.defective.has_defect && !self.sound.has_defect
    }

    /// The figures in which the two differ.
    pub fn differences(&self) -> Vec<Difference> {
        self.defective.differences(&self.sound)
    }
}

/// The defects of one robot's programs.
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

/// The robots whose programs' defects are shown.
pub fn wings() -> impl Iterator<Item = &'static Wing> {
    WINGS.iter()
}

/// All defects, robot by robot, in the order of the catalogue.
pub fn catalogue() -> impl Iterator<Item = &'static Bug> {
    wings().flat_map(Wing::bugs)
}

/// The defect called `id`, in whatever case.
pub fn find(id: &str) -> Option<&'static Bug> {
    catalogue().find(|bug| bug.id.eq_ignore_ascii_case(id))
}

/// The numbers most like `id`, for an error message about a mistyped one.
pub fn suggestions(id: &str) -> Vec<&'static str> {
    let wanted = id.to_ascii_uppercase();
    let mut ranked: Vec<_> = catalogue()
        .map(|bug| (edits(&bug.id.to_ascii_uppercase(), &wanted), bug.id))
        .collect();
    ranked.sort_by_key(|&(edits, _)| edits);
    ranked.into_iter().take(3).map(|(_, id)| id).collect()
}

/// Insertions, removals and replacements that make `b` of `a`.
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
