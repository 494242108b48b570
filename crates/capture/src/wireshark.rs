//! The dissector for Wireshark: a Lua file with the formats of the codec table and the register
//! names of the register table.

use core::fmt::Write as _;
use std::sync::Arc;

use description::{Description, LUA_RUNTIME, LuaField as DescribedField, LuaPart};

use protocols::avr::registers::{TABLE, Width};

use engine::codec::{self, Codec, Lua, LuaField};

/// Name of the file in Wireshark's plugin folder.
pub const FILE_NAME: &str = "hilrig.lua";

const TEMPLATE: &str = include_str!("wireshark/hilrig.lua");
/// Places in the template for the register names, the fields, the functions and the table of
/// formats.
const PLACES: [&str; 4] = [
    "--@REGISTERS\n",
    "--@FIELDS\n",
    "--@SOURCES\n",
    "--@FORMATS\n",
];

/// Fields of every described device.
const DESCRIBED_FIELDS: &str = "\
  words = ProtoField.string(\"hilrig.words\", \"Frame in words\"),
  message = ProtoField.string(\"hilrig.message\", \"Message\"),
  modbus_address = ProtoField.uint8(\"hilrig.modbus.address\", \"Modbus address\"),
  modbus_function = ProtoField.uint8(\"hilrig.modbus.function\", \"Modbus function\"),
  modbus_exception = ProtoField.uint8(\"hilrig.modbus.exception\", \"Modbus exception\"),
  modbus_register = ProtoField.uint16(\"hilrig.modbus.register\", \"Modbus register\"),
  modbus_count = ProtoField.uint16(\"hilrig.modbus.count\", \"Modbus count\"),
  modbus_data = ProtoField.string(\"hilrig.modbus.data\", \"Modbus data\"),
";

/// The whole file.
pub fn dissector() -> String {
    dissector_of(&[])
}

/// The whole file with described devices, whose formats come first.
pub fn dissector_of(descriptions: &[Arc<Description>]) -> String {
    let rows = codec::all().into_iter();
    let rows: Vec<(&Codec, &Lua)> = rows.filter_map(|row| Some((row, row.lua()?))).collect();
    let parts = described(descriptions);
    let texts = [
        registers(),
        fields(&rows) + &described_fields(&parts),
        sources(&rows) + if parts.is_empty() { "" } else { LUA_RUNTIME },
        described_rows(&parts) + &formats(&rows),
    ];
    let texts = PLACES.into_iter().zip(texts);
    texts.fold(TEMPLATE.to_owned(), |file, (place, text)| {
        file.replace(place, &text)
    })
}

/// The parts of described devices; a device with the name of an earlier one gets a number.
fn described(descriptions: &[Arc<Description>]) -> Vec<LuaPart> {
    let mut names: Vec<String> = Vec::new();
    let parts = descriptions.iter().map(|description| {
        let own = description.name().to_owned();
        let free = |name: &String| !names.contains(name);
        let mut numbered = (2..).map(|number| format!("{own}-{number}"));
        let name = match free(&own) {
            true => own.clone(),
            false => numbered.find(free).unwrap_or_default(),
        };
        names.push(name.clone());
        description.lua(&name)
    });
    parts.collect()
}

/// The fields of all described devices, and those of each.
fn described_fields(parts: &[LuaPart]) -> String {
    if parts.is_empty() {
        return String::new();
    }
    let mut out = DESCRIBED_FIELDS.to_owned();
    for field in parts.iter().flat_map(|part| &part.fields) {
        let DescribedField {
            key,
            kind,
            filter,
            label,
        } = field;
        writeln!(
            out,
            "  {key} = ProtoField.{kind}(\"{filter}\", \"{label}\"),"
        )
        .expect(TAKES_ALL);
    }
    out
}

fn described_rows(parts: &[LuaPart]) -> String {
    let rows = parts.iter().map(|part| format!("{},\n", part.row));
    rows.collect()
}

fn registers() -> String {
    let mut out = String::new();
    for register in TABLE {
        let width = match register.width {
            Width::U8 => "u8",
            Width::I8 => "i8",
            Width::I16 => "i16",
            Width::I32 => "i32",
        };
        let (address, name) = (register.address, register.name);
        writeln!(out, "  [{address}] = {{ \"{name}\", \"{width}\" }},").expect(TAKES_ALL);
    }
    out
}

/// All fields, once each, because formats share some.
fn fields(rows: &[(&Codec, &Lua)]) -> String {
    let (mut out, mut told) = (String::new(), Vec::<LuaField>::new());
    for field in rows.iter().flat_map(|(_, lua)| lua.fields) {
        if told.contains(field) {
            continue;
        }
        told.push(*field);
        let LuaField {
            key,
            kind,
            filter,
            label,
            shown_as,
        } = field;
        let comma = if shown_as.is_empty() { "" } else { ", " };
        let arguments = format!("\"{filter}\", \"{label}\"{comma}{shown_as}");
        writeln!(out, "  {key} = ProtoField.{kind}({arguments}),").expect(TAKES_ALL);
    }
    out
}

/// All source texts, once each, because formats share some.
fn sources(rows: &[(&Codec, &Lua)]) -> String {
    let mut sources: Vec<&str> = Vec::new();
    for (_, lua) in rows {
        if !sources.contains(&lua.source) {
            sources.push(lua.source);
        }
    }
    let sources = sources.iter().map(|source| format!("{source}\n"));
    sources.collect()
}

fn formats(rows: &[(&Codec, &Lua)]) -> String {
    let row = |(codec, Lua { judge, tell, .. }): &(&Codec, &Lua)| {
        let (name, idle) = (codec.name(), codec.idle().as_secs_f64());
        let share = codec.least_share();
        format!("  {{ \"{name}\", {judge}, {tell}, {idle}, {share} }},\n")
    };
    rows.iter().map(row).collect()
}

const TAKES_ALL: &str = "a string takes everything";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dissector_knows_all_registers() {
        let lua = dissector();
        assert!(lua.contains("  [36] = { \"encoder_left\", \"i32\" },\n"));
        let entries = lua.lines().filter(|line| line.starts_with("  ["));
        assert_eq!(entries.count(), TABLE.len());
        assert!(!lua.contains("--@"), "every place is filled");
    }

    /// A format of the table that the dissector lacks would be mistaken for another one.
    #[test]
    fn the_dissector_knows_every_row_and_shares_what_rows_share() {
        let lua = dissector();
        for row in codec::all().into_iter().filter(|row| row.lua().is_some()) {
            let entry = format!("\n  {{ \"{}\", judge_", row.name());
            assert_eq!(lua.matches(&entry).count(), 1, "{}", row.name());
            for field in row.lua().expect("filtered").fields {
                let entry = format!("\n  {} = ProtoField.", field.key);
                assert_eq!(lua.matches(&entry).count(), 1, "{}", field.key);
            }
        }
        assert_eq!(lua.matches("local function tell_bus(").count(), 1);
    }
}
