//! The interface of the rescue robot.

use core::time::Duration;

use emulators::avr_base::AvrBase;
use emulators::pc::Pc;
use emulators::touch_panel::{self, TouchPanel};
use emulators::world::Pose;
use firmware_core::map_view::MapView;
use firmware_core::robots::rescue::Rescue;
use protocols::Instant;
use protocols::avr::{self, registers};

use super::{CONSOLES, SET_POINT_MAX, SILENCE, command, display, view};
use crate::codec::Codec;
use crate::rig::Rig;
use crate::robots::instruments::{counted, in_metres};
use crate::robots::{
    Alarm, Asking, Axis, Console, Cycle, Dialect, Display, Figure, Found, Instruments, Intake,
    Need, Overlay, OverlayRole, Panel, ScanDecoder, Silence, Station,
};
use crate::scenario::device::xv11_scans::Xv11Scans;

/// Maximum age of a reported pose: it belongs to the last scan, whose search takes up to 150 ms,
/// and is transmitted by radio.
const TOLD_AGE: Duration = Duration::from_millis(250);

/// Speed of a wheel with one tick per 40 ms (seed report).
const TICK_MM_S: f64 = 11.345;

const ALARMS: [Alarm; 2] = [
    Alarm {
        link: "lidar",
        counter: "lidar silences",
    },
    Alarm {
        link: "base",
        counter: "base silences",
    },
];

const INTAKES: [Intake; 3] = [
    Intake::new("lidar", |rig| {
        counted(rig, &["lidar packets"], &["lidar packets bad"])
    }),
    Intake::new("base", |rig| {
        let accepted = ["base answers", "base unsolicited", "base errors"];
        counted(rig, &accepted, &["base bad frames"])
    }),
    Intake::new("radio", |rig| {
        counted(rig, &["radio frames"], &["radio bad frames"])
    }),
];

const COMPLAINTS: [Alarm; 11] = [
    Alarm::new("base", "base retries"),
    Alarm::new("base", "base failures"),
    Alarm::new("base", "base silences"),
    Alarm::new("base", "base errors"),
    Alarm::new("base", "base bad frames"),
    Alarm::new("base", "base queue overflows"),
    Alarm::new("base", "encoder readings disbelieved"),
    Alarm::new("lidar", "lidar packets bad"),
    Alarm::new("lidar", "lidar silences"),
    Alarm::new("radio", "radio bad frames"),
    Alarm::new("radio", "radio queue overflows"),
];

/// Register and control byte of a bus frame.
fn is_of(frame: &[u8], register: u8, is_write: bool) -> bool {
    matches!(frame, [_, address, control, ..]
        if *address == register && (control & 0x80 != 0) == is_write)
}

/// The id of a frame of the PC link.
fn has_id(frame: &[u8], id: [u8; 3]) -> bool {
    frame.get(14..17) == Some(&id)
}

/// The program's periods are 150, 40 and 1000 ms on the bus, 50, 200, 40 and 1000 ms on the radio.
const CYCLES: [Cycle; 7] = [
    Cycle::new("base", "set-points", Duration::from_millis(400), |frame| {
        is_of(frame, registers::SPEED_LEFT_TO, true)
    })
    .at_most(80),
    Cycle::new(
        "base",
        "request for the wheels",
        Duration::from_millis(300),
        |frame| is_of(frame, registers::ENCODER_LEFT, false),
    )
    .at_most(100),
    Cycle::new(
        "base",
        "request for the battery",
        Duration::from_secs(2),
        |frame| is_of(frame, registers::BATTERY_MV, false),
    )
    .except(&["base silent"])
    .at_most(10),
    Cycle::new("radio", "pose", Duration::from_millis(600), |frame| {
        has_id(frame, *b"MPD")
    })
    .at_most(60)
    .optional(),
    Cycle::new("radio", "state", Duration::from_millis(800), |frame| {
        has_id(frame, *b"STA")
    })
    .at_most(20)
    .optional(),
    Cycle::new("radio", "row of the map", Duration::from_secs(2), |frame| {
        has_id(frame, *b"MAR") || has_id(frame, *b"MAP")
    })
    .optional(),
    Cycle::new("radio", "diagnosis", Duration::from_secs(3), |frame| {
        has_id(frame, *b"DIA")
    })
    .at_most(8)
    .optional(),
];

/// Whether `reply` answers `request`: the register of the request, data for a read, none for a
/// write.
fn is_answer(request: &[u8], reply: &[u8]) -> bool {
    let ([_, asked, wanted, ..], [_, register, control, ..]) = (request, reply) else {
        return false;
    };
    let reads = wanted & 0x80 == 0;
    let expected = if reads { wanted | 0x80 } else { 0 };
    asked == register && *control == expected && *register != avr::ERROR_REGISTER
}

/// Maximum difference of a reported charge, per cent.
const CHARGE: f64 = 20.0;
/// Maximum difference of a reported voltage: a second of noise.
const VOLTAGE_MV: f64 = 500.0;

/// The robot's instruments: the rig contains all their data.
#[derive(Clone, Copy, Debug)]
pub(super) struct RescueInstruments;

fn pc(rig: &Rig) -> Option<&Pc> {
    rig.device("pc")
}

impl Instruments for RescueInstruments {
    fn axes(&self, rig: &Rig) -> Vec<Axis> {
        let Some(base) = rig.device::<AvrBase>("base") else {
            return Vec::new();
        };
        let axis = |(name, set_point): (&'static str, i16)| Axis {
            name: name.into(),
            unit: "ticks per 40 ms",
            set_point: set_point.into(),
            limit: Some(SET_POINT_MAX.into()),
            actual: None,
        };
        let [left, right] = base.set_points();
        [("left wheel", left), ("right wheel", right)]
            .map(axis)
            .to_vec()
    }

    fn dialect(&self, rig: &Rig) -> Option<Dialect> {
        command::dialect(rig)
    }

    fn silence(&self) -> Option<Silence> {
        Some(SILENCE)
    }

    /// The pose of a program in this process, if it has one; otherwise the pose reported to the PC.
    fn estimate(&self, rig: &Rig) -> Option<(Instant, Pose)> {
        match rig.program() {
            Some(program) => program.estimate().map(|(at, pose)| (at, in_metres(pose))),
            None => {
                let pc = pc(rig)?;
                let (at, _) = pc.record().map_properties?;
                Some((at, pc.stated_pose()?))
            }
        }
    }

    fn estimate_age(&self, rig: &Rig) -> Duration {
        match rig.program() {
            Some(_) => Duration::ZERO,
            None => TOLD_AGE,
        }
    }

    /// The map of a program in this process; otherwise the map that the PC received.
    fn map<'a>(&'a self, rig: &'a Rig) -> Option<MapView<'a>> {
        match rig.program() {
            Some(program) => program.map(),
            None => Station::map(pc(rig)?),
        }
    }

    fn layers<'a>(&'a self, rig: &'a Rig) -> Vec<(&'static str, MapView<'a>)> {
        let received = pc(rig).and_then(Station::map);
        received.map(|map| ("pc", map)).into_iter().collect()
    }

    fn scanner(&self, _: &Rig) -> Option<(String, Box<dyn ScanDecoder>)> {
        let scans = Xv11Scans::new(view::FIRST_BEARING);
        Some((view::SCAN_LINK.to_owned(), Box::new(scans)))
    }

    /// The victims marked by a program in this process; otherwise those reported to the PC.
    fn overlays(&self, rig: &Rig) -> Vec<Overlay> {
        let own = self.found(rig).map(|found| found.places);
        let told = || pc(rig).map(view::told_victims);
        let places = own.or_else(told).unwrap_or_default();
        let empty = Overlay::new("victims", OverlayRole::Mark);
        let victims = places.into_iter().fold(empty, Overlay::point);
        [victims]
            .into_iter()
            .filter(|one| !one.is_empty())
            .collect()
    }

    /// The victims marked by a program in this process.
    fn found(&self, rig: &Rig) -> Option<Found> {
        let mut places = Vec::new();
        rig.program()?.victims(&mut |place| {
            let metres = |mm: f32| f64::from(mm) / 1000.0;
            places.push([metres(place.x_mm), metres(place.y_mm)]);
        });
        let base = rig.device::<AvrBase>("base");
        Some(Found {
            places,
            kits: base.map(|base| base.kits().len()),
        })
    }

    fn panels(&self, rig: &Rig) -> Vec<Panel> {
        let told = pc(rig).and_then(view::diagnosis);
        view::registers(rig).into_iter().chain(told).collect()
    }

    fn display<'a>(&'a self, rig: &'a Rig) -> Option<Display<'a>> {
        let panel = rig.device::<TouchPanel>(display::NAME)?;
        Some(Display {
            width: touch_panel::WIDTH,
            pixels: panel.pixels(),
            is_on: panel.is_on(),
        })
    }

    fn tap(&self, rig: &mut Rig, at: Instant, place: [u16; 2]) -> bool {
        let panel = rig.device_to_plan::<TouchPanel>(display::NAME);
        panel.map(|panel| panel.tap(at, place)).is_some()
    }

    fn station<'a>(&'a self, rig: &'a Rig) -> Option<&'a dyn Station> {
        pc(rig).map(|pc| pc as &dyn Station)
    }

    fn station_mut<'a>(&'a self, rig: &'a mut Rig) -> Option<&'a mut dyn Station> {
        let pc = rig.device_to_plan::<Pc>("pc")?;
        Some(pc)
    }

    fn codec(&self, rig: &Rig, link: &str) -> Option<&'static Codec> {
        view::protocol(rig, link)
    }

    /// The base with its wheel counters; the lidar except when driven by hand; the PC when driven
    /// by hand.
    fn needs(&self) -> Vec<Need> {
        let by_hand: &[&str] = &["manual"];
        vec![
            Need::always("base"),
            Need::always("lidar").except(by_hand),
            Need::always("radio").only(by_hand),
        ]
    }

    fn orders_link(&self) -> Option<&'static str> {
        Some("radio")
    }

    /// The duty of the lidar's motor and the picture are sent when they change.
    fn sporadic_links(&self) -> &'static [&'static str] {
        &["motor", "display"]
    }

    fn station_links(&self) -> &'static [&'static str] {
        &["radio", "pc"]
    }

    fn alarms(&self) -> &'static [Alarm] {
        &ALARMS
    }

    fn intakes(&self) -> &'static [Intake] {
        &INTAKES
    }

    fn complaints(&self) -> &'static [Alarm] {
        &COMPLAINTS
    }

    fn cycles(&self) -> &'static [Cycle] {
        &CYCLES
    }

    fn asking(&self) -> Option<Asking> {
        Some(Asking {
            link: "base",
            is_answer,
            counter: "base answers",
        })
    }

    fn reckoned(&self, rig: &Rig) -> Option<(Instant, Pose)> {
        let (at, pose) = rig.program_as::<Rescue>()?.dead_reckoned()?;
        Some((at, in_metres(pose)))
    }

    /// In generated rooms the error is 10 mm at most.
    fn accuracy(&self) -> Option<[f64; 2]> {
        Some([100.0, 5.0])
    }

    fn goal_modes(&self) -> &'static [&'static str] {
        &["waypoint", "home"]
    }

    /// The reported pose and mode with those of the program, the reported charge, speeds and
    /// set-points with those of the base.
    fn figures(&self, rig: &Rig) -> Vec<Figure> {
        let mut figures = Vec::new();
        let Some(record) = pc(rig).map(Pc::record) else {
            return figures;
        };
        let stated = record.map_properties.map(|(at, _)| at);
        let pose = pc(rig).and_then(Pc::stated_pose);
        // Between two scans, and without a lidar, the program reports its pose by the wheels.
        let own = rig.program_as::<Rescue>();
        if let (Some(at), Some(told), Some(own)) = (stated, pose, own) {
            let own = in_metres(own.pose_at(rig.now()));
            figures.extend(Figure::of_pose(at, told, own));
        }
        let base = rig.device::<AvrBase>("base");
        if let (Some((at, told)), Some(base)) = (record.diagnosis, base)
            && told.battery_percent >= 0
        {
            figures.push(Figure {
                name: "the charge of the battery, per cent",
                at,
                told: told.battery_percent.into(),
                truth: f64::from(base.register(registers::BATTERY_PERCENT).cast_signed()),
                tolerance: CHARGE,
                wrong_min: 1,
            });
            let word = [registers::BATTERY_MV, registers::BATTERY_MV + 1];
            figures.push(Figure {
                name: "the voltage of the battery, mV",
                at,
                told: told.battery_mv.into(),
                truth: u16::from_le_bytes(word.map(|address| base.register(address))).into(),
                tolerance: VOLTAGE_MV,
                // A robot that runs has a voltage.
                wrong_min: match told.battery_mv {
                    0 => 1,
                    _ => Figure::CHANGING,
                },
            });
        }
        if let (Some((at, state)), Some(base)) = (record.state, base) {
            let addresses = [registers::SPEED_LEFT_IS, registers::SPEED_RIGHT_IS];
            let names = [
                "the speed of the left wheel, mm/s",
                "the speed of the right wheel, mm/s",
            ];
            for ((name, address), told) in names.into_iter().zip(addresses).zip(state.speed_mm_s) {
                figures.push(Figure {
                    name,
                    at,
                    told: told.into(),
                    truth: f64::from(base.register(address).cast_signed()) * TICK_MM_S,
                    tolerance: 2.0 * TICK_MM_S,
                    wrong_min: Figure::CHANGING,
                });
            }
            let names = [
                "the set-point of the left wheel",
                "the set-point of the right wheel",
            ];
            let set_points = names
                .into_iter()
                .zip(state.set_point)
                .zip(base.set_points());
            figures.extend(set_points.map(|((name, told), truth)| Figure {
                name,
                at,
                told: told.into(),
                truth: truth.into(),
                tolerance: 1.0,
                wrong_min: Figure::CHANGING,
            }));
        }
        if let (Some((at, state)), Some(own)) = (record.state, own) {
            figures.push(Figure::of_mode(at, state.mode as u8, own.mode() as u8));
        }
        figures
    }

    fn consoles(&self) -> &'static [Console] {
        &CONSOLES
    }
}
