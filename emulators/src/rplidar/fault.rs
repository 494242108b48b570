//! Faults of a sensor, as data. The reports are those of the clients' issue trackers.

/// Friction that stops a head at a duty of 0.6, rpm/s.
const SLOW_RPM_S: f64 = 1_000.0;

/// One fault. Some have a figure; setting a fault again replaces it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// No supply: silence. Clearing it is a power-on, which prints the start text (an unplugged
    /// sensor is noticed after 30 s only: rplidar_ros2_driver #3).
    Off,
    /// The processor restarts, which ends the scan and prints the start text. Once; clears itself.
    Restart,
    /// The head is held.
    Stuck,
    /// Dust or hair on the axle. Figure: additional dry friction, rpm/s.
    Dust,
    /// The motor is fed unevenly, so that the number of nodes in a turn varies (slam_toolbox #278,
    /// #198). Figure: most friction of a turn, rpm/s.
    Uneven,
    /// One byte of each packet is damaged.
    Garbage,
    /// Every distance is wrong. Figure: reported distance divided by true distance.
    Wrong,
    /// The sensor sees no laser light: all nodes are invalid. The sensor does not notice.
    Dark,
    /// The laser fails, which the sensor notices: Protection Stop (LD108).
    LaserOff,
    /// Protection Stop in the middle of a scan (sllidar_ros2 #32, #40). Figure: seconds of scan.
    ProtectionStop,
    /// The health is a warning; everything works.
    HealthWarning,
    /// Bytes are lost: a loose cable (RPLIDAR clients #18, #31), or long runs (adafruit #28, #29).
    /// Figure: one byte of so many.
    ByteLoss,
    /// A receive buffer overflows (ArduPilot #10303, #23749). Once; clears itself. Figure: bytes.
    Burst,
    /// Nodes, the last of them torn, come before the next answer after a stop (RPLIDAR clients #7,
    /// #34). Figure: nodes.
    UncleanStop,
    /// A torn node comes between descriptor and nodes: check bits are wrong from the first node on
    /// (RPLIDAR clients #19, #23, #32; pyrplidar #5). Figure: share of the starts.
    TornStart,
    /// Descriptors begin with AA 55, as those of a foreign sensor do (RPLIDAR clients #25).
    Foreign,
    /// Descriptors announce one byte too many (RPLIDAR clients #18, #31).
    DescriptorLength,
    /// Scan requests are ignored (RPLIDAR clients #10: works 70 % of starts). Figure: share.
    DeafStart,
    /// Answers about the configuration hold no value (rplidar_sdk #150). Figure: the number of the
    /// key, 0 all keys.
    ConfEmpty,
    /// The sensor reports another mode as the typical one. The usual figure is one beyond the last
    /// mode. That mode is listed like the others but not streamed: its request is ignored
    /// (rplidar_ros #68 of robopeak). Figure: number of the mode.
    TypicalMode,
    /// Answers are empty (pyrplidar #3).
    EmptyAnswer,
    /// Answers come late (rplidar_ros #5, #36, #77, #110). Figure: seconds.
    LateAnswers,
    /// The UART is set up for 256000 baud (RPLIDAR clients #31, rplidar_ros #5).
    WrongRate,
    /// The supply fails when a scan begins, and the processor restarts (rplidar_ros #59). The head
    /// needs 550 mA at its start, 300 later. Figure: limit of the supply, mA.
    WeakSupply,
    /// For a while after a stop the sensor takes no request (RPLIDAR clients #33). Figure: seconds.
    SlowStop,
    /// The adapter runs the motor while DTR is high (rplidar.net #2).
    DtrInverted,
    /// Angles of invalid nodes are not brought below 360 degrees (rplidar_ros PR #15).
    AnglePast360,
    /// The turn is seen from the other side (rplidar_ros PR #157).
    Mirrored,
    /// The turn begins elsewhere (rplidar_ros PR #157). Figure: degrees, clockwise.
    Turned,
}

impl Fault {
    /// Every fault.
    pub const ALL: [Self; 29] = [
        Self::Off,
        Self::Restart,
        Self::Stuck,
        Self::Dust,
        Self::Uneven,
        Self::Garbage,
        Self::Wrong,
        Self::Dark,
        Self::LaserOff,
        Self::ProtectionStop,
        Self::HealthWarning,
        Self::ByteLoss,
        Self::Burst,
        Self::UncleanStop,
        Self::TornStart,
        Self::Foreign,
        Self::DescriptorLength,
        Self::DeafStart,
        Self::ConfEmpty,
        Self::TypicalMode,
        Self::EmptyAnswer,
        Self::LateAnswers,
        Self::WrongRate,
        Self::WeakSupply,
        Self::SlowStop,
        Self::DtrInverted,
        Self::AnglePast360,
        Self::Mirrored,
        Self::Turned,
    ];

    /// Stable name, as in scenario files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Restart => "restart",
            Self::Stuck => "stuck",
            Self::Dust => "dust",
            Self::Uneven => "uneven",
            Self::Garbage => "garbage",
            Self::Wrong => "wrong",
            Self::Dark => "dark",
            Self::LaserOff => "laser-off",
            Self::ProtectionStop => "protection-stop",
            Self::HealthWarning => "health-warning",
            Self::ByteLoss => "byte-loss",
            Self::Burst => "burst",
            Self::UncleanStop => "unclean-stop",
            Self::TornStart => "torn-start",
            Self::Foreign => "foreign",
            Self::DescriptorLength => "descriptor-length",
            Self::DeafStart => "deaf-start",
            Self::ConfEmpty => "conf-empty",
            Self::TypicalMode => "typical-mode",
            Self::EmptyAnswer => "empty-answer",
            Self::LateAnswers => "late-answers",
            Self::WrongRate => "wrong-rate",
            Self::WeakSupply => "weak-supply",
            Self::SlowStop => "slow-stop",
            Self::DtrInverted => "dtr-inverted",
            Self::AnglePast360 => "angle-past-360",
            Self::Mirrored => "mirrored",
            Self::Turned => "turned",
        }
    }

    /// The fault with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|fault| fault.name() == name)
    }

    /// The usual figure; `None` if the fault has none. The shares of starts are those of the
    /// reports.
    pub const fn usual_figure(self) -> Option<f64> {
        Some(match self {
            Self::Dust => 400.0,
            Self::Uneven => 100.0,
            Self::Wrong => 1.1,
            Self::ProtectionStop => 120.0,
            Self::ByteLoss => 20_000.0,
            Self::Burst => 64.0,
            Self::UncleanStop => 8.0,
            Self::TornStart => 0.8,
            Self::DeafStart => 0.3,
            Self::ConfEmpty => 0.0,
            // Firmware 1.29 has the modes 0 to 4.
            Self::TypicalMode => 5.0,
            Self::LateAnswers => 2.0,
            Self::WeakSupply => 400.0,
            Self::SlowStop => 0.5,
            Self::Turned => 90.0,
            _ => return None,
        })
    }

    /// The names of all faults, and `slow`, the effect of heavy dust.
    pub(super) const NAMES: [&str; 30] = {
        let mut names = ["slow"; 30];
        let mut index = 0;
        while index < Self::ALL.len() {
            names[index + 1] = Self::ALL[index].name();
            index += 1;
        }
        names
    };

    /// The fault with this name, and its figure.
    pub(super) fn named(name: &str, figure: Option<f64>) -> Option<(Self, Option<f64>)> {
        match name {
            "slow" => Some((Self::Dust, figure.or(Some(SLOW_RPM_S)))),
            _ => Some((Self::from_name(name)?, figure)),
        }
    }
}

/// The faults that are set, with their figures.
#[derive(Clone, Debug, Default)]
pub(super) struct Faults(Vec<(Fault, f64)>);

impl Faults {
    pub(super) fn set(&mut self, fault: Fault, figure: Option<f64>) {
        self.clear(fault);
        let figure = figure.filter(|figure| figure.is_finite());
        let figure = figure.or(fault.usual_figure()).unwrap_or(0.0);
        self.0.push((fault, figure));
    }

    pub(super) fn clear(&mut self, fault: Fault) {
        self.0.retain(|(set, _)| *set != fault);
    }

    pub(super) fn has(&self, fault: Fault) -> bool {
        self.figure(fault).is_some()
    }

    /// The figure of a fault that is set.
    pub(super) fn figure(&self, fault: Fault) -> Option<f64> {
        let set = self.0.iter().find(|(set, _)| *set == fault);
        set.map(|(_, figure)| *figure)
    }

    /// Clears a fault that acts once; returns its figure if it was set.
    pub(super) fn take(&mut self, fault: Fault) -> Option<f64> {
        let figure = self.figure(fault);
        self.clear(fault);
        figure
    }
}
