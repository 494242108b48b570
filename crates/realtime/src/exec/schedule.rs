//! Orders of the threads of a program in virtual time.

/// An order of threads that differs from the order of their calls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Schedule {
    /// The order of this seed.
    Seed(u64),
    /// The order of the scenario's seed.
    OfScenario,
}

impl Schedule {
    /// The seed of the order, for a scenario with the seed `scenario`.
    pub const fn seed(self, scenario: u64) -> u64 {
        match self {
            Self::Seed(seed) => seed,
            Self::OfScenario => scenario,
        }
    }
}

impl core::str::FromStr for Schedule {
    type Err = String;

    /// Reads a number, or `seed` for the scenario's own.
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "seed" => Ok(Self::OfScenario),
            text => text
                .parse()
                .map(Self::Seed)
                .map_err(|_| "expected a number, or \"seed\" for the scenario's seed".to_owned()),
        }
    }
}

impl core::fmt::Display for Schedule {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Seed(seed) => write!(f, "{seed}"),
            Self::OfScenario => f.write_str("seed"),
        }
    }
}
