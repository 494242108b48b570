use emulators::rng::Rng;

/// Random sources for the parts of a mission; they do not influence each other.
#[derive(Clone, Debug)]
pub struct Dice {
    pub(super) world: Draw,
    pub(super) mission: Draw,
    pub(super) timing: Draw,
    pub(super) faults: Draw,
}

impl Dice {
    /// Named streams of `seed` for the scenario `name`: no two scenarios get the same world, orders
    /// or faults.
    pub fn of_seed(seed: u64, name: &str) -> Self {
        let stream =
            |part: &str| Draw::Stream(Rng::stream(seed, &format!("generate.{part}.{name}")));
        Self {
            world: stream("world"),
            mission: stream("mission"),
            timing: stream("timing"),
            faults: stream("faults"),
        }
    }

    /// Choices from `bytes`: every fourth byte belongs to the same part. Zeros follow the last
    /// byte.
    pub(crate) fn of_bytes(bytes: &[u8]) -> Self {
        let lane = |first: usize| {
            let lane: Vec<u8> = bytes.iter().skip(first).step_by(4).copied().collect();
            Draw::Bytes(lane.into_iter())
        };
        Self {
            world: lane(0),
            mission: lane(1),
            timing: lane(2),
            faults: lane(3),
        }
    }
}

/// A source of choices.
#[derive(Clone, Debug)]
pub(super) enum Draw {
    Stream(Rng),
    Bytes(std::vec::IntoIter<u8>),
}

impl Draw {
    /// A number below `n`, which must not be 0.
    pub(super) fn below(&mut self, n: u64) -> u64 {
        match self {
            Self::Stream(rng) => rng.below(n),
            Self::Bytes(bytes) => {
                let mut word = u64::from(bytes.next().unwrap_or(0));
                if n > 256 {
                    word |= u64::from(bytes.next().unwrap_or(0)) << 8;
                }
                word % n
            }
        }
    }

    /// A number from `least` to `most`.
    pub(super) fn between(&mut self, least: u64, most: u64) -> u64 {
        least + self.below(most - least + 1)
    }

    /// A whole number from `-most` to `most`, other than 0.
    pub(super) fn other_than_0(&mut self, most: u32) -> f64 {
        let drawn = self.between(0, 2 * u64::from(most));
        let drawn = u32::try_from(drawn).map_or(0.0, f64::from) - f64::from(most);
        if drawn == 0.0 { 1.0 } else { drawn }
    }

    /// Like `between`, for a smaller type.
    pub(super) fn narrow<T: TryFrom<u64>>(&mut self, least: u64, most: u64) -> T
    where
        T::Error: core::fmt::Debug,
    {
        let number = self.between(least, most);
        number.try_into().expect("the bounds fit the type")
    }

    /// An index into a list of `len` elements.
    pub(super) fn index(&mut self, len: usize) -> usize {
        usize::try_from(self.below(len as u64)).expect("below a length")
    }
}
