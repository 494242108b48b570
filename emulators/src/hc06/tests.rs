//! The module between a robot that sends at its line's rate and a host that always reads.

mod reference;

use super::*;
use crate::rng::Rng;
use crate::world::{BodyConfig, Pose, Scene, Shape};

const BAUD: u32 = 460_800;
const SECOND: Duration = Duration::from_secs(1);

pub(crate) fn empty_world() -> World {
    let scene = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("nothing is wrong with nothing");
    World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("an empty place is free")
}

/// A module whose ends are read as soon as the UART's byte time allows.
pub(crate) struct Bench {
    pub(crate) radio: Hc06,
    pub(crate) now: Instant,
    /// Bytes that one call of `receive` gets at most.
    pub(crate) piece: usize,
    /// Bytes received by the robot, with the end of each byte.
    pub(crate) robot: Vec<(Instant, u8)>,
    /// Bytes received by the host.
    pub(crate) host: Vec<(Instant, u8)>,
    /// Connection events seen by the host.
    pub(crate) changes: Vec<(Instant, LineEvent)>,
    pub(crate) events: Vec<Event>,
    robot_busy_until: Instant,
    world: World,
}

impl Bench {
    pub(crate) fn new(profile: Profile) -> Self {
        Self {
            radio: Hc06::new(profile, 7),
            now: Instant::ZERO,
            piece: 1,
            robot: Vec::new(),
            host: Vec::new(),
            changes: Vec::new(),
            events: Vec::new(),
            robot_busy_until: Instant::ZERO,
            world: empty_world(),
        }
    }

    /// A module at 460800 baud whose host is connected, some time after.
    fn connected(profile: Profile) -> Self {
        let mut bench = Self::new(profile);
        bench.open();
        bench.run_for(2 * SECOND);
        assert_eq!(bench.radio.mode(), Mode::Data);
        bench.events.clear();
        bench
    }

    pub(crate) fn open(&mut self) {
        self.radio
            .line_event(Hc06::AIR, self.now, LineEvent::Opened);
        self.settle();
    }

    pub(crate) fn close(&mut self) {
        self.radio
            .line_event(Hc06::AIR, self.now, LineEvent::Closed);
        self.settle();
    }

    pub(crate) fn run_for(&mut self, time: Duration) {
        self.run_until(self.now + time);
    }

    pub(crate) fn run_until(&mut self, until: Instant) {
        loop {
            let line_free = Some(self.robot_busy_until).filter(|&at| at > self.now);
            let next = earliest([self.radio.poll_at(), line_free]);
            match next {
                Some(at) if at <= until => {
                    self.now = at.max(self.now + Duration::from_nanos(1));
                    self.settle();
                }
                _ => break,
            }
        }
        self.now = self.now.max(until);
        self.settle();
    }

    fn settle(&mut self) {
        self.radio.poll(self.now, &mut self.world);
        let mut buf = [0; 64];
        while let len @ 1.. = self.radio.transmit(Hc06::AIR, &mut buf) {
            self.host
                .extend(buf[..len].iter().map(|&byte| (self.now, byte)));
        }
        if self.robot_busy_until <= self.now && self.radio.transmit(Hc06::UART, &mut buf[..1]) == 1
        {
            self.robot_busy_until = self.now + self.radio.line_config(Hc06::UART).byte_time();
            self.robot.push((self.robot_busy_until, buf[0]));
        }
        while let Some(change) = self.radio.line_change(Hc06::AIR) {
            self.changes.push((self.now, change));
        }
        self.events.extend(self.radio.take_events());
    }

    /// The robot sends `bytes` back to back at the module's rate.
    pub(crate) fn robot_sends(&mut self, bytes: &[u8]) {
        let line = self.radio.line_config(Hc06::UART);
        let start = self.now;
        let mut sent = 0;
        for piece in bytes.chunks(self.piece) {
            sent += piece.len();
            self.run_until(start + line.bytes_time(sent as u64));
            self.radio.receive(Hc06::UART, self.now, piece);
            self.settle();
        }
    }

    /// The host writes `bytes` at once.
    pub(crate) fn host_sends(&mut self, bytes: &[u8]) {
        self.radio.receive(Hc06::AIR, self.now, bytes);
        self.settle();
    }

    /// Sends a command and waits for as long as a careful master does: 1.2 s.
    fn command(&mut self, text: &[u8]) -> String {
        let before = self.robot.len();
        self.robot_sends(text);
        self.run_for(Duration::from_millis(1_200));
        text_of(&self.robot[before..])
    }

    pub(crate) fn rules(&self) -> Vec<&'static str> {
        self.events.iter().map(|event| event.rule).collect()
    }

    fn violations(&self) -> Vec<&'static str> {
        let guilty = |event: &&Event| event.kind == EventKind::Violation;
        let guilty = self.events.iter().filter(guilty);
        guilty.map(|event| event.rule).collect()
    }
}

fn text_of(bytes: &[(Instant, u8)]) -> String {
    let bytes: Vec<u8> = bytes.iter().map(|&(_, byte)| byte).collect();
    String::from_utf8(bytes).expect("ASCII")
}

fn at(baud: u32) -> Profile {
    Profile::default().at_baud(baud)
}

/// Bytes with the value of their own number.
fn numbered(len: u32) -> Vec<u8> {
    (0..len).map(|n| (n % 251) as u8).collect()
}

// ---- command mode ----

/// A public configuration tool reads back one run of text: every reply to `AT`, `AT+VERSION`,
/// `AT+PIN1234`, `AT+NAMEx`, `AT+BAUD7`, from a linvor 1.5.
#[test]
fn a_linvor_session_is_the_public_transcript() {
    let mut profile = Profile::of(Family::Linvor18);
    profile.texts.version = "OKlinvorV1.5";
    let mut bench = Bench::new(profile);
    let session = [
        b"AT".as_slice(),
        b"AT+VERSION",
        b"AT+PIN4711",
        b"AT+NAMEopenEMG",
        b"AT+BAUD7",
    ];
    let transcript = session.map(|text| bench.command(text)).concat();

    assert_eq!(transcript, "OKOKlinvorV1.5OKsetPINOKsetnameOK57600");
    let settings = bench.radio.settings();
    assert_eq!(
        (&settings.name[..], settings.pin),
        (&b"openEMG"[..], *b"4711")
    );
    assert_eq!(bench.radio.line_config(Hc06::UART).baud, 57_600);
    assert_eq!(bench.violations(), [""; 0]);
}

/// Module guides for the 2.0 firmware: no OK before the version, roles and the LED are known.
#[test]
fn an_hc01_session_has_its_own_words() {
    let mut bench = Bench::new(Profile::of(Family::Hc01V20));
    assert_eq!(bench.command(b"AT+VERSION"), "hc01.comV2.0");
    assert_eq!(bench.command(b"AT+ROLE=S"), "OK+ROLE:S");
    assert_eq!(bench.command(b"AT+LED0"), "LED OFF");
    assert_eq!(bench.radio.lamp(), Lamp::Dark);
    assert_eq!(bench.command(b"AT+PE"), "OK EVEN");
    assert_eq!(bench.command(b"AT+NAMEx"), "OKsetname");
    assert_eq!(bench.violations(), [""; 0]);
}

/// The 3.0 firmware answers each line at once, and not to the other families' settings.
#[test]
fn a_3_0_session_is_made_of_lines() {
    let mut bench = Bench::new(Profile::of(Family::V30));
    bench.robot_sends(b"AT+VERSION\r\nAT+NAME=bot\r\nAT+NAME\r\nAT+PSWD=\"4711\"\r\n");
    bench.robot_sends(b"AT+PSWD\r\nAT+UART=230400,0,0\r\n");
    bench.run_for(SECOND);
    bench.robot_sends(b"AT+UART\r\nAT+BAUD8\r\n");
    bench.run_for(SECOND);

    assert_eq!(
        text_of(&bench.robot),
        "VERSION:3.0-20170609\r\nOK\r\nOK\r\n+NAME:bot\r\nOK\r\nOK\r\n+PIN:\"4711\"\r\nOK\r\n\
         OK\r\n+UART:230400,0,0\r\nOK\r\nERROR:(0)\r\n"
    );
    assert_eq!(bench.radio.line_config(Hc06::UART).baud, 230_400);
    assert_eq!(bench.violations(), ["unknown-command"]);
}

/// `AT+ORGL` restores the default settings.
#[test]
fn a_restored_3_0_module_is_as_shipped() {
    let mut bench = Bench::new(Profile::of(Family::V30).at_baud(115_200));
    bench.robot_sends(b"AT+NAME=bot\r\nAT+ORGL\r\n");
    bench.run_for(SECOND);
    assert_eq!(*bench.radio.settings(), Profile::of(Family::V30).settings);
    assert_eq!(bench.radio.line_config(Hc06::UART).baud, 9_600);
}

/// The silence counts from the end of a command, not from its beginning: if two commands begin 0.5
/// s apart, they are one text.
#[test]
fn half_a_second_between_two_beginnings_is_too_short() {
    let mut bench = Bench::new(Profile::default());
    let start = bench.now;
    bench.robot_sends(b"AT");
    bench.run_until(start + SECOND / 2);
    bench.robot_sends(b"AT+VERSION");
    bench.run_for(2 * SECOND);

    assert_eq!(text_of(&bench.robot), "");
    assert_eq!(bench.violations(), ["no-pause-between-commands"]);
}

/// The reply begins half a second after the last byte: 2 bytes at 9600 baud end at 2.083 ms.
#[test]
fn the_reply_comes_half_a_second_after_the_command() {
    let mut bench = Bench::new(Profile::default());
    bench.robot_sends(b"AT");
    bench.run_for(2 * SECOND);
    let first_byte_ends = bench.robot[0].0;
    // The time is that of 2 + 1 bytes of 1041.666 us, plus half a second.
    assert_eq!(first_byte_ends, Instant::from_nanos(503_124_999));
}

/// Pauses of public tools that configure real modules, after their last byte, in milliseconds: 550
/// and 600 (scripts), 1000 (three sketches with a delay of one second), 1200 (an automatic tester).
/// Each tool gets its whole reply, and its next command is recognised as a command.
#[test]
fn f6_the_waits_of_six_public_tools_are_long_enough() {
    let session: [(&[u8], &str); 5] = [
        (b"AT", "OK"),
        (b"AT+VERSION", "OKlinvorV1.8"),
        (b"AT+NAMErescue", "OKsetname"),
        (b"AT+PIN1234", "OKsetPIN"),
        (b"AT+BAUD4", "OK9600"),
    ];
    for wait_ms in [550, 600, 1_000, 1_000, 1_000, 1_200] {
        let mut bench = Bench::new(Profile::default());
        for (command, reply) in session {
            let before = bench.robot.len();
            bench.robot_sends(command);
            let sent = LineConfig::new_8n1(9_600).bytes_time(command.len() as u64);
            bench.run_for(sent + Duration::from_millis(wait_ms));
            assert_eq!(text_of(&bench.robot[before..]), reply, "{wait_ms} ms");
        }
        assert_eq!(bench.violations(), [""; 0]);
    }
}

/// The silence is the profile's: a module that takes a second answers after a second.
#[test]
fn f6_the_silence_can_be_set() {
    let mut bench = Bench::new(Profile {
        silence: SECOND,
        ..Profile::default()
    });
    bench.robot_sends(b"AT");
    bench.run_for(2 * SECOND);
    assert_eq!(bench.robot[0].0, Instant::from_nanos(1_003_124_999));
}

/// F7, the module's own side: the configured line coding is reported as soon as it is used, so a
/// rig that judges a client by it blames the right one.
#[test]
fn f7_the_line_that_the_module_tells_is_the_one_it_uses() {
    let mut bench = Bench::new(Profile::default());
    assert_eq!(bench.radio.line_config(Hc06::UART).baud, 9_600);
    bench.robot_sends(b"AT+BAUD8");
    bench.run_for(SECOND);
    assert_eq!(text_of(&bench.robot), "OK115200");
    assert_eq!(bench.radio.line_config(Hc06::UART).baud, 115_200);
}

/// Typing by hand fails, pasting works.
#[test]
fn a_command_typed_by_hand_is_refused() {
    let mut bench = Bench::new(Profile::default());
    for byte in b"AT+VERSION" {
        bench.robot_sends(&[*byte]);
        bench.run_for(Duration::from_millis(200));
    }
    bench.run_for(2 * SECOND);
    assert_eq!(text_of(&bench.robot), "");
    assert_eq!(bench.violations(), ["command-too-slow"]);
}

/// Each wrong command is judged, and the module answers none.
#[test]
fn guilty_commands_are_judged_and_vanish() {
    let mut bench = Bench::new(Profile::default());
    let guilty = [
        b"AT\r\n".as_slice(),
        b"at",
        b"AT+BAUDX",
        b"AT+NAMEthisnameislongerthan20",
    ];
    let replies = guilty.map(|text| bench.command(text)).concat();
    assert_eq!(replies, "");
    assert_eq!(
        bench.violations(),
        [
            "line-end-after-command",
            "lower-case-command",
            "unknown-command",
            "unknown-command"
        ]
    );
}

/// The reply goes out in the old coding, the next command is read in the new one.
#[test]
fn the_reply_to_a_new_rate_is_still_in_the_old_one() {
    let mut bench = Bench::new(Profile::default());
    assert_eq!(bench.command(b"AT+BAUD1"), "OK1200");
    let [.., (before, _), (last, _)] = bench.robot[..] else {
        panic!("six bytes");
    };
    assert_eq!((last - before).as_micros(), 1_041);
    assert_eq!(bench.radio.line_config(Hc06::UART).baud, 1_200);
}

#[test]
fn the_new_rate_can_be_that_of_the_reply_or_of_the_next_start() {
    let profile = |line_switch| Profile {
        line_switch,
        ..Profile::default()
    };
    let mut bench = Bench::new(profile(LineSwitch::BeforeReply));
    bench.command(b"AT+BAUD8");
    let [.., (before, _), (last, _)] = bench.robot[..] else {
        panic!("eight bytes");
    };
    assert_eq!((last - before).as_micros(), 86);

    let mut bench = Bench::new(profile(LineSwitch::AtPowerOn));
    bench.command(b"AT+BAUD8");
    assert_eq!(bench.radio.line_config(Hc06::UART).baud, 9_600);
    bench.radio.power_cycle(bench.now);
    assert_eq!(bench.radio.line_config(Hc06::UART).baud, 115_200);
}

/// Settings survive; a command under way does not.
#[test]
fn settings_outlast_the_power_and_half_a_command_does_not() {
    let mut bench = Bench::new(Profile::default());
    bench.command(b"AT+NAMErescue");
    bench.command(b"AT+BAUDA");
    bench.robot_sends(b"AT+NA");
    bench.radio.power_off(bench.now);
    assert_eq!(
        (bench.radio.mode(), bench.radio.lamp()),
        (Mode::Off, Lamp::Dark)
    );
    bench.robot_sends(b"AT");
    bench.run_for(2 * SECOND);
    bench.radio.power_on(bench.now);

    assert_eq!(bench.command(b"AT"), "OK");
    assert_eq!(bench.radio.settings().name, b"rescue");
    assert_eq!(bench.radio.line_config(Hc06::UART).baud, BAUD);
}

// ---- connection ----

/// Data mode begins one connect delay after the host opens, and ends as it closes.
#[test]
fn opening_the_port_connects_and_closing_it_disconnects() {
    let mut bench = Bench::new(at(BAUD));
    bench.run_for(SECOND);
    bench.open();
    bench.run_for(Duration::from_millis(999));
    assert_eq!(
        (bench.radio.mode(), bench.radio.lamp()),
        (Mode::Command, Lamp::Blinking)
    );
    bench.run_for(Duration::from_millis(1));
    assert_eq!(
        (bench.radio.mode(), bench.radio.lamp()),
        (Mode::Data, Lamp::Steady)
    );
    assert_eq!(bench.changes, [(Instant::from_secs(2), LineEvent::Opened)]);

    bench.close();
    assert_eq!(bench.radio.mode(), Mode::Command);
    assert_eq!(bench.rules(), ["connected", "disconnected"]);
}

/// A host that closes before the connection stands never gets one.
#[test]
fn a_port_closed_early_never_connects() {
    let mut bench = Bench::new(at(BAUD));
    bench.open();
    bench.run_for(Duration::from_millis(500));
    bench.close();
    bench.run_for(5 * SECOND);
    assert_eq!(
        (bench.radio.mode(), &bench.changes[..]),
        (Mode::Command, &[][..])
    );
}

/// Bytes sent without a connection are unknown commands: they vanish.
#[test]
fn bytes_sent_before_the_connection_are_never_delivered() {
    let mut bench = Bench::new(at(BAUD));
    bench.robot_sends(&numbered(300));
    bench.open();
    bench.run_for(2 * SECOND);
    bench.robot_sends(b"hello");
    bench.run_for(SECOND);

    assert_eq!(text_of(&bench.host), "hello");
    assert_eq!(bench.rules(), ["data-in-command-mode", "connected"]);
    assert!(
        bench.events[1].detail.starts_with("300 bytes"),
        "{:?}",
        bench.events[1]
    );
}

/// Half a command typed before is forgotten: `AT` before and `+BAUD1` after the connection.
#[test]
fn half_a_command_does_not_outlast_a_connection() {
    let mut bench = Bench::new(at(BAUD));
    bench.robot_sends(b"AT");
    bench.open();
    bench.run_for(SECOND);
    bench.close();
    bench.robot_sends(b"+BAUD1");
    bench.run_for(2 * SECOND);
    assert_eq!(bench.radio.line_config(Hc06::UART).baud, BAUD);
}

/// Commands are data while connected; the master gets a report.
#[test]
fn a_command_while_connected_goes_to_the_host() {
    let mut bench = Bench::connected(at(BAUD));
    bench.robot_sends(b"AT+BAUD1");
    bench.run_for(2 * SECOND);
    assert_eq!(text_of(&bench.host), "AT+BAUD1");
    assert_eq!(bench.violations(), ["command-while-connected"]);
    assert_eq!(bench.radio.line_config(Hc06::UART).baud, BAUD);
}

/// A command inside a flow of data is not one: it has no silence around it.
#[test]
fn a_command_inside_a_flow_is_innocent() {
    let mut bench = Bench::connected(at(BAUD));
    bench.robot_sends(b"time: 3, AT+BAUD1, quality: 7");
    bench.run_for(2 * SECOND);
    assert_eq!(bench.violations(), [""; 0]);
}

/// After a disconnect the robot's own bytes can reconfigure the module: a payload that is exactly
/// a command between two silences.
#[test]
fn a_payload_between_two_silences_reconfigures_after_a_disconnect() {
    let mut bench = Bench::connected(at(BAUD));
    bench.close();
    bench.robot_sends(b"PCUI_MSG with AT+BAUD1 inside");
    bench.run_for(2 * SECOND);
    assert_eq!(bench.radio.line_config(Hc06::UART).baud, BAUD);
    bench.robot_sends(b"AT+BAUD1");
    bench.run_for(2 * SECOND);
    assert_eq!(bench.radio.line_config(Hc06::UART).baud, 1_200);
}

/// Radio silence is noticed after 20 s, by both sides; before that the module keeps its bytes.
#[test]
fn a_lost_radio_is_noticed_after_the_supervision_time() {
    let mut bench = Bench::connected(at(BAUD));
    bench.changes.clear();
    let lost_at = bench.now;
    bench.radio.set_radio(lost_at, Radio::Lost);
    bench.robot_sends(&numbered(1_000));
    bench.run_until(lost_at + Duration::from_millis(19_999));
    assert_eq!(
        (bench.radio.mode(), bench.radio.up().lost),
        (Mode::Data, 300)
    );
    assert_eq!(bench.host, []);

    bench.run_for(Duration::from_millis(1));
    assert_eq!(bench.radio.mode(), Mode::Command);
    assert_eq!(bench.changes, [(lost_at + 20 * SECOND, LineEvent::Closed)]);
    assert_eq!(bench.radio.up().dropped, 700);
    // The host does not know it yet.
    bench.host_sends(b"late");
    assert_eq!(bench.violations(), ["fifo-overflow"; 2]);
}

/// A gap shorter than the supervision time loses only the bytes that did not fit the FIFO.
#[test]
fn a_radio_that_comes_back_delivers_what_was_held() {
    let mut bench = Bench::connected(at(BAUD));
    bench.radio.set_radio(bench.now, Radio::Lost);
    bench.robot_sends(&numbered(700));
    bench.run_for(5 * SECOND);
    bench.radio.set_radio(bench.now, Radio::InReach);
    bench.run_for(60 * SECOND);

    let got: Vec<u8> = bench.host.iter().map(|&(_, byte)| byte).collect();
    assert_eq!(got, numbered(700));
    assert_eq!(bench.radio.mode(), Mode::Data);
}

/// The module gets no notice if the host closes while the radio is out of reach.
#[test]
fn a_host_that_closes_out_of_reach_is_noticed_when_it_returns() {
    let mut bench = Bench::connected(at(BAUD));
    bench.radio.set_radio(bench.now, Radio::Lost);
    bench.close();
    bench.open();
    bench.run_for(5 * SECOND);
    assert_eq!(bench.radio.mode(), Mode::Data);
    bench.radio.set_radio(bench.now, Radio::InReach);
    assert_eq!(bench.radio.mode(), Mode::Command);
    bench.run_for(SECOND);
    assert_eq!(bench.radio.mode(), Mode::Data);
}

/// The host keeps the connection of a module without power until the supervision time is over.
#[test]
fn a_power_cycle_is_a_dead_connection_for_the_host() {
    let mut bench = Bench::connected(at(BAUD));
    bench.changes.clear();
    let at = bench.now;
    bench.radio.power_cycle(at);
    assert_eq!(bench.radio.mode(), Mode::Command);
    bench.robot_sends(b"telemetry");
    bench.run_for(30 * SECOND);
    assert_eq!(bench.host, []);
    assert_eq!(bench.changes, [(at + 20 * SECOND, LineEvent::Closed)]);
}

/// The supervision time counts from the first silence, whatever else goes wrong meanwhile.
#[test]
fn a_power_cut_does_not_prolong_the_supervision_time() {
    let mut bench = Bench::connected(at(BAUD));
    bench.changes.clear();
    let lost_at = bench.now;
    bench.radio.set_radio(lost_at, Radio::Lost);
    bench.run_for(5 * SECOND);
    bench.radio.power_off(bench.now);
    bench.run_for(30 * SECOND);
    assert_eq!(bench.changes, [(lost_at + 20 * SECOND, LineEvent::Closed)]);
}

/// Whether bytes survive a disconnect is not documented: the profile offers both.
#[test]
fn leftovers_are_dropped_or_kept_as_the_profile_says() {
    let mut profile = at(BAUD);
    for (leftovers, expected) in [(Leftovers::Dropped, ""), (Leftovers::Kept, "late")] {
        profile.leftovers = leftovers;
        let mut bench = Bench::connected(profile.clone());
        bench.robot_sends(b"late");
        bench.close();
        bench.open();
        bench.run_for(3 * SECOND);
        assert_eq!(text_of(&bench.host), expected);
    }
}

// ---- throughput ----

/// Field measurement and arithmetic: 46.08 kB/s come in, 20.5 kB/s go out, and the FIFO holds 700
/// bytes. The first byte is lost after 700 * 46.08 / 25.58 = 1,261 bytes, 27 ms after the
/// beginning.
#[test]
fn a_flood_at_460800_loses_its_first_byte_after_1260() {
    let mut bench = Bench::connected(at(BAUD));
    bench.robot_sends(&[0x55; 1_134]);
    assert_eq!(bench.radio.up().lost, 0);
    bench.robot_sends(&[0x55; 252]);
    assert!(bench.radio.up().lost > 0);
    let first_loss = bench.events[0].at - Instant::from_secs(2);
    assert!(
        (26_700..28_000).contains(&first_loss.as_micros()),
        "{first_loss:?}"
    );
    assert_eq!(bench.violations(), ["fifo-overflow"]);
}

/// With 23.04 kB/s coming in, the overflow comes after 700 * 23.04 / 2.54 = 6.35 kB.
#[test]
fn a_flood_at_230400_overflows_after_some_six_kilobytes() {
    let mut bench = Bench::connected(at(230_400));
    bench.piece = 16;
    bench.robot_sends(&[0x55; 5_700]);
    assert_eq!(bench.radio.up().lost, 0);
    bench.robot_sends(&[0x55; 1_300]);
    assert!(bench.radio.up().lost > 0);
}

/// 11.52 kB/s in: the radio keeps up forever, and the bytes arrive unchanged.
#[test]
fn a_flood_at_115200_loses_nothing() {
    let mut bench = Bench::connected(at(115_200));
    bench.piece = 16;
    let sent = numbered(60_000);
    bench.robot_sends(&sent);
    bench.run_for(SECOND);
    let got: Vec<u8> = bench.host.iter().map(|&(_, byte)| byte).collect();
    assert!(got == sent);
    assert_eq!(bench.violations(), [""; 0]);
}

/// Field measurement at 921600 baud: about 21 kB/s of 92 get through (22 %), in order.
#[test]
fn a_long_flood_delivers_what_the_radio_can_carry() {
    let mut bench = Bench::connected(at(921_600));
    bench.piece = 64;
    bench.robot_sends(&numbered(184_320));
    bench.run_for(SECOND);
    // The radio carries 20.5 kB/s for two seconds, and the FIFO holds 700 bytes more.
    assert!(
        (41_500..41_900).contains(&bench.host.len()),
        "{}",
        bench.host.len()
    );
    let share = bench.host.len() * 1_000 / 184_320;
    assert_eq!(share, 226);
}

/// The host may write at any rate: all bytes reach the robot, at the radio's rate.
#[test]
fn the_host_is_held_up_and_loses_nothing() {
    let mut bench = Bench::connected(at(921_600));
    let sent = numbered(50_000);
    bench.host_sends(&sent);
    bench.run_for(3 * SECOND);
    let got: Vec<u8> = bench.robot.iter().map(|&(_, byte)| byte).collect();
    assert!(got == sent);
    // 50,000 B at 20.5 kB/s take 2.44 s.
    let took = bench.robot[49_999].0 - Instant::from_secs(2);
    assert!((2_400..2_500).contains(&took.as_millis()), "{took:?}");
}

/// The robot's UART may be slower than the radio: 9600 baud carry 960 B/s.
#[test]
fn a_slow_uart_holds_the_radio_up() {
    let mut bench = Bench::connected(at(9_600));
    let sent = numbered(9_600);
    bench.host_sends(&sent);
    bench.run_for(11 * SECOND);
    let got: Vec<u8> = bench.robot.iter().map(|&(_, byte)| byte).collect();
    assert!(got == sent);
    assert!(bench.robot[9_599].0 >= Instant::from_secs(12));
}

/// Loopback at the module was measured as 10.8 kB/s: both directions share its processor.
#[test]
fn load_on_both_directions_halves_each() {
    let mut bench = Bench::connected(at(460_800));
    bench.piece = 16;
    bench.host_sends(&numbered(40_000));
    bench.robot_sends(&numbered(46_080));
    let (up, down) = (bench.host.len(), bench.robot.len());
    assert!((9_700..10_400).contains(&up), "{up}");
    assert!((9_700..10_400).contains(&down), "{down}");
}

/// The first bytes after a pause take 25 to 40 ms, later ones 5 to 15 ms, on a grid of 3.75 ms.
#[test]
fn latency_is_high_after_a_pause_and_low_in_a_flow() {
    let mut bench = Bench::connected(at(BAUD));
    let mut sent = Vec::new();
    for _ in 0..40 {
        bench.robot_sends(b"x");
        sent.push(bench.now);
        bench.run_for(Duration::from_millis(50));
    }
    let latency = |n: usize| (bench.host[n].0 - sent[n]).as_micros();
    assert!((25_000..=40_100).contains(&latency(0)));
    let flow: Vec<u128> = (1..40).map(latency).collect();
    assert!(
        flow.iter().all(|us| (5_000..=15_100).contains(us)),
        "{flow:?}"
    );
    assert!(
        bench
            .host
            .iter()
            .all(|(at, _)| at.as_nanos() % 3_750_000 == 0)
    );
}

/// A frame of the radio holds at most 127 bytes, and the grid one frame a slot.
#[test]
fn bursts_are_radio_frames() {
    let mut bench = Bench::connected(at(BAUD));
    bench.robot_sends(&numbered(1_200));
    bench.run_for(SECOND);
    let bursts: Vec<usize> = bench
        .host
        .chunk_by(|a, b| a.0 == b.0)
        .map(<[_]>::len)
        .collect();
    assert_eq!(bursts.iter().sum::<usize>(), 1_200);
    assert!(bursts.iter().all(|&len| len <= 127), "{bursts:?}");
}

/// The cutting of the robot's bytes into pieces concerns the rig: within a frame's slot no result
/// may depend on it.
#[test]
fn pieces_of_any_size_lose_the_same_bytes() {
    let run = |piece| {
        let mut bench = Bench::connected(at(BAUD));
        bench.piece = piece;
        bench.robot_sends(&numbered(4_000));
        bench.run_for(SECOND);
        (bench.host, bench.radio.up())
    };
    assert_eq!(run(1), run(1));
    let (single, pieces) = (run(1), run(40));
    assert!(
        single.1.lost.abs_diff(pieces.1.lost) <= 40,
        "{:?} {:?}",
        single.1,
        pieces.1
    );
}

/// A module with another seed has other latencies, one with the same seed has the same.
#[test]
fn the_seed_decides_the_latencies() {
    let run = |seed| {
        let mut bench = Bench::connected(at(BAUD));
        bench.radio = Hc06::new(at(BAUD), seed);
        bench.open();
        bench.run_for(2 * SECOND);
        for _ in 0..20 {
            bench.robot_sends(b"x");
            bench.run_for(SECOND);
        }
        bench.host
    };
    assert_eq!(run(3), run(3));
    assert_ne!(run(3), run(4));
}

/// Bytes are conserved: each is delivered, lost, dropped or still inside.
#[test]
fn every_byte_is_accounted_for() {
    let mut bench = Bench::connected(at(BAUD));
    bench.robot_sends(&numbered(3_000));
    bench.close();
    let Traffic {
        accepted,
        lost,
        dropped,
        delivered,
    } = bench.radio.up();
    assert_eq!(accepted + lost, 3_000);
    assert_eq!(accepted, dropped + delivered);
    assert_eq!(delivered, bench.host.len() as u64);
}

/// The link reports characters without a stop bit: the master's rate is wrong.
#[test]
fn framing_errors_are_judged_once_a_second() {
    let mut bench = Bench::connected(at(BAUD));
    for _ in 0..100 {
        bench
            .radio
            .line_event(Hc06::UART, bench.now, LineEvent::FramingError);
        bench.run_for(Duration::from_millis(1));
    }
    bench.run_for(5 * SECOND);
    assert_eq!(bench.violations(), ["framing-error", "framing-error"]);
    assert!(bench.events[1].detail.starts_with("99 more"));
}

/// A host that writes a mebibyte at once loses bytes; one that checks for room loses none.
#[test]
fn a_host_that_does_not_wait_is_judged() {
    let mut bench = Bench::connected(at(BAUD));
    let room = bench.radio.room(Hc06::AIR);
    assert_eq!(room, 1 << 20);
    bench.host_sends(&vec![0; room]);
    assert_eq!(bench.violations(), [""; 0]);
    assert_eq!(bench.radio.room(Hc06::AIR), 0);
    bench.host_sends(&[1, 2, 3]);
    assert_eq!(bench.violations(), ["host-overflow"]);
    assert_eq!(bench.radio.down().lost, 3);
}

/// Bytes over a port that is not open come from a wrongly wired rig, or a foreign program.
#[test]
fn bytes_over_a_closed_port_are_judged() {
    let mut bench = Bench::new(at(BAUD));
    bench.host_sends(b"hello");
    bench.open();
    bench.host_sends(b"world");
    bench.run_for(2 * SECOND);
    assert_eq!(bench.violations(), ["host-port-closed"]);
    assert_eq!(text_of(&bench.robot), "world");
}

/// A host that closes its port drops the bytes on the way; later ones are foreign.
#[test]
fn bytes_on_the_way_at_the_close_are_dropped() {
    let mut bench = Bench::connected(at(BAUD));
    bench.close();
    bench.run_for(Duration::from_millis(99));
    bench.host_sends(b"last");
    assert_eq!(bench.violations(), [""; 0]);
    bench.run_for(Duration::from_millis(1));
    bench.host_sends(b"foreign");
    assert_eq!(bench.violations(), ["host-port-closed"]);
}

/// The line-terminated family waits for its line end forever; the judge does not.
#[test]
fn a_line_without_its_end_is_judged_and_waits() {
    let mut bench = Bench::new(Profile::of(Family::V30));
    assert_eq!(bench.command(b"AT+"), "");
    bench.run_for(20 * SECOND);
    assert_eq!(
        bench.command(b"VERSION\r\n"),
        "VERSION:3.0-20170609\r\nOK\r\n"
    );
    assert_eq!(bench.violations(), ["line-end-missing"]);
}

/// Only the name among all commands can include the line end that a terminal program adds. The
/// module obeys, and shows a name with a line end on the air.
#[test]
fn a_line_end_becomes_part_of_the_name() {
    let mut bench = Bench::new(Profile::default());
    assert_eq!(bench.command(b"AT+NAMEbot\r\n"), "OKsetname");
    assert_eq!(bench.radio.settings().name, b"bot\r\n");
    assert_eq!(bench.violations(), ["line-end-after-command"]);
}

/// Finding T3: the fault of this name is the lost radio. No byte passes; the bytes that fit the
/// FIFO of 700 arrive once it ends, and the connection survives the 20 s.
#[test]
fn out_of_reach_begins_and_ends_by_its_name() {
    let mut bench = Bench::connected(at(BAUD));
    bench.radio.set_fault(bench.now, "out-of-reach", None, true);
    assert_eq!(bench.radio.radio(), Radio::Lost);
    bench.robot_sends(&numbered(700));
    bench.host_sends(&numbered(10));
    bench.run_for(5 * SECOND);
    assert_eq!((bench.host.len(), bench.robot.len()), (0, 0));
    bench
        .radio
        .set_fault(bench.now, "out-of-reach", None, false);
    assert_eq!(bench.radio.radio(), Radio::InReach);
    bench.run_for(60 * SECOND);
    assert_eq!((bench.host.len(), bench.robot.len()), (700, 10));
    assert_eq!(bench.radio.mode(), Mode::Data);
}

/// Finding T3: of 1,000 bytes, 700 wait. The others are lost, reported once and then only counted.
#[test]
fn an_overflow_is_told_with_its_size() {
    let mut bench = Bench::connected(at(BAUD));
    bench.radio.set_fault(bench.now, "out-of-reach", None, true);
    bench.robot_sends(&numbered(700));
    assert_eq!(bench.violations(), [""; 0]);
    bench.robot_sends(&numbered(1));
    assert_eq!(bench.violations(), ["fifo-overflow"]);
    let told = bench.events.last().map(|event| event.detail.as_str());
    assert_eq!(told, Some("a byte was lost: 700 B wait for the radio"));
    assert_eq!(bench.radio.up().lost, 1);
}

/// Finding T3: without a carrier the air needs no poll, and with one again it needs one at once.
#[test]
fn a_lost_carrier_needs_no_poll() {
    let mut bench = Bench::connected(at(BAUD));
    bench.radio.set_fault(bench.now, "out-of-reach", None, true);
    bench.robot_sends(&numbered(3));
    bench.run_for(2 * SECOND);
    // The supervision time is all that is left to wait for.
    let next = bench.radio.poll_at().expect("the supervision time");
    assert!(next - bench.now > 17 * SECOND, "{next}");
    bench
        .radio
        .set_fault(bench.now, "out-of-reach", None, false);
    let next = bench.radio.poll_at().expect("bytes to move");
    assert!(next - bench.now < SECOND / 10, "{next}");
}

/// The same rate once more changes nothing and is not reported; another rate is.
#[test]
fn only_other_settings_are_told() {
    let mut bench = Bench::new(at(9600));
    bench.command(b"AT+BAUD4");
    let told = |bench: &mut Bench| {
        let events = core::mem::take(&mut bench.events);
        let told = events
            .into_iter()
            .filter(|event| event.rule == "settings-changed");
        told.map(|event| event.detail).collect::<Vec<_>>()
    };
    assert_eq!(told(&mut bench), [""; 0]);
    bench.command(b"AT+NAMErobot");
    assert_eq!(told(&mut bench), ["by \"AT+NAMErobot\""]);
    bench.command(b"AT+NAMErobot");
    assert_eq!(told(&mut bench), [""; 0]);
}

/// Bytes that came out and were not taken count as dropped, and no longer as delivered.
#[test]
fn what_nobody_took_was_not_delivered() {
    let mut lane = lane::Lane::new(&at(BAUD), 100, Rng::stream(1, "lane"));
    lane.put_ready(b"twelve bytes");
    let mut buf = [0; 4];
    assert_eq!(lane.take(&mut buf), 4);
    lane.drop_ready();
    let traffic = lane.traffic();
    assert_eq!((traffic.delivered, traffic.dropped), (4, 8));
    assert!(lane.is_drained());
    lane.push(b"abc", Instant::ZERO, Duration::from_micros(50));
    lane.drop_under_way();
    assert_eq!((lane.traffic().dropped, lane.traffic().accepted), (11, 3));
}

/// The fault by its name: no mode, no line. With power again the state is that of a fresh start.
#[test]
fn off_begins_and_ends_by_its_name() {
    let mut bench = Bench::connected(at(BAUD));
    bench.radio.set_fault(bench.now, "off", None, true);
    bench.robot_sends(b"telemetry");
    bench.host_sends(b"orders");
    bench.run_for(SECOND);
    assert_eq!((bench.host.len(), bench.robot.len()), (0, 0));
    assert_ne!(bench.radio.mode(), Mode::Data);
    bench.radio.set_fault(bench.now, "off", None, false);
    bench.run_for(30 * SECOND);
    assert_eq!(bench.host.len(), 0);
    bench.robot_sends(b"AT");
    bench.run_for(2 * SECOND);
    assert_eq!(text_of(&bench.robot), "OK");
}

/// The window limits the bytes under way plus those delivered and not taken. Four bytes are taken
/// from a full window of 10; then four more go over.
#[test]
fn what_nobody_takes_holds_the_air_up() {
    let mut profile = at(BAUD);
    (profile.window, profile.frame_max) = (10, 100);
    let mut lane = lane::Lane::new(&profile, 100, Rng::stream(1, "lane"));
    let step = Duration::from_micros(50);
    assert!(!lane.is_waiting() && !lane.is_moving() && lane.is_drained());
    lane.push(&[7; 40], Instant::ZERO, step);
    assert!(!lane.is_waiting() && lane.is_moving());
    let later = Instant::from_millis(900);
    lane.shift(Instant::ZERO, later, step);
    assert_eq!(lane.room(), 100 - 30);
    lane.deliver();
    assert!(lane.is_waiting() && !lane.is_moving() && !lane.is_drained());
    let mut buf = [0; 4];
    assert_eq!(lane.take(&mut buf), 4);
    lane.shift(later, later + SECOND, step);
    assert_eq!(lane.room(), 100 - 26);
}

/// A radio of 1 MB/s with a UART of 9600 baud. A byte takes 1.04 ms. So of a hundred bytes reported
/// at once, the first ones have gone over the air, and the last ones are still under way.
#[test]
fn a_fast_radio_waits_for_each_byte_of_the_uart() {
    let mut profile = at(9_600);
    profile.rate_bytes_s = 1_000_000;
    let came = |piece: usize| {
        let mut bench = Bench::connected(profile.clone());
        for piece in numbered(100).chunks(piece) {
            let bytes = u32::try_from(piece.len()).expect("short");
            bench.now += bench.radio.line_config(Hc06::UART).byte_time() * bytes;
            bench.radio.receive(Hc06::UART, bench.now, piece);
        }
        let told = bench.now;
        bench.run_for(SECOND);
        assert_eq!(bench.host.len(), 100);
        assert!(bench.host[99].0 > told, "{:?} {told:?}", bench.host[99]);
        bench.host
    };
    assert_eq!(came(1), came(100));
}

/// Each end may send while bytes wait for it.
#[test]
fn an_end_may_send_what_waits_for_it() {
    let mut bench = Bench::connected(at(BAUD));
    let sends =
        |bench: &Bench| [Hc06::UART, Hc06::AIR, Port(7)].map(|port| bench.radio.may_send(port));
    assert_eq!(sends(&bench), [false; 3]);
    let mut world = empty_world();
    bench.radio.receive(Hc06::UART, bench.now, b"up");
    bench.radio.poll(bench.now + SECOND, &mut world);
    assert_eq!(sends(&bench), [false, true, false]);
    let mut buf = [0; 8];
    assert_eq!(bench.radio.transmit(Hc06::AIR, &mut buf), 2);
    bench.radio.receive(Hc06::AIR, bench.now + SECOND, b"down");
    bench.radio.poll(bench.now + 2 * SECOND, &mut world);
    assert_eq!(sends(&bench), [true, false, false]);
    assert_eq!(bench.radio.transmit(Hc06::UART, &mut buf), 4);
    bench
        .radio
        .line_event(Hc06::AIR, bench.now + 2 * SECOND, LineEvent::Closed);
    assert!(!bench.radio.may_send(Hc06::UART));
}

/// Bytes under way count in the window as well: of 10 bytes six are moved at once, and four later,
/// whichever end waits.
#[test]
fn what_is_under_way_fills_the_window() {
    let mut profile = at(BAUD);
    (profile.window, profile.frame_max) = (10, 100);
    let mut lane = lane::Lane::new(&profile, 100, Rng::stream(1, "lane"));
    let step = Duration::from_micros(50);
    lane.push(&[7; 40], Instant::ZERO, step);
    lane.shift(Instant::ZERO, Instant::ZERO + step * 6, step);
    assert_eq!((lane.room(), lane.is_moving()), (100 - 34, true));
    lane.shift(Instant::ZERO, Instant::from_millis(900), step);
    assert_eq!((lane.room(), lane.is_moving()), (100 - 30, false));
    lane.deliver();
    assert_eq!(lane.traffic().delivered, 10);
}

/// Window 10, in four states: no bytes; bytes with room on the air; bytes that have filled the
/// window; bytes that fill it with nothing behind. Only the second moves, and only the third waits.
#[test]
fn a_lane_moves_what_has_room_and_waits_with_what_has_none() {
    let mut profile = at(BAUD);
    (profile.window, profile.frame_max) = (10, 100);
    let step = Duration::from_micros(50);
    let lane_of = |bytes: &[u8], is_shifted: bool| {
        let mut lane = lane::Lane::new(&profile, 100, Rng::stream(1, "lane"));
        lane.push(bytes, Instant::ZERO, step);
        if is_shifted {
            lane.shift(Instant::ZERO, Instant::from_millis(900), step);
        }
        (lane.is_moving(), lane.is_waiting())
    };
    assert_eq!(lane_of(&[], false), (false, false));
    assert_eq!(lane_of(&[7; 40], false), (true, false));
    assert_eq!(lane_of(&[7; 40], true), (false, true));
    assert_eq!(lane_of(&[7; 10], true), (false, false));
}

/// No command is longer than 64 bytes: without a connection the 65th of a flow shows at once that
/// bytes vanish. With one, a flow is data.
#[test]
fn a_flow_without_a_connection_is_noted_at_its_65th_byte() {
    let mut bench = Bench::new(at(BAUD));
    bench.robot_sends(&[b'A'; 64]);
    assert_eq!(bench.rules(), [""; 0]);
    bench.robot_sends(b"A");
    assert_eq!(bench.rules(), ["data-in-command-mode"]);
    let mut connected = Bench::connected(at(BAUD));
    connected.robot_sends(&[b'A'; 70]);
    assert_eq!(connected.rules(), [""; 0]);
}

/// A module that uses a new rate from its next start on uses it after a reset by command.
#[test]
fn a_reset_by_command_is_a_start() {
    let mut bench = Bench::new(Profile {
        line_switch: LineSwitch::AtPowerOn,
        ..Profile::of(Family::V30)
    });
    let baud = |bench: &Bench| bench.radio.line_config(Hc06::UART).baud;
    bench.robot_sends(b"AT+UART=115200,0,0\r\n");
    bench.run_for(SECOND);
    assert_eq!(baud(&bench), 9_600);
    bench.robot_sends(b"AT+RESET\r\n");
    bench.run_for(SECOND);
    assert_eq!(baud(&bench), 115_200);
}
