//! The descriptions that come with the tool, from the folder `devices`.

/// Declares the descriptions by file name.
macro_rules! shipped {
    ($($name:literal,)+) => {
        /// Names and texts, in alphabetical order.
        pub const ALL: &[(&str, &str)] = &[
            $(($name, include_str!(concat!("../devices/", $name, ".toml"))),)+
        ];
    };
}

shipped! {
    "alicat",
    "cobs-sensor",
    "crsf",
    "daly-bms",
    "dynamixel-xl430",
    "elm327",
    "epever-tracer",
    "feetech-sts3215",
    "gmc-320",
    "gps",
    "grbl",
    "iec-62056-21",
    "ld14p",
    "ld2410",
    "lx16a",
    "mavlink",
    "mh-z19",
    "modbus-meter",
    "mt-sics",
    "pms5003",
    "pzem-016",
    "scpi-supply",
    "sds011",
    "senseair-s8",
    "sps30",
    "tfmini",
    "tmcl",
    "ve-direct",
    "vesc",
    "ydlidar-x4",
}

/// The text of the description called `name`.
pub fn text(name: &str) -> Option<&'static str> {
    let found = ALL.iter().find(|(known, _)| *known == name);
    found.map(|(_, text)| *text)
}
