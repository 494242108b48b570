//! A lidar that sends one packet per beam: its wire format, its device and its kind of device.
//!
//! ```text
//! 5A | index: 2 degrees each, 0 to 179 | distance, mm, low byte first | sum of these, inverted
//! ```

use core::f64::consts::TAU;
use std::collections::VecDeque;

use hilrig::prelude::*;

/// Beams of a turn.
pub const BEAMS: u8 = 180;
/// Bytes of a packet.
pub const LEN: usize = 5;
const START: u8 = 0x5A;
const RANGE_M: f64 = 6.0;
/// Coding of its line.
pub const LINE: LineConfig = LineConfig::new_8n1(115_200);

/// A beam as sent; distance 0: no reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet([u8; LEN]);

impl Packet {
    /// The packet of a beam.
    pub fn new(index: u8, distance_mm: u16) -> Self {
        let [low, high] = distance_mm.to_le_bytes();
        let head = [START, index, low, high];
        Self([START, index, low, high, sum(&head)])
    }

    /// Number of the beam.
    pub fn index(&self) -> u8 {
        self.0[1]
    }

    /// Distance of the reading.
    pub fn distance_mm(&self) -> u16 {
        u16::from_le_bytes([self.0[2], self.0[3]])
    }

    /// Direction of the beam, radians counter-clockwise from straight ahead.
    pub fn bearing(&self) -> f64 {
        f64::from(self.index()) / f64::from(BEAMS) * TAU
    }
}

fn sum(head: &[u8]) -> u8 {
    !head.iter().fold(0, |sum: u8, byte| sum.wrapping_add(*byte))
}

/// The format of a packet.
#[derive(Clone, Copy, Debug, Default)]
pub struct TurretFormat;

impl Format for TurretFormat {
    type Frame = Packet;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        if bytes[0] != START {
            return Candidate::Noise;
        }
        match *bytes {
            [_, index, ..] if index >= BEAMS => Candidate::Rejected(FrameError::Length {
                max: u32::from(BEAMS) - 1,
                found: index.into(),
            }),
            [a, b, c, d, sent, ..] => match sum(&[a, b, c, d]) {
                expected if expected == sent => Candidate::Complete(LEN),
                expected => Candidate::Rejected(FrameError::Checksum {
                    expected: expected.into(),
                    found: sent.into(),
                }),
            },
            _ => Candidate::Incomplete,
        }
    }

    fn frame(&self, bytes: &[u8]) -> Packet {
        Packet(bytes.try_into().expect("judged complete"))
    }
}

/// Decoder of the packets.
pub type TurretDecoder = Decoder<TurretFormat, 8>;

impl Wire for TurretFormat {
    type Decoder = TurretDecoder;
    const NAME: &'static str = "turret";

    fn decoder() -> TurretDecoder {
        Decoder::default()
    }

    fn bytes(frame: &Packet) -> &[u8] {
        &frame.0
    }

    fn words(frame: &Packet) -> String {
        let degrees = u16::from(frame.index()) * 2;
        format!("{degrees} deg: {} mm", frame.distance_mm())
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        out.extend(Packet::new(choices.byte() % BEAMS, choices.word()).0);
    }

    fn repair(frame: &mut [u8]) {
        if let [start, index, low, high, last, ..] = frame {
            *start = START;
            *index %= BEAMS;
            *last = sum(&[*start, *index, *low, *high]);
        }
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let packet = bytes.get(..LEN)?;
        let total = packet
            .iter()
            .fold(0, |sum: u8, byte| sum.wrapping_add(*byte));
        (packet[0] == START && packet[1] < BEAMS && total == 0xFF).then_some(LEN)
    }
}

/// The format's row of the codec table.
pub const CODEC: Codec = Codec::of::<TurretFormat>("turret, a packet a beam");

/// Whole turns, for a client that draws them.
#[derive(Default)]
pub struct TurretScans {
    decoder: TurretDecoder,
    beams: Vec<Beam>,
}

impl ScanDecoder for TurretScans {
    fn push(&mut self, bytes: &[u8]) -> Option<Vec<Beam>> {
        let mut whole = None;
        for packet in self.decoder.push(bytes).flatten() {
            if packet.index() == 0 {
                whole = Some(core::mem::take(&mut self.beams));
            }
            if packet.distance_mm() > 0 {
                self.beams.push(Beam {
                    bearing: packet.bearing(),
                    distance_m: f64::from(packet.distance_mm()) / 1000.0,
                });
            }
        }
        whole
    }
}

/// The device, mounted at the body's reference point.
#[derive(Clone)]
pub struct Turret {
    period: Duration,
    next: Instant,
    index: u8,
    is_dark: bool,
    out: VecDeque<u8>,
    events: Vec<Event>,
}

impl Device for Turret {
    fn receive(&mut self, _: Port, _: Instant, _: &[u8]) {}

    fn poll(&mut self, now: Instant, world: &mut World) {
        while self.next <= now {
            let pose = world.pose_at(self.next);
            let angle = pose.theta + Packet::new(self.index, 0).bearing();
            let from = Point::new(pose.x, pose.y);
            let hit = world.cast_ray_at(self.next, from, angle, RANGE_M);
            let hit = hit.filter(|_| !self.is_dark);
            let mm = hit.map_or(0.0, |hit| (hit.distance * 1000.0).round());
            self.out.extend(Packet::new(self.index, mm as u16).0);
            self.index = (self.index + 1) % BEAMS;
            self.next += self.period;
        }
    }

    fn transmit(&mut self, _: Port, buf: &mut [u8]) -> usize {
        hilrig::emulators::device::take(&mut self.out, buf)
    }

    fn poll_at(&self) -> Option<Instant> {
        Some(self.next)
    }

    fn line_config(&self, _: Port) -> LineConfig {
        LINE
    }

    fn known_faults(&self) -> &'static [&'static str] {
        &["dark"]
    }

    fn set_fault(&mut self, now: Instant, fault: &str, _: Option<f64>, begins: bool) {
        if fault == "dark" {
            self.is_dark = begins;
            self.events.push(Event {
                at: now,
                kind: EventKind::Note,
                rule: if begins { "dark" } else { "light" },
                detail: "the lamp was switched".to_owned(),
                bytes: Vec::new(),
            });
        }
    }

    fn take_events(&mut self) -> Vec<Event> {
        core::mem::take(&mut self.events)
    }
}

/// `[device.NAME.turret]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(crate = "hilrig::serde", deny_unknown_fields, default)]
#[schemars(crate = "hilrig::schemars")]
pub struct TurretSpec {
    /// Turns per second, 1 to 10; 5 if not given.
    pub turns_per_s: Option<u8>,
}

/// The kind `turret`.
pub struct TurretKind;

impl DeviceKind for TurretKind {
    fn name(&self) -> &'static str {
        "turret"
    }

    fn about(&self) -> &'static str {
        "Lidar that sends a packet a beam"
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<TurretSpec>(generator)
    }

    fn parse(
        &self,
        settings: ValueDeserializer<'_>,
    ) -> Result<Box<dyn Settings>, hilrig::toml::de::Error> {
        read_settings::<TurretSpec>(settings)
    }

    fn scanner(&self, _: &dyn Settings) -> Option<Box<dyn ScanDecoder>> {
        Some(Box::<TurretScans>::default())
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &TurretSpec = context.settings()?;
        let turns = spec.turns_per_s.unwrap_or(5);
        if !(1..=10).contains(&turns) {
            let (source, key) = (context.source, format!("{}.turns_per_s", context.key()));
            let message = format!("is {turns}, expected 1 to 10");
            return Err(source.invalid(source.find("turns_per_s"), key, message));
        }
        let port = PortInfo::uart("uart", Port(0), LINE, "the car's program").in_pieces(LEN);
        let codec = hilrig::codec::find(TurretFormat::NAME);
        let device = Turret {
            period: Duration::from_secs(1) / (u32::from(turns) * u32::from(BEAMS)),
            next: Instant::ZERO,
            index: 0,
            is_dark: false,
            out: VecDeque::new(),
            events: Vec::new(),
        };
        Ok(Built {
            device: Box::new(device),
            ports: vec![codec.map_or(port, |codec| port.speaking(codec))],
        })
    }
}
