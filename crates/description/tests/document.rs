//! The reference page of a device.

use description::{Description, shipped};

/// Offsets by hand: two constants, then four, four, four .. bytes.
#[test]
fn a_page_tells_every_field_with_its_place_and_unit() {
    let text = shipped::text("gps").expect("shipped");
    let gps = Description::parse("gps", text, &|_| Err(String::new())).expect("sound");
    let page = gps.reference();
    assert!(
        page.starts_with("# gps\n\nGNSS receiver, NMEA 0183 and UBX.\n\nLine: 9600 bit/s, 8N1.\n")
    );
    for row in [
        "- `ubx`: begins with [B5, 62], length at byte 4; checksums: 1",
        "GPGGA,{hms}.00,{lat_dm},N,{lon_dm},E,1,08,0.9,{height},M,47.0,M,,",
        "| 0 | 1 | u8 |  |  | class |",
        "| 2 | `itow` | u32le | ms |  |  |",
        "| 6 | `lon` | i32le * 0.0000001 | deg |  |  |",
        "| 26 | `vacc` | u32le * 0.001 | m |  |  |",
        "| `lat` | 48.1173 | deg |  |  |",
        "| `stuck` |  |",
    ] {
        assert!(page.contains(row), "{row}\n{page}");
    }
}

#[test]
fn a_page_tells_every_register() {
    let text = shipped::text("modbus-meter").expect("shipped");
    let meter = Description::parse("meter", text, &|_| Err(String::new())).expect("sound");
    let page = meter.reference();
    for row in [
        "Line: 9600 bit/s, 8N1, half duplex.",
        "| 6 | `power_factor` | i16be * 0.001 | read |  |  |  |",
        "| 1 | `alarm_voltage` | u16be * 0.1 | read, write | V | 100 to 300 |  |",
        "| 3 | `label` | text of 8 | read, write |  |  |  |",
        "| `wrong-current` | the current transformer is connected the wrong way round |",
    ] {
        assert!(page.contains(row), "{row}\n{page}");
    }
}
