//! Fuzzing of the wire formats: any bytes at all become a stream, and every decoder has to keep its
//! laws on it.
//!
//! The same functions serve `hilrig fuzz`, the coverage-guided targets of the folder `fuzz`, the
//! bench, and the replay of the corpus in the tests. They know nothing but the wire formats, so
//! that an instrumented build of them is small.

mod choices;
mod formats;
mod laws;
mod marks;
mod panel;
mod stream;
mod texts;

pub use choices::Choices;
pub use formats::{Avr, HighFirst, LowFirst, Pcui, Wire, Xv11, Xv11Turns};
pub use laws::keeps_the_laws;
pub use marks::Mark;
pub use panel::Panel;
pub use stream::{Piece, Stream, StreamError};

use core::fmt;

/// A law that was broken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Broken {
    /// Name of the law in kebab case; the same cause has the same name.
    pub law: &'static str,
    /// A sentence with the figures.
    pub detail: String,
}

impl Broken {
    /// The law called `law` was broken.
    pub fn new(law: &'static str, detail: impl Into<String>) -> Self {
        let detail = detail.into();
        Self { law, detail }
    }
}

impl fmt::Display for Broken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.law, self.detail)
    }
}

impl core::error::Error for Broken {}

/// Something that takes any bytes.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Its name, as on the command line and of its folder in the corpus.
    pub name: &'static str,
    /// Makes a stream of what a fuzzer gives.
    pub stream: fn(&[u8]) -> Stream,
    /// Whether the laws hold on a stream.
    pub check: fn(&Stream) -> Result<(), Broken>,
    /// What the decoder does with it, as numbers.
    pub marks: fn(&Stream, Mark<'_>),
}

impl Target {
    /// All targets.
    pub const ALL: [Self; 8] = [
        Self::of::<Xv11>(),
        Self::of::<Xv11Turns>(),
        Self::of::<Avr<LowFirst>>(),
        Self::of::<Avr<HighFirst>>(),
        Self::of::<Pcui>(),
        Self::of::<Panel>(),
        Self {
            name: "rle",
            stream: Stream::raw,
            check: texts::rows_survive_their_code,
            marks: marks::of_row,
        },
        Self {
            name: "hc06",
            stream: Stream::raw,
            check: texts::commands_are_said_as_heard,
            marks: marks::of_command,
        },
    ];

    const fn of<W: Wire>() -> Self {
        Self {
            name: W::NAME,
            stream: Stream::session::<W>,
            check: keeps_the_laws::<W>,
            marks: marks::of_session::<W>,
        }
    }

    /// Whether its streams are sessions of frames rather than bytes as they are.
    pub fn has_sessions(&self) -> bool {
        !matches!(self.name, "rle" | "hc06")
    }

    /// Data that [`stream`](Self::stream) makes `stream` of.
    pub fn data_of(&self, stream: &Stream) -> Vec<u8> {
        if self.has_sessions() {
            stream.to_data()
        } else {
            stream.bytes().to_vec()
        }
    }

    /// The target called `name`.
    pub fn named(name: &str) -> Option<&'static Self> {
        Self::ALL.iter().find(|target| target.name == name)
    }

    /// What a coverage-guided fuzzer calls with any bytes.
    ///
    /// # Panics
    /// If a law is broken: that is how such a fuzzer is told.
    pub fn fuzz(&self, data: &[u8]) {
        let stream = (self.stream)(data);
        if let Err(broken) = (self.check)(&stream) {
            panic!("{broken}\n{}", stream.to_text());
        }
    }
}
