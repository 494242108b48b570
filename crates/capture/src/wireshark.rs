//! The dissector for Wireshark: a Lua file that knows the formats of the codec table, and the
//! register names of the register table.

use core::fmt::Write as _;

use protocols::avr::registers::{TABLE, Width};

use engine::codec::{self, Codec, Lua, LuaField};

/// Name of the file in Wireshark's plugin folder.
pub const FILE_NAME: &str = "hilrig.lua";

const TEMPLATE: &str = include_str!("wireshark/hilrig.lua");
/// Where in the template the names of registers belong, the fields, the functions and the table of
/// the formats.
const PLACES: [&str; 4] = [
    "--@REGISTERS\n",
    "--@FIELDS\n",
    "--@SOURCES\n",
    "--@FORMATS\n",
];

/// The whole file.
pub fn dissector() -> String {
    let rows = codec::all().into_iter();
    let rows: Vec<(&Codec, &Lua)> = rows.filter_map(|row| Some((row, row.lua()?))).collect();
    let texts = [registers(), fields(&rows), sources(&rows), formats(&rows)];
    let texts = PLACES.into_iter().zip(texts);
    texts.fold(TEMPLATE.to_owned(), |file, (place, text)| {
        file.replace(place, &text)
    })
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

/// Each field once, though formats share some.
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

/// Each text once, though formats share some.
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

    /// A format that is in the table and not in the dissector would be guessed as another one.
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
