//! Faults of a sensor, as data.

/// Friction that a regulated supply can no longer make up for, rpm/s.
const SLOW_RPM_S: f64 = 600.0;

/// One fault. Setting a fault again replaces its figure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// No supply: the line is silent, the head runs out. Clearing it is a power-on.
    Off,
    /// Dust or hair on the axle: additional dry friction. A regulated supply holds 300 rpm up to
    /// about 450 rpm/s.
    Dust {
        /// Deceleration by it, rpm/s; a clean head has 288.
        friction_rpm_s: f64,
    },
    /// The head is held. It stops at once.
    Stuck,
    /// The encoder is not seen. The head never locks, and the boot text repeats forever.
    EncoderBlind,
    /// The speed word no longer changes. Everything else is right.
    FrozenSpeed,
    /// One tooth is taken for two: the next speed word is doubled, angles are wrong for a turn of
    /// the tooth, then synchronisation is lost. Once; clears itself.
    FalseDoubling,
    /// No laser light: every reading has the code for no dot.
    Dark,
    /// Every strength looks like the beginning of a packet (FA, then an index), and every distance
    /// ends in FA: the hardest traffic for a parser that hunts for start bytes.
    DenseStarts,
    /// One byte of each packet is damaged after the checksum is computed.
    Garbage,
    /// Every distance is too long by this factor, or too short.
    Wrong {
        /// Reported distance divided by true distance.
        factor: f64,
    },
    /// The processor restarts, in the middle of a packet. Once; clears itself.
    Restart,
}

impl Fault {
    /// Every fault, with a figure where one is needed.
    pub const ALL: [Self; 11] = [
        Self::Off,
        Self::Dust {
            friction_rpm_s: 400.0,
        },
        Self::Stuck,
        Self::EncoderBlind,
        Self::FrozenSpeed,
        Self::FalseDoubling,
        Self::Dark,
        Self::DenseStarts,
        Self::Garbage,
        Self::Wrong { factor: 1.1 },
        Self::Restart,
    ];

    /// The fault with this name, with the figure of [`ALL`](Self::ALL).
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|fault| fault.name() == name)
    }

    /// Stable name, as in scenario files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Dust { .. } => "dust",
            Self::Stuck => "stuck",
            Self::EncoderBlind => "encoder-blind",
            Self::FrozenSpeed => "frozen-speed",
            Self::FalseDoubling => "false-doubling",
            Self::Dark => "dark",
            Self::DenseStarts => "dense-starts",
            Self::Garbage => "garbage",
            Self::Wrong { .. } => "wrong",
            Self::Restart => "restart",
        }
    }

    /// The names of all faults, and `slow`, the effect of heavy dust.
    pub(super) const NAMES: [&str; 12] = {
        let mut names = ["slow"; 12];
        let mut index = 0;
        while index < Self::ALL.len() {
            names[index + 1] = Self::ALL[index].name();
            index += 1;
        }
        names
    };

    /// The fault with this name, and `figure` if it takes one.
    pub(super) fn named(name: &str, figure: Option<f64>) -> Option<Self> {
        match (name, Self::from_name(name)) {
            ("slow" | "dust", _) => Some(Self::Dust {
                friction_rpm_s: figure.unwrap_or(SLOW_RPM_S),
            }),
            (_, Some(Self::Wrong { factor })) => Some(Self::Wrong {
                factor: figure.unwrap_or(factor),
            }),
            (_, fault) => fault,
        }
    }
}

/// The faults that are set.
#[derive(Clone, Debug, Default)]
pub(super) struct Faults(Vec<Fault>);

impl Faults {
    pub(super) fn set(&mut self, fault: Fault) {
        self.clear(fault);
        self.0.push(fault);
    }

    pub(super) fn clear(&mut self, fault: Fault) {
        self.0.retain(|set| set.name() != fault.name());
    }

    pub(super) fn has(&self, fault: Fault) -> bool {
        self.0.contains(&fault)
    }

    /// Clears a fault that acts once; returns whether it was set.
    pub(super) fn take(&mut self, fault: Fault) -> bool {
        let had = self.has(fault);
        self.clear(fault);
        had
    }

    pub(super) fn range_factor(&self) -> f64 {
        let wrong = self.0.iter().find_map(|fault| match fault {
            Fault::Wrong { factor } => Some(*factor),
            _ => None,
        });
        wrong.unwrap_or(1.0)
    }

    pub(super) fn dust_rpm_s(&self) -> f64 {
        let dust = self.0.iter().find_map(|fault| match fault {
            Fault::Dust { friction_rpm_s } => Some(*friction_rpm_s),
            _ => None,
        });
        dust.unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_is_found_by_its_name() {
        for fault in Fault::ALL {
            assert_eq!(Fault::from_name(fault.name()), Some(fault));
        }
        assert_eq!(Fault::from_name("broken"), None);
    }

    #[test]
    fn a_fault_set_twice_has_the_later_figure() {
        let mut faults = Faults::default();
        faults.set(Fault::Dust {
            friction_rpm_s: 1.0,
        });
        faults.set(Fault::Dust {
            friction_rpm_s: 2.0,
        });
        assert_eq!(faults.dust_rpm_s(), 2.0);
        faults.clear(Fault::Dust {
            friction_rpm_s: 0.0,
        });
        assert_eq!(faults.dust_rpm_s(), 0.0);
    }

    #[test]
    fn a_wrong_calibration_has_its_own_factor_and_a_sound_one_has_none() {
        let mut faults = Faults::default();
        assert_eq!(faults.range_factor(), 1.0);
        faults.set(Fault::Wrong { factor: 1.25 });
        assert_eq!(faults.range_factor(), 1.25);
        faults.clear(Fault::Wrong { factor: 0.0 });
        assert_eq!(faults.range_factor(), 1.0);
    }
}
