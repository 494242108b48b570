//! A kind of device of your own: a thermometer that says its figure now and then. Once registered,
//! scenarios name it like those that come with the tool, and everything else knows it as well:
//! faults, captures, the page, saved cases.
//!
//! `cargo run --example own_device`

use std::collections::VecDeque;
use std::io::Read as _;

use hilrig::emulators::device::take;
use hilrig::prelude::*;
use hilrig::toml::de::Error;

/// `[device.NAME.thermometer]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(crate = "hilrig::serde", deny_unknown_fields)]
#[schemars(crate = "hilrig::schemars")]
struct ThermometerSpec {
    /// Time between two readings.
    period: Span,
    /// The temperature that the sensor reads, degrees Celsius.
    celsius: f64,
}

/// Sends `21.5 C` and a newline each period, and receives nothing.
#[derive(Clone)]
struct Thermometer {
    spec: ThermometerSpec,
    next: Instant,
    out: VecDeque<u8>,
}

const LINE: LineConfig = LineConfig::new_8n1(9600);

impl Device for Thermometer {
    fn receive(&mut self, _: Port, _: Instant, _: &[u8]) {}

    fn poll(&mut self, now: Instant, _: &mut World) {
        while self.next <= now {
            let line = format!("{:.1} C\n", self.spec.celsius);
            self.out.extend(line.bytes());
            self.next += self.spec.period.0;
        }
    }

    fn transmit(&mut self, _: Port, buf: &mut [u8]) -> usize {
        take(&mut self.out, buf)
    }

    fn poll_at(&self) -> Option<Instant> {
        Some(self.next)
    }

    fn line_config(&self, _: Port) -> LineConfig {
        LINE
    }

    fn take_events(&mut self) -> Vec<Event> {
        Vec::new()
    }
}

struct ThermometerKind;

impl DeviceKind for ThermometerKind {
    fn name(&self) -> &'static str {
        "thermometer"
    }

    fn about(&self) -> &'static str {
        "Says how warm it is"
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<ThermometerSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, Error> {
        read_settings::<ThermometerSpec>(settings)
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &ThermometerSpec = context.settings()?;
        if spec.period.0.is_zero() {
            let (source, key) = (context.source, format!("{}.period", context.key()));
            return Err(source.invalid(source.find("period"), key, "is 0, expected more"));
        }
        let device = Thermometer {
            spec: spec.clone(),
            next: Instant::ZERO + spec.period.0,
            out: VecDeque::new(),
        };
        Ok(Built {
            device: Box::new(device),
            ports: vec![PortInfo::uart("uart", Port(0), LINE, "your program")],
        })
    }
}

const SCENARIO: &str = r#"
schema = 1
name = "warm"
robot = "none"
duration = "5s"
device.room.thermometer = { period = "500ms", celsius = 21.5 }
world.start = { x_m = 0, y_m = 0, heading_deg = 0 }
"#;

fn main() -> Result<(), Box<dyn core::error::Error>> {
    register_device(ThermometerKind)?;
    let (scenario, source) = Scenario::from_text(SCENARIO)?;
    let bench = Bench::new(scenario, &source)?;
    let mut line = [0; 7];
    bench.port("room")?.read_exact(&mut line)?;
    assert_eq!(&line, b"21.5 C\n");
    // Seven bytes of ten bits at 9600 baud after the first half second.
    assert_eq!(bench.now().as_micros(), 507_291);
    bench.judge().assert_passed();
    Ok(())
}
