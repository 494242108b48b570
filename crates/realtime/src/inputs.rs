//! Modem lines that a port's client sees: set by a device's pins, or by hand.

use super::Place;
use engine::rig::Rig;

/// A modem line towards the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Input {
    /// Its name. With the port's name before it, the name of the link that sets it.
    pub(crate) name: &'static str,
    /// Its bit, as TIOCMGET has it.
    pub(crate) bit: u32,
    /// Its level if no device sets it.
    pub(crate) is_usual: bool,
}

/// All input lines, in the order in which drivers count their changes.
pub(crate) const INPUTS: [Input; 4] = [
    input("cts", 0x020, true),
    input("dsr", 0x100, true),
    input("ri", 0x080, false),
    input("dcd", 0x040, true),
];
/// Bit of CTS.
const CTS: u32 = INPUTS[0].bit;

const fn input(name: &'static str, bit: u32, is_usual: bool) -> Input {
    Input {
        name,
        bit,
        is_usual,
    }
}

/// Sources of the modem lines of one port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Inputs {
    /// The port's own node.
    node: usize,
    /// Ends of the links on which a device sets the lines, one byte per level.
    pins: [Option<usize>; 4],
}

impl Inputs {
    /// The sources for the port `name` among all `places`.
    pub(crate) fn of<'a>(name: &str, places: impl Iterator<Item = Place<'a>> + Clone) -> Self {
        let node = |name: &str| {
            let mut places = places.clone();
            places.find(|place| place.name == name)
        };
        let pin = |input: Input| node(&format!("{name}-{}", input.name)).map(|place| place.node);
        Self {
            node: node(name).map_or(0, |place| place.node),
            pins: INPUTS.map(pin),
        }
    }

    /// Whether a device sets any of these lines.
    pub(crate) fn are_wired(&self) -> bool {
        self.pins.iter().any(Option::is_some)
    }

    /// Current levels, as TIOCMGET returns them.
    pub(crate) fn bits(&self, rig: &Rig) -> u32 {
        let forced = rig.forced_lines(self.node);
        let mut bits = 0;
        for (index, input) in INPUTS.iter().enumerate() {
            let set = |pin: usize| rig.level(pin) == Some(true);
            let is_on = self.pins[index].map_or(input.is_usual, set);
            if forced[index].unwrap_or(is_on) {
                bits |= input.bit;
            }
        }
        bits
    }

    /// Whether the device accepts bytes (CTS).
    pub(crate) fn is_clear_to_send(&self, rig: &Rig) -> bool {
        self.bits(rig) & CTS != 0
    }
}
