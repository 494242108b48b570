//! The robot's sensors and devices for page and mapper.

use emulators::avr_base::AvrBase;
use emulators::pc::Pc;
use protocols::avr::ChecksumOrder;
use protocols::avr::registers::{self, Width};
use protocols::pcui::diagnosis::Condition;

use super::{base, display, order_of, program};
use crate::codec::{self, Codec, PANEL, PCUI, XV11};
use crate::rig::Rig;
use crate::robots::{Panel, PanelRow, Senses};
use crate::scenario::{Scenario, ScenarioError, Source};

/// Link on which the lidar sends.
pub(super) const SCAN_LINK: &str = "lidar";
/// Bearing of the lidar's first reading: sensor angle 90 points ahead.
pub(super) const FIRST_BEARING: f64 = -core::f64::consts::FRAC_PI_2;

pub(super) fn senses(scenario: &Scenario, source: &Source) -> Result<Senses, ScenarioError> {
    let checksum_order = order_of(base(scenario, source)?.profile);
    let config = program(scenario, checksum_order, source)?;
    Ok(Senses {
        lidar: SCAN_LINK,
        mounting: config.mounting,
        base: "base",
        checksum_order,
        counters: [registers::ENCODER_LEFT, registers::ENCODER_RIGHT],
        wheels: config.wheels,
        start: config.mapping.start,
    })
}

pub(super) fn protocol(rig: &Rig, link: &str) -> Option<&'static Codec> {
    match link {
        "lidar" => Some(&XV11),
        "base" => {
            let profile = rig.device::<AvrBase>("base").map(AvrBase::profile);
            Some(codec::bus(
                profile.map_or(ChecksumOrder::LowFirst, order_of),
            ))
        }
        "radio" | "pc" => Some(&PCUI),
        display::NAME => Some(&PANEL),
        _ => None,
    }
}

/// The registers of the base, if it is emulated.
pub(super) fn registers(rig: &Rig) -> Option<Panel> {
    let base = rig.device::<AvrBase>("base")?;
    let value = |register: &registers::Register| {
        let byte = |offset: u8| base.register(register.address + offset);
        match register.width {
            Width::U8 => i64::from(byte(0)),
            Width::I8 => i64::from(byte(0).cast_signed()),
            Width::I16 => i64::from(i16::from_le_bytes([byte(0), byte(1)])),
            Width::I32 => i64::from(i32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)])),
        }
    };
    let shown = |register: &registers::Register| PanelRow {
        name: register.name.into(),
        address: Some(register.address.into()),
        value: value(register).to_string(),
        unit: register.unit.into(),
    };
    Some(Panel {
        name: "base registers".to_owned(),
        rows: registers::TABLE.iter().map(shown).collect(),
    })
}

/// Infrared sensors in the order of the base's registers: the side of the robot, and the end of
/// that side.
const INFRARED: [&str; 10] = [
    "infrared back right",
    "infrared right back",
    "infrared left back",
    "infrared back left",
    "infrared front",
    "infrared back",
    "infrared front left",
    "infrared left front",
    "infrared right front",
    "infrared front right",
];

/// The robot's own reports to the PC, if there are any.
pub(super) fn diagnosis(pc: &Pc) -> Option<Panel> {
    let (_, told) = pc.record().diagnosis?;
    let row = |name: &str, value: String, unit: &'static str| PanelRow {
        name: name.to_owned().into(),
        address: None,
        value,
        unit: unit.into(),
    };
    let conditions: Vec<&str> = told.conditions.iter().map(Condition::text).collect();
    let conditions = match conditions.is_empty() {
        true => "none".to_owned(),
        false => conditions.join(", "),
    };
    let [lidar, base, radio] = told.errors.map(|count| count.to_string());
    let mut rows = vec![
        row("battery", told.battery_mv.to_string(), "mV"),
        row("charge", told.battery_percent.to_string(), "%"),
        row("conditions", conditions, ""),
        row("search", told.search.text().to_owned(), ""),
        row("victims", pc.record().victims.len().to_string(), ""),
        row("lidar errors", lidar, ""),
        row("base errors", base, ""),
        row("radio errors", radio, ""),
    ];
    if let Some((_, text)) = &pc.record().message {
        rows.push(row("message", text.clone(), ""));
    }
    if let Some(readings) = pc.record().readings {
        rows.push(row("lidar speed", readings.lidar_rpm.to_string(), "rpm"));
        let read = INFRARED.into_iter().zip(readings.infrared_mm);
        let read = read.filter(|(_, range)| *range != i16::MAX);
        rows.extend(read.map(|(name, range)| row(name, range.to_string(), "mm")));
    }
    Some(Panel {
        name: "robot says".to_owned(),
        rows,
    })
}

/// The positions of victims reported to the PC, metres.
pub(super) fn told_victims(pc: &Pc) -> Vec<[f64; 2]> {
    let metres = |mm: [i16; 2]| mm.map(|mm| f64::from(mm) / 1000.0);
    pc.record().victims.iter().copied().map(metres).collect()
}
