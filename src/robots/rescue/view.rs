//! Where page and mapper find the robot's senses and devices.

use emulators::avr_base::AvrBase;
use protocols::avr::ChecksumOrder;
use protocols::avr::registers::{self, Width};

use super::{base, display, order_of, program};
use crate::codec::{self, Codec, PANEL, PCUI, XV11};
use crate::rig::Rig;
use crate::robots::{Register, ScanLink, Senses};
use crate::scenario::{Scenario, ScenarioError, Source};

/// Sensor angle 90 looks ahead.
pub(in super::super) const SCAN_LINK: ScanLink = ScanLink {
    link: "lidar",
    first_bearing: -core::f64::consts::FRAC_PI_2,
};

pub(in super::super) fn senses(
    scenario: &Scenario,
    source: &Source,
) -> Result<Senses, ScenarioError> {
    let checksum_order = order_of(base(scenario, source)?.profile);
    let config = program(scenario, checksum_order, source)?;
    Ok(Senses {
        lidar: SCAN_LINK.link,
        mounting: config.mounting,
        base: "base",
        checksum_order,
        counters: [registers::ENCODER_LEFT, registers::ENCODER_RIGHT],
        wheels: config.wheels,
        start: config.mapping.start,
    })
}

pub(in super::super) fn protocol(rig: &Rig, link: &str) -> Option<&'static Codec> {
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

pub(in super::super) fn registers(rig: &Rig) -> Vec<Register> {
    let Some(base) = rig.device::<AvrBase>("base") else {
        return Vec::new();
    };
    let value = |register: &registers::Register| {
        let byte = |offset: u8| base.register(register.address + offset);
        match register.width {
            Width::U8 => i64::from(byte(0)),
            Width::I8 => i64::from(byte(0).cast_signed()),
            Width::I16 => i64::from(i16::from_le_bytes([byte(0), byte(1)])),
            Width::I32 => i64::from(i32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)])),
        }
    };
    let shown = |register: &registers::Register| Register {
        address: register.address,
        name: register.name,
        value: value(register),
        unit: register.unit,
    };
    registers::TABLE.iter().map(shown).collect()
}
