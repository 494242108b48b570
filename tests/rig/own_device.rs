//! Devices that a scenario defines by data, tested through the open ends of their links.

use core::time::Duration;
use std::path::Path;

use hilrig::rig::Rig;
use hilrig::robots::{self, Dut, PcEnd, Wired};
use hilrig::run::Run;
use hilrig::run::check::Status;
use hilrig::scenario::{Scenario, ScenarioError, Source};

use super::{in_a_room, run_to_end, shipped};

fn wire((scenario, source): (Scenario, Source)) -> Result<Wired, ScenarioError> {
    robots::wire(&scenario, &source, Dut::External, PcEnd::External)
}

/// Bytes that an open end returns within 20 ms.
fn asked(rig: &mut Rig, node: usize, bytes: &[u8]) -> Vec<u8> {
    rig.inject(node, bytes);
    rig.run_for(Duration::from_millis(20));
    rig.take_output(node).to_vec()
}

fn end(wired: &Wired, name: &str) -> usize {
    let end = wired.open_ends.iter().find(|end| end.name == name);
    end.expect("offered").node
}

/// The robot stands at (1, 1) and looks along y at a wall at 2.7 m: 1700 mm are 06A4. The sums:
/// AB + 04 + 02 = B1, AB + 04 + 82 + A4 + 06 = 1DB.
#[test]
fn a_register_slave_of_ones_own_answers_from_the_world() {
    let mut wired = wire(shipped("own-slave")).expect("sound");
    let gripper = end(&wired, "gripper");
    let reply = asked(&mut wired.rig, gripper, &[0xAB, 4, 2, 0xB1, 0]);
    assert_eq!(reply, [0xAB, 4, 0x82, 0xA4, 0x06, 0xDB, 0x01]);
}

/// Another wall is to its left at 0.3 m, 700 mm away.
#[test]
fn a_text_slave_of_ones_own_answers_from_the_world() {
    let mut wired = wire(shipped("own-slave")).expect("sound");
    let sonar = end(&wired, "sonar");
    assert_eq!(asked(&mut wired.rig, sonar, b"ping\r\n"), b"mm=700\r\n");
    assert_eq!(asked(&mut wired.rig, sonar, b"gain 31\r\n"), b"ok 31\r\n");
    assert_eq!(asked(&mut wired.rig, sonar, b"gain 32\r\n"), b"range\r\n");
    assert_eq!(asked(&mut wired.rig, sonar, b"gian 5\r\n"), b"?\r\n");
    let told: Vec<_> = wired.rig.events().iter().map(ToString::to_string).collect();
    assert!(
        told.iter()
            .any(|e| e.contains("sonar out-of-range: gain = 32")),
        "{told:?}"
    );
    assert!(
        told.iter().any(|e| e.contains("sonar unknown-request")),
        "{told:?}"
    );
    // The sonar sends a line at 1 s; 80 ms have passed.
    wired.rig.run_for(Duration::from_secs(1));
    assert_eq!(&*wired.rig.take_output(sonar), b"mm=700\r\n");
}

/// A run in virtual time has no client at the open ends; the saved case has the devices too.
#[test]
fn a_run_with_devices_of_ones_own_can_be_saved_and_run_again() {
    let (mut scenario, source) = shipped("own-slave");
    scenario.duration = "2s".parse().expect("a time");
    let first = run_to_end((scenario, source));
    let case = Scenario::parse(Path::new("<case>"), first.case.to_toml()).expect("a case");
    assert_eq!(run_to_end(case).trace_hash, first.trace_hash);
}

fn refusal(device: &str) -> String {
    wire(in_a_room("1s", device))
        .err()
        .expect("unsound")
        .to_string()
}

#[test]
fn a_bad_table_is_told_with_its_line_and_key() {
    let table = "[device.own.registers]\nbaud = 9600\n\
        [[device.own.registers.register]]\naddress = 1\nname = \"a\"\nwidth = \"i16\"\n";
    insta::assert_snapshot!(
        refusal(&format!("{table}initial = 40000")),
        @"<test>:11: device.own.registers.register[0].initial: initial is 40000, expected -32768 to 32767"
    );
    let second = "[[device.own.registers.register]]\naddress = 2\nname = \"b\"\nwidth = \"u8\"";
    insta::assert_snapshot!(
        refusal(&format!("{table}{second}")),
        @r#"<test>:12: device.own.registers.register[1].address: address 2 belongs to "a""#
    );
    insta::assert_snapshot!(
        refusal(&table.replace("9600", "9")),
        @"<test>:6: device.own.registers.baud: is 9, expected 300 to 4000000"
    );
    insta::assert_snapshot!(
        refusal(&table.replace(".own.", ".motor.")),
        @"<test>:5: device.motor: the robot has a link of this name, expected another name"
    );
    let text = "[device.own.text]\nbaud = 9600\n[[device.own.text.command]]\nrequest = \"a {b}\"";
    insta::assert_snapshot!(
        refusal(text),
        @r#"<test>:7: device.own.text.command[0].request: "a {b}": there is no variable "b""#
    );
}

const METER: &str = "[device]\nmeter = { description = \"modbus-meter\" }\n";
const PLC: &str = "[device.plc.master]\ndescription = \"modbus-meter\"\nrequests = [\"read voltage\"]\nperiod = \"100ms\"\n";

/// The events of the master and of the device that it polls.
fn told_by_plc(wired: &Wired) -> Vec<String> {
    let all = wired.rig.events().iter().map(ToString::to_string);
    all.filter(|event| event.contains(" plc ") || event.contains(" meter "))
        .collect()
}

/// A master polls a device of the scenario: its link has no open end, and no rule is broken.
/// Without a device it polls the program at its own port; its first request is at 100 ms.
#[test]
fn a_master_polls_a_device_or_a_program() {
    let polled = format!("{METER}{PLC}of = \"meter\"\n");
    let (scenario, source) = in_a_room("2s", &polled);
    let saved = Scenario::parse(Path::new("<saved>"), scenario.to_toml());
    assert_eq!(saved.expect("sound").0.device, scenario.device);
    let mut wired = wire((scenario.clone(), source)).expect("sound");
    assert!(
        wired
            .open_ends
            .iter()
            .all(|end| end.name != "plc" && end.name != "meter")
    );
    wired.rig.run_for(Duration::from_secs(2));
    let values = scenario.device["plc"].values(&wired.rig, "plc");
    let names: Vec<&str> = values.iter().map(|value| &*value.name).collect();
    assert_eq!(names, ["voltage"]);
    assert_eq!(told_by_plc(&wired), [""; 0]);

    let mut wired = wire(in_a_room("2s", PLC)).expect("sound");
    let plc = end(&wired, "plc");
    wired.rig.run_for(Duration::from_millis(120));
    // Function 4, two registers from 0, and their CRC, worked out by hand.
    assert_eq!(*wired.rig.take_output(plc), [1, 4, 0, 0, 0, 2, 0x71, 0xCB]);
    wired.rig.run_for(Duration::from_millis(600));
    let told = told_by_plc(&wired);
    assert!(
        told[0].contains("plc no-reply: \"read voltage\""),
        "{told:?}"
    );
}

#[test]
fn a_wrong_master_is_told_with_its_key() {
    let of = |other: &str| format!("{METER}{PLC}of = \"{other}\"\n");
    let second = PLC.replace(".plc.", ".scada.") + "of = \"meter\"\n";
    let cases = [
        (
            of("metre"),
            "<test>:7: device.plc.master.of: is \"metre\", did you mean \"meter\"?",
        ),
        (
            of("plc"),
            "device.plc.master.of: is \"plc\", expected one of meter",
        ),
        (
            of("meter") + &second,
            "device.scada.master.of: is \"meter\", which \"plc\" polls already",
        ),
        (
            PLC.replace("read voltage", "read wattage"),
            "<test>:7: device.plc.master.requests[0]: ",
        ),
        (
            PLC.replace("100ms", "0s"),
            "<test>:8: device.plc.master.period: is 0s, expected 1ms at least",
        ),
    ];
    for (text, wanted) in cases {
        let told = refusal(&text);
        assert!(told.contains(wanted), "{wanted}: {told}");
    }
}

/// A heater whose state has names.
const HEATER: &str = r#"
name = "heater"
about = "Heater"
line = { baud = 9600 }
[enums]
mode = { 0 = "idle", 1 = "heating", 2 = "fault" }
[frame]
terminator = "\r"
[state]
mode = { initial = 0, enum = "mode" }
[[message]]
name = "ask"
from = "host"
text = "S?"
[[message]]
name = "report"
from = "device"
text = "S={mode:d}"
fields = [{ name = "mode", enum = "mode" }]
[[message]]
name = "heat"
from = "host"
text = "H"
[[on]]
message = "ask"
reply = "report"
[[on]]
message = "heat"
violation = "heats-unasked"
[faults.overheats]
about = "the relay sticks"
set = { mode = 2 }
[faults.drifts]
about = "the mode moves"
set = { mode = "self + factor" }
"#;

/// A reply does not name the registers of a Modbus device. A rule on such a register must not be
/// accepted and then never observed. The second device has other registers; its CO2 is 640 to 660
/// ppm.
#[test]
fn registers_of_modbus_frames_have_names_in_rules() {
    let bench = |condition: &str| {
        let text = format!(
            "schema = 1\nname = \"s\"\nrobot = \"none\"\nduration = \"2s\"\n\
             device.bus = {{ description = [{{ file = \"modbus-meter\", address = 1 }}, \
             {{ file = \"senseair-s8\", address = 2 }}] }}\n\
             [device.plc.master]\ndescription = {{ file = \"senseair-s8\", address = 2 }}\n\
             requests = [\"read co2 alarm_status\", \"write acknowledge=3\"]\n\
             period = \"100ms\"\nof = \"bus\"\n\
             [[expect.rule]]\nname = \"r\"\nalways = {{ frame = {{ link = \"bus\", {condition} }} }}\n"
        );
        let (scenario, source) = Scenario::parse(Path::new("<test>"), text).expect("well-formed");
        Run::new(scenario, &source, None).map(|run| {
            let outcome = run.finish();
            let mut checks = outcome.checks.iter();
            let rule = checks.find(|check| check.name == "rule-r").expect("judged");
            (rule.status, rule.detail.clone())
        })
    };
    for (condition, status) in [
        (
            "direction = \"to-master\", field = \"co2\", op = \">\", value = 639",
            Status::Pass,
        ),
        (
            "direction = \"to-master\", field = \"co2\", op = \">\", value = 650",
            Status::Fail,
        ),
        (
            "direction = \"to-device\", field = \"acknowledge\", value = 3",
            Status::Pass,
        ),
        // The master never asks the meter.
        (
            "direction = \"to-master\", field = \"voltage\", op = \">\", value = 1",
            Status::NotObserved,
        ),
    ] {
        let judged = bench(condition).expect("sound");
        assert_eq!(judged.0, status, "{condition}: {}", judged.1);
    }
    for (condition, words) in [
        (
            "direction = \"to-master\", field = \"alarm_stats\", op = \">\", value = 1",
            "did you mean \"alarm_status\"?",
        ),
        (
            "direction = \"to-device\", field = \"co2\", op = \">\", value = 1",
            "expected one of",
        ),
    ] {
        let error = bench(condition).expect_err("no frame has it").to_string();
        assert!(
            error.contains("field: is") && error.contains(words),
            "{condition}: {error}"
        );
    }
}

/// Each of these was accepted and had no effect, or blamed another key: a coil that equals 3, a
/// misspelt robot without a world.
#[test]
fn what_a_bit_and_a_robot_cannot_be_is_named() {
    let error = |robot: &str, more: &str| {
        let text = format!(
            "schema = 1\nname = \"s\"\nrobot = \"{robot}\"\nduration = \"1s\"\n{METER}{more}"
        );
        let (scenario, source) = Scenario::parse(Path::new("<test>"), text).expect("well-formed");
        let run = Run::new(scenario, &source, None);
        run.err().map_or(String::new(), |error| error.to_string())
    };
    let when = |value: &str| {
        format!(
            "[[fault]]\nkind = \"off\"\ndevice = \"meter\"\n\
             when = {{ device = \"meter\", register = \"relay\", {value} }}\n"
        )
    };
    for sound in ["equals = true", "equals = 0", "at_least = 1"] {
        assert_eq!(error("none", &when(sound)), "", "{sound}");
    }
    let wrong = error("none", &when("equals = 3"));
    let words = "<test>:10: fault[0].when.equals: is 3, but relay of meter is a bit, so \"== 3\" is \
                 never true: expected true or false, or 1 or 0";
    assert_eq!(wrong, words);
    assert!(error("none", &when("at_least = 0")).contains("when.at_least: is 0"));
    let misspelt = error("non", "");
    assert!(misspelt.starts_with("<test>:3: robot: is \"non\", did you mean \"none\"?"));
    assert!(error("custom", "").starts_with("<test>: world: is missing"));
}

/// A condition that compares a value with a name that it cannot have would never hold, or always.
#[test]
fn a_name_that_no_value_has_is_refused_in_every_condition() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("own-device-names");
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::write(folder.join("heater.toml"), HEATER).expect("a file");
    let bench = |more: &str| {
        let text = format!(
            "schema = 1\nname = \"s\"\nrobot = \"none\"\nduration = \"1s\"\n\
             device.heater = {{ description = \"heater.toml\" }}\n{more}"
        );
        Scenario::parse(&folder.join("s.toml"), text).expect("well-formed")
    };
    let error = |condition: &str| {
        let rule = format!("[[expect.rule]]\nname = \"r\"\nnever = {{ {condition} }}\n");
        let (scenario, source) = bench(&rule);
        let wired = Run::new(scenario, &source, None);
        wired.err().map(|error| error.to_string())
    };
    let value = |name: &str| {
        format!("register = {{ device = \"heater\", name = \"mode\", value = {name} }}")
    };
    let frame =
        |keys: &str| format!("frame = {{ link = \"heater\", direction = \"to-master\", {keys} }}");
    let inner = |condition: String| format!("all = [{{ {condition} }}]");
    for sound in [
        value("\"heating\""),
        frame("field = \"mode\", value = \"fault\""),
        frame("contains = \"heat\""),
        frame("contains = \"report: mode 3\""),
        frame("contains = \"unknown message: AB 1C\""),
    ] {
        assert_eq!(error(&sound), None, "{sound}");
    }
    for (wrong, words) in [
        (
            value("\"heatng\""),
            "value: is \"heatng\", did you mean \"heating\"?",
        ),
        (
            inner(value("\"off\"")),
            "expected one of idle, heating, fault",
        ),
        (
            frame("field = \"mode\", value = \"falt\""),
            "did you mean \"fault\"?",
        ),
        (
            frame("field = \"mode\", value = 1"),
            "is 1, but the value has names",
        ),
        (
            frame("field = \"mod\", value = 1"),
            "field: is \"mod\", did you mean \"mode\"?",
        ),
        (
            frame("contains = \"ask\""),
            "which no frame of heater contains",
        ),
        (
            frame("contains = \"report: mode heatin \""),
            "did you mean \"heating\"?",
        ),
        (
            frame("contains = \"heatng\""),
            "contains: has \"heatng\", did you mean \"heating\"?",
        ),
        (
            inner(frame("contains = \"report: overheated\"")),
            "which no frame of heater contains",
        ),
    ] {
        let error = error(&wrong).unwrap_or_default();
        assert!(error.contains(words), "{wrong}: {error}");
    }
    // A rule that the description names, with and without the device.
    for source in ["", ", source = \"heater\""] {
        let event = format!("event = {{ rule = \"heats-unasked\"{source} }}");
        assert_eq!(error(&event), None, "{event}");
    }
    let misspelt = error("event = { rule = \"heats-unaskd\", source = \"heater\" }");
    assert!(misspelt.is_some_and(|error| error.contains("rule: is \"heats-unaskd\"")));
    // Values that the device never has, and damage that changes nothing, are refused.
    for (from, to, words) in [
        (
            "initial = 0, enum",
            "initial = 5, enum",
            "is 5, expected one of 0 (idle), 1 (heating)",
        ),
        ("[enums]", "watchdog = \"0s\"\n[enums]", "watchdog: is 0s"),
    ] {
        std::fs::write(folder.join("heater.toml"), HEATER.replace(from, to)).expect("a file");
        let (scenario, source) = bench("");
        let error = Run::new(scenario, &source, None)
            .err()
            .expect("wrong")
            .to_string();
        assert!(error.contains(words), "{error}");
    }
    std::fs::write(folder.join("heater.toml"), HEATER).expect("a file");
    for (damage, words) in [
        (
            "kind = \"flip\"\nrate = 0.1\nbit = 3",
            "bit: has no effect without byte",
        ),
        (
            "kind = \"burst\"\nbyte = 3\nvalue = 0",
            "value: is 0, which changes no bit",
        ),
        (
            "kind = \"device\"\nfault = \"overheats\"\nfactor = 3",
            "factor: has no effect: the fault overheats of heater has no figure",
        ),
        (
            "kind = \"device\"\nfault = \"off\"\nfactor = 3",
            "factor: has no effect",
        ),
        (
            "kind = \"wrong\"\nfactor = 1",
            "factor: is 1, which changes no value",
        ),
        (
            "kind = \"wrong-baud\"\nppm = 0",
            "ppm: is 0, which changes no rate",
        ),
        (
            "kind = \"short-read\"\nlen = 0",
            "len: is 0, expected 1 to 65535",
        ),
        (
            "kind = \"cut\"\nlasting = \"1s\"\nwhen = { near_m = [0, 0], within_m = 1 }",
            "when.pose: the scenario has no robot",
        ),
        (
            "kind = \"unplugged\"\nback_as = \"control\"",
            "back_as: is \"control\", expected a name that no other link has",
        ),
    ] {
        let is_of_device = ["device\"", "wrong\""]
            .iter()
            .any(|kind| damage.contains(kind));
        let place = match is_of_device {
            true => "device = \"heater\"",
            false => "link = \"heater\"\ndirection = \"to-master\"",
        };
        let fault = format!("[[fault]]\n{place}\n{damage}\n");
        let (scenario, source) = bench(&fault);
        let error = Run::new(scenario, &source, None)
            .err()
            .expect("wrong")
            .to_string();
        assert!(error.contains(words), "{error}");
    }
    for sound in ["kind = \"device\"\nfault = \"drifts\"", "kind = \"slow\""] {
        let (scenario, source) = bench(&format!(
            "[[fault]]\ndevice = \"heater\"\n{sound}\nfactor = 3\n"
        ));
        assert!(Run::new(scenario, &source, None).is_ok(), "{sound}");
    }
    // A step sets the value by its name.
    let step = "[[mission.step]]\nat = \"300ms\"\n\
                do = { set = { device = \"heater\", name = \"mode\", value = \"heating\" } }\n";
    let rule = format!(
        "[[expect.rule]]\nname = \"r\"\nfrom = \"200ms\"\neventually = {{ {} }}\n",
        value("\"heating\"")
    );
    let heats = |more: &str| {
        let outcome = run_to_end(bench(more));
        let mut checks = outcome.checks.iter();
        checks
            .find(|check| check.name == "rule-r")
            .expect("judged")
            .status
            == Status::Pass
    };
    assert!(heats(&format!("{step}{rule}")) && !heats(&rule));
}

/// A kind of device from another crate: it sends its settings over a datagram link.
mod beacon {
    use emulators::world::World;
    use emulators::{Device, Event};
    use hilrig::rig::LinkKind;
    use hilrig::scenario::device::{
        BuildContext, Built, DeviceKind, PortInfo, Settings, read_settings, schema_of,
    };
    use hilrig::scenario::{ScenarioError, Span};
    use protocols::{Instant, LineConfig, Port};
    use schemars::{JsonSchema, Schema, SchemaGenerator};
    use serde::{Deserialize, Serialize};
    use toml::Spanned;
    use toml::de::ValueDeserializer;

    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    pub(super) struct BeaconSpec {
        /// Time between two packets.
        pub(super) period: Span,
        /// The text that is sent; the order of the two keys does not matter.
        #[schemars(with = "String")]
        pub(super) called: Spanned<String>,
    }

    pub(super) struct BeaconKind;

    impl DeviceKind for BeaconKind {
        fn name(&self) -> &'static str {
            "beacon"
        }

        fn about(&self) -> &'static str {
            "Sends its name"
        }

        fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
            schema_of::<BeaconSpec>(generator)
        }

        fn parse(
            &self,
            settings: ValueDeserializer<'_>,
        ) -> Result<Box<dyn Settings>, toml::de::Error> {
            read_settings::<BeaconSpec>(settings)
        }

        fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
            let spec: &BeaconSpec = context.settings()?;
            if spec.called.get_ref().is_empty() {
                let key = format!("{}.called", context.key());
                return Err(context.source.invalid(
                    Some(spec.called.span()),
                    key,
                    "is empty, expected a name",
                ));
            }
            let line = LineConfig::new_8n1(1_000_000);
            let air = PortInfo::uart("air", Port(0), line, "a listener").on(LinkKind::Datagram);
            Ok(Built {
                device: Box::new(Beacon {
                    spec: spec.clone(),
                    next: Instant::ZERO + spec.period.0,
                    packets: 0,
                }),
                ports: vec![air],
            })
        }
    }

    #[derive(Clone)]
    struct Beacon {
        spec: BeaconSpec,
        next: Instant,
        packets: usize,
    }

    impl Device for Beacon {
        fn receive(&mut self, _: Port, _: Instant, _: &[u8]) {}

        fn poll(&mut self, now: Instant, _: &mut World) {
            while self.next <= now {
                self.next += self.spec.period.0;
                self.packets += 1;
            }
        }

        fn transmit(&mut self, _: Port, buf: &mut [u8]) -> usize {
            let name = self.spec.called.get_ref().as_bytes();
            if self.packets == 0 {
                return 0;
            }
            self.packets -= 1;
            buf[..name.len()].copy_from_slice(name);
            name.len()
        }

        fn poll_at(&self) -> Option<Instant> {
            Some(self.next)
        }

        fn line_config(&self, _: Port) -> LineConfig {
            LineConfig::new_8n1(1_000_000)
        }

        fn take_events(&mut self) -> Vec<Event> {
            Vec::new()
        }
    }
}

const BEACON: &str = "[device.lamp.beacon]\nperiod = \"10ms\"\ncalled = \"abc\"\n";

fn register_beacon() {
    // Each test of this process may be the first.
    let _ = hilrig::scenario::device::register(beacon::BeaconKind);
}

/// A device kind may come from another crate. Its settings are read and written back unchanged, and
/// its device is wired to the kind of link that it needs.
#[test]
fn a_kind_of_another_crate_is_one_like_ours() {
    register_beacon();
    let again = hilrig::scenario::device::register(beacon::BeaconKind);
    let taken = again.expect_err("its name is taken").to_string();
    assert_eq!(taken, "the name \"beacon\" is already taken");

    let (scenario, source) = in_a_room("1s", BEACON);
    let text = scenario.to_toml();
    assert!(text.contains(BEACON.trim_end()), "{text}");
    let saved = Scenario::parse(Path::new("<saved>"), text)
        .expect("sound")
        .0;
    assert_eq!(saved, scenario);
    let spec: &beacon::BeaconSpec = scenario.device["lamp"].settings().expect("its settings");
    assert_eq!(spec.period.to_string(), "10ms");

    let mut wired = wire((scenario, source)).expect("sound");
    let lamp = end(&wired, "lamp");
    wired.rig.run_for(Duration::from_millis(25));
    assert_eq!(wired.rig.take_messages(lamp), [&b"abc"[..], b"abc"]);
}

#[test]
fn the_settings_of_such_a_kind_are_told_with_their_place() {
    register_beacon();
    insta::assert_snapshot!(
        refusal(&BEACON.replace("abc", "")),
        @r#"<test>:7: device.lamp.beacon.called: is empty, expected a name"#
    );
    let fault =
        "[[fault]]\nkind = \"flip\"\nlink = \"lamp\"\ndirection = \"to-master\"\nrate = 1.0\n";
    insta::assert_snapshot!(
        refusal(&format!("{BEACON}{fault}")),
        @r#"<test>:9: fault[0].kind: flip has no effect on "lamp", a link of kind datagram, expected one of kind uart, pin"#
    );
    let reorder = fault.replace("flip", "reorder");
    assert!(wire(in_a_room("1s", &format!("{BEACON}{reorder}"))).is_ok());
}
