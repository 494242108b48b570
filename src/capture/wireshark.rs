//! The dissector for Wireshark: a Lua file that knows our protocols, its register names from the
//! one table.

use core::fmt::Write as _;

use protocols::avr::registers::{TABLE, Width};

/// Name of the file in Wireshark's plugin folder.
pub const FILE_NAME: &str = "hilrig.lua";

const TEMPLATE: &str = include_str!("wireshark/hilrig.lua");
/// Where the register names belong.
const PLACE: &str = "--@REGISTERS\n";

/// The whole file.
pub fn dissector() -> String {
    let mut registers = String::new();
    for register in TABLE {
        let width = match register.width {
            Width::U8 => "u8",
            Width::I8 => "i8",
            Width::I16 => "i16",
            Width::I32 => "i32",
        };
        let (address, name) = (register.address, register.name);
        writeln!(registers, "  [{address}] = {{ \"{name}\", \"{width}\" }},")
            .expect("a string takes everything");
    }
    TEMPLATE.replace(PLACE, &registers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dissector_knows_all_registers() {
        let lua = dissector();
        assert!(lua.contains("  [36] = { \"encoder_left\", \"i32\" },\n"));
        let entries = lua.lines().filter(|line| line.starts_with("  ["));
        assert_eq!(entries.count(), TABLE.len());
        assert!(!lua.contains(PLACE));
    }
}
