/// A row's part of the dissector for Wireshark.
///
/// The template has helpers for it. `u8`, `i8`, `u16`, `i16`, `u32`, `i32` and `be16` read a number
/// of a string at an index from 0 on. `sum(s, first, last)` adds bytes up; `f` holds the fields.
#[derive(Clone, Copy, Debug)]
pub struct Lua {
    /// Local functions; rows with the same text share them.
    pub source: &'static str,
    /// A function that returns the length of the frame at the start of a string: 0 for none, nil if
    /// more bytes are needed. Its second argument is the line's own table.
    pub judge: &'static str,
    /// A function that returns a frame's title and a list of fields and values.
    pub tell: &'static str,
    /// Fields of the frames; rows may share fields.
    pub fields: &'static [LuaField],
}

/// A field that Wireshark can filter by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LuaField {
    /// Its name in `f`.
    pub key: &'static str,
    /// Its Lua type, e.g. `uint8`.
    pub kind: &'static str,
    /// Its name in filters.
    pub filter: &'static str,
    /// Its label in the tree.
    pub label: &'static str,
    /// Further arguments, e.g. the base of a number; empty for none.
    pub shown_as: &'static str,
}

/// A field shown without conversion.
pub const fn field(
    key: &'static str,
    kind: &'static str,
    filter: &'static str,
    label: &'static str,
) -> LuaField {
    LuaField {
        key,
        kind,
        filter,
        label,
        shown_as: "",
    }
}

impl LuaField {
    /// Adds further arguments of its `ProtoField`, in Lua.
    #[must_use]
    pub const fn shown_as(mut self, arguments: &'static str) -> Self {
        self.shown_as = arguments;
        self
    }
}
