//! The descriptions that come with the tool, from the folder `devices`.

/// Declares the descriptions by the names of their files.
macro_rules! shipped {
    ($($name:literal,)+) => {
        /// Names and texts, in the order of the alphabet.
        pub const ALL: &[(&str, &str)] = &[
            $(($name, include_str!(concat!("../devices/", $name, ".toml"))),)+
        ];
    };
}

shipped! {
    "cobs-sensor",
    "gps",
    "modbus-meter",
}

/// The text of the description called `name`.
pub fn text(name: &str) -> Option<&'static str> {
    let found = ALL.iter().find(|(known, _)| *known == name);
    found.map(|(_, text)| *text)
}
