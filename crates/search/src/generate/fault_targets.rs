use core::time::Duration;

use super::Profile;
use super::limits::silences;
use engine::codec::Codec;
use engine::codec::wire::Choices;
use engine::rig::line::Direction;
use engine::rig::{LinkKind, Rig};
use engine::robots::{self, Console, DriveKeys, Dut, Instruments, PcEnd, Station, WirePlan, Wired};
use engine::scenario::{
    DirectionSpec, FaultKind, FaultPlace, FaultSpec, Scenario, ScenarioError, SetPoint, Source,
    WorldSpec,
};

/// All parts of a robot that can have a fault, as its links and devices are wired.
#[derive(Clone, Debug, Default)]
pub(super) struct FaultTargets {
    links: Vec<String>,
    /// The kinds of the links.
    link_kinds: Vec<LinkKind>,
    devices: Vec<Device>,
    consoles: &'static [Console],
    /// Kinds that the profile excludes.
    never: Vec<String>,
    /// Set-points that turn the robot on the spot.
    turn: Option<Vec<SetPoint>>,
    /// Links without which the robot cannot drive.
    needs: Vec<String>,
    hasty: Option<&'static str>,
    /// Links of the drive.
    drive: Vec<String>,
    /// Links of the drive whose device keeps its set-points when its master is silent.
    runs_on: Vec<String>,
    /// Whether there is a robot with a mission; otherwise there are only devices.
    has_body: bool,
    /// The orders that its station can give.
    pub(super) orders: Orders,
    /// The first byte of a frame, by link and direction.
    starts: Vec<(String, DirectionSpec, u8)>,
}

/// Time without commands in which a robot drives no farther than it sees.
const REACTION: Duration = Duration::from_millis(300);

/// The orders that a station can give.
#[derive(Clone, Debug, Default)]
pub(super) struct Orders {
    /// Names of the modes.
    pub(super) modes: &'static [&'static str],
    /// Maximum number of places of a list, if it is known.
    pub(super) list_max: Option<usize>,
    /// Manual control.
    pub(super) keys: Option<DriveKeys>,
    /// Modes that drive to a pose, which follows their name.
    pub(super) goals: Vec<&'static str>,
    /// Whether a bit of an order can flip.
    pub(super) can_flip: bool,
    /// Link of the orders, and the format of their frames.
    pub(super) link: Option<(&'static str, &'static Codec)>,
}

impl Orders {
    fn of(instruments: &dyn Instruments, rig: &Rig) -> Self {
        let station = instruments.station(rig);
        let goals = station.map_or(&[][..], Station::place_acts).iter();
        let link = instruments.orders_link();
        let codec = link.and_then(|link| instruments.codec_towards(rig, link, Direction::ToMaster));
        Self {
            modes: station.map_or(&[], Station::modes),
            list_max: station.and_then(Station::list_max),
            keys: station.and_then(Station::keys),
            goals: goals
                .filter(|act| act.is_goal && act.heading)
                .map(|act| act.mode)
                .collect(),
            can_flip: rig
                .links()
                .iter()
                .any(|known| Some(known.name.as_str()) == link && FaultKind::Flip.fits(known.kind)),
            link: link.zip(codec),
        }
    }
}

/// The first byte of a frame on each line whose format is known.
fn starts(instruments: &dyn Instruments, rig: &Rig) -> Vec<(String, DirectionSpec, u8)> {
    let both = [
        (DirectionSpec::ToMaster, Direction::ToMaster),
        (DirectionSpec::ToDevice, Direction::ToDevice),
    ];
    let links = rig.links().iter().map(|link| link.name.clone());
    let lanes = links.flat_map(|link| both.map(|way| (link.clone(), way)));
    let lanes = lanes.filter_map(|(link, (spec, way))| {
        let codec = instruments.codec_towards(rig, &link, way)?;
        let mut frame = Vec::new();
        codec.build(&mut Choices::new(&[]), &mut frame);
        Some((link, spec, *frame.first()?))
    });
    lanes.collect()
}

#[derive(Clone, Debug)]
pub(super) struct Device {
    pub(super) name: String,
    /// The faults of the device.
    pub(super) faults: &'static [&'static str],
    /// Whether the device has registers.
    pub(super) has_registers: bool,
    /// Whether the device sends messages. A device with signal levels only is read on demand, never
    /// late.
    pub(super) has_messages: bool,
    /// Whether its robot searches until the whole area is seen, and returns early if its battery is
    /// low.
    has_to_last: bool,
    /// Faults that the profile excludes.
    never: Vec<String>,
    /// Links of the device.
    pub(super) links: Vec<String>,
}

/// The fault that ends a search by the robot's own decision.
const SENT_HOME: &str = "battery-low";

impl Device {
    /// Faults that only this device has, and that the profile allows.
    pub(super) fn of_its_own(&self) -> impl Iterator<Item = &'static str> {
        let is_known = |name: &str| FaultKind::ALL.iter().any(|kind| kind.name() == name);
        self.faults
            .iter()
            .copied()
            .filter(move |name| !is_known(name))
            .filter(|name| !self.never.iter().any(|never| never == name))
            .filter(|name| !self.has_to_last || *name != SENT_HOME)
    }
}

impl FaultTargets {
    /// Links and devices of `scenario` that `profile` allows. No program that plays a device is
    /// started, so its own faults are unknown.
    ///
    /// # Errors
    /// If the scenario cannot be wired.
    pub(super) fn of(
        scenario: &Scenario,
        source: &Source,
        profile: &Profile,
    ) -> Result<Self, ScenarioError> {
        // The wiring does not depend on the pose of the robot.
        let nowhere = "start = { x_m = 1, y_m = 1, heading_deg = 0 }\n\
            [[wall]]\npath_m = [[0, 0], [2, 0]]";
        let nowhere: WorldSpec = toml::from_str(nowhere).expect("a wall and a start");
        // A car's board needs the axes of its chassis.
        let robot = robots::find(&scenario.robot);
        let chassis = match robot {
            Some(robot) => robot.chassis(scenario, source)?,
            None => None,
        };
        let mut sound = scenario.clone();
        sound.fault.clear();
        let wired = robots::wire_without_start(WirePlan {
            scenario: &sound,
            source,
            world: nowhere.build(0, chassis, source)?,
            dut: Dut::Internal,
            pc: PcEnd::Scripted,
        })?;
        let mut targets = Self::with(scenario, profile, &wired);
        let expect = &scenario.expect;
        let is_search = expect.explored_min.or(expect.victims_within_mm).is_some();
        for device in &mut targets.devices {
            device.has_to_last = is_search && !profile.faults.low_battery_in_search;
            device.never.clone_from(&profile.faults.never);
        }
        Ok(targets)
    }

    fn with(scenario: &Scenario, profile: &Profile, wired: &Wired) -> Self {
        let (rig, instruments) = (&wired.rig, &*wired.instruments);
        // Beside a built-in program, a device that the scenario adds has no client. Without a
        // built-in program, the open ends are those of the program under test.
        let ends = wired.open_ends.iter().filter(|_| rig.program().is_some());
        let open: Vec<&str> = ends.map(|end| end.link.as_str()).collect();
        // The links that the scenario names replace those of its robot.
        let own = scenario.expect.safety.as_ref();
        let own = own.map_or(Vec::new(), |safety| safety.rests_without.clone());
        let needs = instruments.needs().into_iter();
        let keys = instruments.station(rig).and_then(Station::keys);
        // A single axis steers, but does not turn the robot on the spot.
        let turns = |set: &Vec<SetPoint>| set.iter().filter(|axis| axis.0 != 0.0).count() > 1;
        Self {
            orders: Orders::of(instruments, rig),
            starts: starts(instruments, rig),
            never: profile.faults.never.clone(),
            turn: keys.map(|keys| keys.left).filter(turns),
            needs: match own.is_empty() {
                true => needs.map(|need| need.link.into_owned()).collect(),
                false => own,
            },
            consoles: instruments.consoles(),
            hasty: instruments.silence().map(|silence| silence.link),
            drive: instruments.drive_links(),
            runs_on: without_watchdog(instruments),
            has_body: instruments.has_body(),
            ..Self::wired(rig, &open)
        }
    }

    /// Signal levels are not messages: faults of bytes do not apply to them.
    fn wired(rig: &Rig, open: &[&str]) -> Self {
        let links = rig.links().iter();
        let links = links.filter(|link| link.kind != LinkKind::Pin);
        let links = links.filter(|link| !open.contains(&link.name.as_str()));
        let (links, link_kinds) = links.map(|link| (link.name.clone(), link.kind)).unzip();
        let wires = || {
            let wires = rig.links().iter().filter(|link| link.kind != LinkKind::Pin);
            wires.flat_map(|link| &link.lines)
        };
        let devices = rig.device_names().filter(|name| !open.contains(name));
        let device = |name: &str| Device {
            name: name.to_owned(),
            faults: rig.faults_without_start(name),
            has_registers: rig.register(name, 0).is_some(),
            has_messages: wires().any(|line| rig.node_name(line.from.node) == name),
            has_to_last: false,
            never: Vec::new(),
            links: links_of(rig, name),
        };
        Self {
            links,
            link_kinds,
            devices: devices.map(device).collect(),
            consoles: &[],
            never: Vec::new(),
            turn: None,
            needs: Vec::new(),
            hasty: None,
            drive: Vec::new(),
            runs_on: Vec::new(),
            has_body: false,
            orders: Orders::default(),
            starts: Vec::new(),
        }
    }

    /// The first byte of a frame on the line of `fault`.
    pub(super) fn start(&self, fault: &FaultSpec) -> Option<u8> {
        let mut starts = self.starts.iter();
        let is_own =
            |link: &str, way| fault.link.as_deref() == Some(link) && fault.direction == Some(way);
        let found = starts.find(|(link, way, _)| is_own(link, *way));
        found.map(|(.., start)| *start)
    }

    /// The names of the links.
    pub(super) fn links(&self) -> impl Iterator<Item = &str> {
        self.links.iter().map(String::as_str)
    }

    /// Links with a console and the owner of the console; see
    /// [`Instruments::consoles`](robots::Instruments::consoles).
    pub(super) fn consoles(&self) -> impl Iterator<Item = (&'static str, &'static str)> + use<> {
        self.consoles.iter().copied()
    }

    /// The link that commands the axes: its client has a shorter timeout.
    pub(super) const fn hasty(&self) -> Option<&'static str> {
        self.hasty
    }

    /// Whether the device called `name` drives the robot.
    pub(super) fn drives(&self, name: Option<&str>) -> bool {
        let device = self.device(name);
        device.is_some_and(|device| device.links.iter().any(|link| self.drive.contains(link)))
    }

    /// Whether `fault` keeps commands from a drive that then runs on with its last ones.
    pub(super) fn lets_run_on(&self, fault: &FaultSpec) -> bool {
        let is_drive = |link: &String| self.runs_on.contains(link);
        let is_one_way = fault.direction == Some(DirectionSpec::ToMaster);
        let reaches = fault.kind == FaultKind::Unplugged || !is_one_way;
        let is_long = fault.until.is_none_or(|until| {
            until.0.saturating_sub(fault.from.unwrap_or_default().0) > REACTION
        });
        let keeps_back = silences(fault.kind) || fault.kind == FaultKind::Clog;
        keeps_back && reaches && is_long && fault.link.as_ref().is_some_and(is_drive)
    }

    /// Whether there is a robot, which needs time for its mission after the faults.
    pub(super) const fn has_body(&self) -> bool {
        self.has_body
    }

    /// Both directions of each link.
    pub(super) fn lanes(&self) -> Vec<(&str, DirectionSpec)> {
        let both = [DirectionSpec::ToMaster, DirectionSpec::ToDevice];
        let lanes = self.links().flat_map(|link| both.map(|way| (link, way)));
        lanes.collect()
    }

    /// The devices that can have a fault of `kind`, or lose power with others.
    pub(super) fn devices(&self, kind: FaultKind) -> Vec<&Device> {
        let can = |device: &&Device| match kind {
            FaultKind::Delayed => device.has_messages,
            FaultKind::Device => device.of_its_own().next().is_some(),
            FaultKind::PowerDip | FaultKind::Intermittent => device.faults.contains(&"off"),
            _ => device.faults.contains(&kind.name()),
        };
        self.devices.iter().filter(can).collect()
    }

    /// The device called `name`.
    pub(super) fn device(&self, name: Option<&str>) -> Option<&Device> {
        let mut devices = self.devices.iter();
        devices.find(|device| Some(device.name.as_str()) == name)
    }

    /// Devices with registers.
    pub(super) fn with_registers(&self) -> Vec<&Device> {
        let devices = self.devices.iter();
        devices.filter(|device| device.has_registers).collect()
    }

    /// The kinds of faults that any device or link can have.
    pub(super) fn kinds(&self) -> impl Iterator<Item = FaultKind> {
        let can = |kind: &FaultKind| match (kind.place(), kind) {
            (FaultPlace::Line, _) if !self.link_kinds.iter().all(|link| kind.fits(*link)) => false,
            (FaultPlace::Line, FaultKind::Swizzle) => self.links.len() > 1,
            (FaultPlace::Line, _) => !self.links.is_empty(),
            (FaultPlace::Device, _) => !self.devices(*kind).is_empty(),
            (FaultPlace::Devices, _) => self.devices(*kind).len() > 1,
        };
        let is_allowed = |kind: &FaultKind| !self.never.iter().any(|never| never == kind.name());
        let kinds = FaultKind::ALL.iter().copied();
        kinds.filter(is_allowed).filter(can)
    }

    /// The reason why no fault can be drawn, if there is one.
    pub(super) fn lack(&self, profile: &Profile) -> Option<String> {
        if self.kinds().next().is_some() {
            return None;
        }
        let has_parts = !self.links.is_empty() || !self.devices.is_empty();
        Some(match has_parts {
            true => format!(
                "profile {} excludes each kind of fault that its links and devices can have",
                profile.name
            ),
            false => "it has no link and no device".to_owned(),
        })
    }

    /// Links without which the robot cannot drive, of those that can fail.
    pub(super) fn needs(&self) -> impl Iterator<Item = &str> {
        let needs = self.needs.iter().map(String::as_str);
        needs.filter(|need| self.links().any(|link| link == *need))
    }

    /// Set-points that turn the robot on the spot, if it can be driven by hand.
    pub(super) fn turn(&self) -> Option<&[SetPoint]> {
        self.turn.as_deref()
    }
}

/// The links of the device `name`.
fn links_of(rig: &Rig, name: &str) -> Vec<String> {
    let links = rig.links().iter();
    let links = links.filter(|link| {
        let mut lines = link.lines.iter();
        lines.any(|line| rig.node_name(line.from.node) == name)
    });
    links.map(|link| link.name.clone()).collect()
}
/// The links of drives without a watchdog.
fn without_watchdog(instruments: &dyn Instruments) -> Vec<String> {
    let stops = instruments.stops();
    let has_one = |link: &String| {
        let mut known = stops.iter();
        known.any(|stop| stop.link == *link && stop.silence_max.is_some())
    };
    let mut links = instruments.drive_links();
    links.retain(|link| !has_one(link));
    links
}
