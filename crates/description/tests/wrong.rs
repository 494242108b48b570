//! Wrong descriptions: each part of a valid one is changed in turn. Every error states file, line,
//! key and the expected value. No change causes a panic.

use description::{Description, DescriptionError, shipped};
use toml::{Table, Value};

const EVERYTHING: &str = include_str!("data/everything.toml");

/// Frame keys that the other descriptions do not use: markers in the checksum, a repeated length,
/// sizes by a byte and by an expression.
const FRAMES: &str = r#"
name = "frames"
about = "frames of many forms"
endian = "little"
line = { baud = 9600 }
frame = [
  { name = "marked", start = "/", end = "!", tail = 6, closing = "\r\n", checksum = { algorithm = "CRC-16/ARC", encoding = "hex", before = "/", extra = "!" } },
  { name = "twice", sync = [0x68], length = { at = 1, again = 2, type = "u8", without = 2 }, end = [0x16], checksum = { algorithm = "sum8", from = 4 } },
  { name = "sized", sync = [0xAA], head = 2, size = "4 + b1" },
  { name = "listed", sizes = { 0x01 = 3, 0x02 = 4 } },
]
message = [
  { name = "telegram", from = "device", frame = "marked", text = "{what:s}" },
  { name = "data", from = "device", frame = "twice", fields = [{ type = "u8", value = 0x68 }, { name = "serial", type = "bcdle", size = 4 }] },
  { name = "block", from = "device", frame = "sized", fields = [{ type = "u8", value = 2 }, { name = "rest", type = "bytes", size = "rest" }] },
  { name = "ask", from = "host", frame = "listed", fields = [{ type = "u8", value = 1 }, { name = "which", type = "u16" }] },
]
on = [{ message = "ask", reply = ["data", "block", "telegram"] }]
"#;

fn parse(text: &str) -> Result<(), DescriptionError> {
    let csv = |file: &str| match file {
        "log.csv" => Ok("t,u\n0,1\n1,2\n".to_owned()),
        other => Err(format!("cannot read {other}: there is no such file")),
    };
    Description::parse("wrong.toml", text, &csv).map(drop)
}

/// Wrong replacements for a value.
fn spoilt(value: &Value) -> Vec<Value> {
    let mut others = vec![
        Value::String("?! {".to_owned()),
        Value::String(String::new()),
        Value::Integer(-77_777),
        Value::Integer(i64::MAX),
        Value::Float(f64::NAN),
        Value::Boolean(true),
        Value::Array(Vec::new()),
        Value::Array(vec![Value::Integer(999)]),
        Value::Table(Table::new()),
    ];
    if let Value::String(text) = value {
        others.push(Value::String(format!("{text}x")));
        others.push(Value::String(format!("{text} +")));
    }
    if let Value::Integer(number) = value {
        others.push(Value::Integer(number.wrapping_mul(1_000)));
        others.push(Value::Integer(0));
    }
    others
}

/// All tables that differ from `table` in one place.
fn mutants(table: &Table) -> Vec<Table> {
    let mut all = Vec::new();
    for (key, value) in table {
        let with = |value: Value| {
            let mut other = table.clone();
            other.insert(key.clone(), value);
            other
        };
        let mut without = table.clone();
        without.remove(key);
        let mut renamed = without.clone();
        renamed.insert(format!("{key}_x"), value.clone());
        all.extend([without, renamed]);
        all.extend(spoilt(value).into_iter().map(with));
        all.extend(mutants_of(value).into_iter().map(with));
    }
    all
}

fn mutants_of(value: &Value) -> Vec<Value> {
    match value {
        Value::Table(table) => mutants(table).into_iter().map(Value::Table).collect(),
        Value::Array(list) => {
            let mut all = Vec::new();
            for (index, value) in list.iter().enumerate() {
                let with = |value: Value| {
                    let mut other = list.clone();
                    other[index] = value;
                    Value::Array(other)
                };
                let mut twice = list.clone();
                twice.push(value.clone());
                all.push(Value::Array(twice));
                all.extend(mutants_of(value).into_iter().map(with));
            }
            all
        }
        _ => Vec::new(),
    }
}

/// A message contains at least one of these words: the expected value, or the fix.
const FIXES: [&str; 6] = [
    "xpected",
    "missing field",
    "choose",
    "leave",
    "no ",
    "twice",
];

/// The parts that an error message lacks.
fn untold(text: &str, error: &DescriptionError) -> Vec<String> {
    let lines = text.lines().count();
    let mut untold = Vec::new();
    for problem in &error.problems {
        let line = text.lines().nth(problem.line - 1).unwrap_or_default();
        let mut names = problem.key.split(['.', '[']);
        let has_line = (1..=lines).contains(&problem.line);
        // The line contains the key, or begins a table.
        let is_there = names.any(|name| line.contains(name)) || line.contains('[');
        let has_key = !problem.key.is_empty() || problem.message.contains('`');
        let is_clear = FIXES.iter().any(|fix| problem.message.contains(fix));
        if !(has_line && is_there && has_key && is_clear && error.file == "wrong.toml") {
            untold.push(format!("{problem:?}: {line}"));
        }
    }
    untold
}

#[test]
fn what_is_wrong_is_told_with_file_line_and_key() {
    assert_eq!(parse(EVERYTHING), Ok(()));
    assert_eq!(parse(FRAMES), Ok(()));
    // The three most different descriptions: each has thousands of mutants.
    let texts = ["cobs-sensor", "gps", "modbus-meter"];
    let texts = texts.map(|name| shipped::text(name).expect("shipped"));
    let texts = texts.into_iter().chain([EVERYTHING, FRAMES]);
    // Every fourth mutant at a landing, all of them with `tests/run.sh --all`.
    let is_whole = std::env::var("HILRIG_TESTS").is_ok_and(|tests| tests == "all");
    let step = if is_whole { 1 } else { 4 };
    let (mut refused, mut tried) = (0_u32, 0_u32);
    let mut wrong = std::collections::BTreeSet::new();
    for text in texts {
        let table: Table = text.parse().expect("TOML");
        for mutant in mutants(&table).into_iter().step_by(step) {
            tried += 1;
            let text = toml::to_string(&mutant).expect("a table");
            if let Err(error) = parse(&text) {
                refused += 1;
                assert!(!error.problems.is_empty());
                wrong.extend(untold(&text, &error));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    println!("{refused} of {tried} changed descriptions are refused");
    assert!(refused > 200 && tried > refused);
}

/// Truncated text is rejected or valid; it never causes a panic.
#[test]
fn a_file_that_is_cut_off_is_no_panic() {
    for text in [EVERYTHING, shipped::text("gps").expect("shipped")] {
        for end in (0..text.len())
            .step_by(7)
            .filter(|end| text.is_char_boundary(*end))
        {
            if let Err(error) = parse(&text[..end]) {
                assert!(
                    error.problems.iter().all(|problem| problem.line >= 1),
                    "{error}"
                );
            }
        }
    }
}

fn error_of(change: impl Fn(&mut Table), text: &str) -> String {
    let mut table: Table = text.parse().expect("TOML");
    change(&mut table);
    let text = toml::to_string(&table).expect("a table");
    parse(&text).expect_err("wrong").to_string()
}

/// Errors in a description as a whole.
#[test]
fn descriptions_that_cannot_be_are_refused_with_the_reason() {
    let meter = shipped::text("modbus-meter").expect("shipped");
    let overlap = parse(&meter.replace(
        "{ at = 2, name = \"current\"",
        "{ at = 1, name = \"current\"",
    ));
    let overlap = overlap.expect_err("overlap").to_string();
    assert!(
        overlap.contains(":20: registers.input[1].at: 1 is taken: voltage has 0 to 1"),
        "{overlap}"
    );

    let sensor = shipped::text("cobs-sensor").expect("shipped");
    let silent = error_of(|table| drop(table.remove("on")), sensor);
    assert!(silent.contains("can never answer"), "{silent}");

    let alike = sensor
        .replace("type = \"u8\", value = 2", "type = \"u8\", value = 1")
        .replace(
            "{ name = \"percent\", type = \"f32\", limits = [0, 100] }",
            "",
        )
        .replace("heater = \"percent\"", "heater = 1");
    let ambiguous = parse(&alike);
    let ambiguous = ambiguous.expect_err("ambiguous").to_string();
    assert!(
        ambiguous.contains("is ambiguous: all of it is taken for \"read\""),
        "{ambiguous}"
    );

    let circular = parse(&meter.replace("initial = 0.95", "value = \"power\""));
    let circular = circular.expect_err("circular").to_string();
    assert!(circular.contains("is computed from itself"), "{circular}");

    let unread = parse(&meter.replace("10 * load", "10 * lod"))
        .expect_err("unknown")
        .to_string();
    assert!(
        unread.contains("\"lod\", did you mean \"load\"? Expected one of: load, relay"),
        "{unread}"
    );
}

/// The number of bits and the constant of a checksum fit the algorithm and the field.
#[test]
fn a_part_of_a_checksum_fits_its_field() {
    let with = |keys: &str| {
        let marked = "checksum = { algorithm = \"sum8\", from = 4 }";
        assert!(FRAMES.contains(marked));
        let text = FRAMES.replace(marked, &format!("checksum = {{ {keys}, from = 4 }}"));
        parse(&text).map_err(|error| error.to_string())
    };
    let fits = [
        r#"algorithm = "sum8", bits = 6, plus = 0x20"#,
        r#"algorithm = "sum7", bits = 7"#,
        r#"algorithm = "sum8", bits = 16, bytes = 2"#,
        r#"algorithm = "sum8", plus = 255"#,
        r#"algorithm = "CRC-16/ARC", bits = 12, plus = 65535"#,
    ];
    for keys in fits {
        assert_eq!(with(keys), Ok(()), "{keys}");
    }
    let wrong = [
        (
            r#"algorithm = "sum7", bits = 8"#,
            "bits: is 8, expected 1 to 7",
        ),
        (
            r#"algorithm = "sum15", bits = 16"#,
            "bits: is 16, expected 1 to 15",
        ),
        (
            r#"algorithm = "CRC-12/DECT", bits = 13"#,
            "bits: is 13, expected 1 to 12",
        ),
        (
            r#"algorithm = "xor", bits = 9"#,
            "bits: is 9, expected 1 to 8",
        ),
        (
            r#"algorithm = "sum8", bits = 0"#,
            "bits: is 0, expected 1 to 8",
        ),
        (
            r#"algorithm = "sum8", plus = 256"#,
            "plus: is 256, expected 0 to 255",
        ),
        (
            r#"algorithm = "sum8", bits = 6, plus = 0x120"#,
            "plus: is 288, expected 0 to 255",
        ),
        (
            r#"algorithm = "sum16", plus = 65536"#,
            "plus: is 65536, expected 0 to 65535",
        ),
    ];
    for (keys, expected) in wrong {
        let error = with(keys).expect_err(keys);
        assert!(error.contains(expected), "{keys}: {error}");
    }
}

/// All problems of a file are reported at once.
#[test]
fn all_problems_are_told_at_once() {
    let meter = shipped::text("modbus-meter").expect("shipped");
    let text = meter
        .replace("baud = 9600", "baud = 96")
        .replace("\"f32\"", "\"f33\"");
    let error = parse(&text).expect_err("wrong");
    let keys: Vec<_> = error
        .problems
        .iter()
        .map(|problem| problem.key.as_str())
        .collect();
    assert_eq!(
        keys,
        [
            "line.baud",
            "registers.input[0].type",
            "registers.input[1].type",
            "registers.input[2].type"
        ]
    );
}

/// Each key that names something else lists the names that exist, and proposes the nearest one. A
/// misspelt name has no further error as a consequence.
#[test]
fn a_misspelt_name_is_reported_with_the_nearest_one() {
    let text = "name = \"s\"\nabout = \"s\"\nendian = \"little\"\nline = { baud = 9600 }\n\
        [frame]\nstuffing = \"cobs\"\n[state]\nheat = { initial = 3 }\n\
        [enums]\nmode = { 0 = \"idle\" }\n\
        [[message]]\nname = \"read\"\nfrom = \"host\"\nfields = [{ name = \"tag\", type = \"u8\" }]\n\
        [[message]]\nname = \"reading\"\nfrom = \"device\"\n\
        fields = [{ name = \"heat\", type = \"u8\", enum = \"mode\" }, { name = \"all\", type = \"group\", fields = [{ name = \"x\", type = \"u8\" }] }]\n\
        [[on]]\nmessage = \"read\"\nreply = \"reading\"\nset = { heat = \"tag\" }\n\
        [[every]]\nperiod = \"1s\"\nsend = \"reading\"\n\
        [faults.a]\nfreeze = [\"heat\"]\n[faults.b]\nset = { heat = 4 }\n\
        [faults.c]\nreplace = { reading = \"reading\" }\n";
    parse(text).expect("sound");
    let rows = [
        (
            "message = \"read\"",
            "message = \"raed\"",
            "on[0].message",
            "read",
        ),
        (
            "reply = \"reading\"",
            "reply = \"raeding\"",
            "on[0].reply",
            "reading",
        ),
        (
            "set = { heat = \"tag\"",
            "set = { heta = \"tag\"",
            "on[0].set.heta",
            "heat",
        ),
        ("heat = \"tag\"", "heat = \"tga\"", "on[0].set.heat", "tag"),
        (
            "send = \"reading\"",
            "send = \"readign\"",
            "every[0].send",
            "reading",
        ),
        (
            "freeze = [\"heat\"]",
            "freeze = [\"haet\"]",
            "faults.a.freeze[0]",
            "heat",
        ),
        (
            "set = { heat = 4 }",
            "set = { heta = 4 }",
            "faults.b.set.heta",
            "heat",
        ),
        (
            "= \"reading\" }",
            "= \"readingg\" }",
            "faults.c.replace.reading",
            "reading",
        ),
        (
            "enum = \"mode\"",
            "enum = \"moed\"",
            "message[1].fields[0].enum",
            "mode",
        ),
        ("\"cobs\"", "\"cosb\"", "frame.stuffing", "cobs"),
        (
            "heat = { initial = 3 }",
            "heat = { source = { csv = { file = \"log.csv\", column = \"uu\" } } }",
            "state.heat.source.csv.column",
            "u",
        ),
    ];
    for (right, wrong, key, meant) in rows {
        let error = parse(&text.replacen(right, wrong, 1)).expect_err(wrong);
        let problems: Vec<String> = { error.problems.iter() }
            .map(|one| format!("{}: {}", one.key, one.message))
            .collect();
        let problem = problems
            .iter()
            .find(|one| one.starts_with(&format!("{key}: ")));
        let said = problem.map_or("", String::as_str);
        assert!(
            said.contains(meant) && said.contains("xpected one of"),
            "{problems:?}"
        );
        let is_near = said.contains(&format!("did you mean \"{meant}\"?"));
        assert!(is_near || meant.len() < 3, "{problems:?}");
        assert!(
            problems.iter().all(|one| !one.contains("does nothing")),
            "{problems:?}"
        );
    }
    let calc = text.replacen("type = \"group\"", "type = \"group\", calc = \"1\"", 1);
    let error = parse(&calc).expect_err("no effect").to_string();
    assert!(
        error.contains("fields[1].calc: has no effect on a group"),
        "{error}"
    );
}

/// Registers of each type: numbers with and without sign, of one and of two registers (CDAB, as
/// many power meters have), scaled ones, coils and text.
const REGISTERS: &str = r#"
name = "registers"
about = "registers of each type"
protocol = "modbus-rtu"
line = { baud = 9600, address = 17 }
[registers]
coils = [{ at = 0, name = "coil" }]
holding = [
  { at = 0, name = "u16" },
  { at = 1, name = "i16", type = "i16" },
  { at = 2, name = "u32", type = "u32", words = "little" },
  { at = 4, name = "i64", type = "i64" },
  { at = 8, name = "f32", type = "f32", words = "little" },
  { at = 10, name = "tight", limits = [1, 9], initial = 1 },
  { at = 11, name = "tenths", scale = 0.1, offset = -40 },
  { at = 12, name = "both", scale = 0.1, limits = [0, 45.5] },
  { at = 13, name = "below", type = "i16", scale = -0.5 },
  { at = 14, name = "label", type = "str", size = 4 },
]
"#;

/// Limits and initial values that the type of a register cannot hold would be cut on the wire.
#[test]
fn a_register_of_another_type_than_its_values_is_refused() {
    for (register, more, says) in [
        (
            "\"u16\"",
            "limits = [0, 100000]",
            "limits: is 100000, expected a whole number from 0 to 65535",
        ),
        (
            "\"u16\"",
            "initial = -1",
            "initial: is -1, expected a whole number from 0 to 65535",
        ),
        (
            "type = \"i16\"",
            "limits = [-40000, 0]",
            "limits: is -40000, expected a whole number from -32768",
        ),
        (
            "offset = -40",
            "limits = [-50, 10]",
            "limits: is -50, expected a number from -40 to 6513.5",
        ),
        (
            "scale = -0.5",
            "initial = 20000",
            "initial: is 20000, expected a number from -16383.5 to 16384",
        ),
    ] {
        let text = REGISTERS.replacen(register, &format!("{register}, {more}"), 1);
        let error = parse(&text).expect_err(more).to_string();
        assert!(error.contains(says), "{more}: {error}");
    }
    for (register, more) in [
        ("\"u16\"", "limits = [0, 65535], initial = 65535"),
        ("\"u16\"", "limits = [-0.4, 65535.4]"),
        ("offset = -40", "limits = [-40, 6513.5]"),
    ] {
        let text = REGISTERS.replacen(register, &format!("{register}, {more}"), 1);
        assert!(parse(&text).is_ok(), "{more}");
    }
}

/// A value that a register cannot hold is refused with the allowed values, computed by hand; cut to
/// the register's type, it would be another order. A value at the end of the range is accepted.
#[test]
fn an_order_that_does_not_fit_its_register_is_refused() {
    let nothing = |_: &str| Err(String::new());
    let of = Description::parse("wrong.toml", REGISTERS, &nothing);
    let of = of.unwrap_or_else(|error| panic!("{error}"));
    let whole = "expected a whole number from";
    let number = "expected a number from";
    let table = [
        (
            "u16",
            "0 65535 0xFFFF",
            "-1 65536 70000 3.7 1e300",
            format!("{whole} 0 to 65535"),
        ),
        (
            "i16",
            "-32768 32767",
            "-32769 32768 40000",
            format!("{whole} -32768 to 32767"),
        ),
        (
            "u32",
            "4294967295",
            "4294967296 -1",
            format!("{whole} 0 to 4294967295"),
        ),
        (
            "i64",
            "-1 9223372036854775807",
            "9223372036854775808",
            format!("{whole} -9223372036854775808 to 9223372036854775807"),
        ),
        ("f32", "3e38 0.1 -7", "3.5e38 -1e300", format!("{number} -")),
        ("tight", "1 9", "0 10 70000", format!("{whole} 1 to 9")),
        (
            "tenths",
            "-40 6513.5 0.04",
            "-40.1 6513.6 70000",
            format!("{number} -40 to 6513.5"),
        ),
        (
            "both",
            "0 45.5",
            "-0.1 45.6 70000",
            format!("{number} 0 to 45.5"),
        ),
        (
            "below",
            "16384 -16383.5",
            "16384.5 -16384",
            format!("{number} -16383.5 to 16384"),
        ),
        (
            "coil",
            "0 1 on off",
            "2 -1 0.5",
            "expected 0 or 1 (off, on)".to_owned(),
        ),
        (
            "label",
            "abcd",
            "abcde",
            "expected text of at most 4 bytes".to_owned(),
        ),
    ];
    for (name, good, bad, allowed) in table {
        let order = |value: &str| of.requests(&["write", "u16=1", &format!("{name}={value}")]);
        for value in good.split(' ') {
            assert!(order(value).is_ok(), "{name}={value}: {:?}", order(value));
        }
        for value in bad.split(' ') {
            let refused = order(value).expect_err(value);
            let begin = format!("{name} cannot be {value}, {allowed}");
            assert!(refused.starts_with(&begin), "{refused}");
        }
    }
    // The request names the value that the register gets.
    let rounded = of.requests(&["write", "both=22.57"]).expect("a value");
    assert_eq!(rounded[0].words, "write both=22.6");
}

/// Addresses at which no Modbus device answers. Source: Modbus over serial line V1.02, section 2.2.
#[test]
fn an_address_of_no_device_is_refused() {
    let nothing = |_: &str| Err(String::new());
    let of = Description::parse("wrong.toml", REGISTERS, &nothing).expect("sound");
    for (address, reason) in [
        (0, Some("0 is a broadcast")),
        (1, None),
        (247, None),
        (248, Some("Modbus reserves 248 to 255")),
        // Each CO2 sensor of Senseair answers to it.
        (254, None),
        (255, Some("Modbus reserves 248 to 255")),
        (256, Some("one byte")),
        (65_535, Some("one byte")),
    ] {
        let text = REGISTERS.replace("address = 17", &format!("address = {address}"));
        let errors = [
            parse(&text).map_err(|error| error.to_string()),
            of.with_address(address).map(drop),
        ];
        for error in errors {
            let told = error.err();
            let is_right = match (&told, reason) {
                (Some(told), Some(reason)) => {
                    told.contains(reason) && told.contains("expected 1 to 247")
                }
                (told, reason) => told.is_none() && reason.is_none(),
            };
            assert!(is_right, "{address}: {told:?}");
        }
    }
}

/// Characters have 5 to 8 data bits and no, even or odd parity: nine bits, mark and space parity
/// are refused.
#[test]
fn a_line_of_nine_bits_or_mark_parity_is_refused() {
    for format in ["9N1", "8M1", "8S1", "4N1"] {
        let text = FRAMES.replace(
            "baud = 9600",
            &format!("baud = 9600, format = \"{format}\""),
        );
        let said = parse(&text).expect_err(format).to_string();
        let expected = format!("line.format: is \"{format}\", expected e.g. 8N1, 8E1 or 7O2");
        assert!(said.contains(&expected), "{said}");
    }
}

/// Errors whose fix is in another place than the key: the message names it.
#[test]
fn a_fix_in_another_place_is_named() {
    let text = |line: &str, frame: &str, value: &str, fields: &str| {
        format!(
            r#"
            name = "s"
            about = "s"
            endian = "little"
            line = {{ {line} }}
            frame = {{ {frame} }}
            [state]
            own = {{ value = "{value}" }}
            [[message]]
            name = "ask"
            from = "host"
            fields = [{fields}]
            [[message]]
            name = "told"
            from = "device"
            fields = [{{ name = "own", type = "u8" }}, {{ name = "rest", type = "bytes", size = 3 }}]
            [[on]]
            message = "ask"
            reply = "told"
            "#
        )
    };
    let error = |text: &str| parse(text).expect_err(text).to_string();
    let long = "sync = [0xAA], length = { at = 1, type = \"u8\", counts = \"rest\" }, max = 60";
    let one = "{ name = \"what\", type = \"u8\" }";
    assert_eq!(parse(&text("baud = 9600", long, "1 + 1", one)), Ok(()));

    let of_line = error(&text("baud = 9600", long, "own_address", one));
    assert!(
        of_line.contains("; own_address needs an address in [line]"),
        "{of_line}"
    );
    let here = error(&text("baud = 9600, address = 1", long, "own_address", one));
    assert!(
        here.contains(
            "; own_address is allowed only in \"on\", \"after\" and \"every\": use a variable"
        ),
        "{here}"
    );

    let counted = "{ name = \"each\", type = \"u8\" }, { name = \"of\", type = \"group\", repeat = \"rest\", \
                   fields = [{ name = \"id\", type = \"u8\" }, { name = \"data\", type = \"bytes\", size = \"each\" }] }";
    let unlimited = error(&text("baud = 9600", long, "1 + 1", counted));
    assert!(
        unlimited.contains("in at most 60 bytes: give \"each\" limits, it is a size of others"),
        "{unlimited}"
    );
    let limited = counted.replacen("type = \"u8\"", "type = \"u8\", limits = [1, 4]", 1);
    assert_eq!(parse(&text("baud = 9600", long, "1 + 1", &limited)), Ok(()));

    // Eight bytes hold one of sync, six of fields and one of the sum.
    let fixed = "sync = [0xAA], size = 8, checksum = \"sum8\"";
    let seven = "{ name = \"data\", type = \"bytes\", size = 7 }";
    let narrow = error(&text("baud = 9600", fixed, "1 + 1", seven));
    assert!(
        narrow.contains(
            "room for 6; expected fields of 6 bytes or another size of the frame. Sync bytes"
        ),
        "{narrow}"
    );

    let sum = fixed.replace("sum8", "twos-complement8");
    let unknown = error(&text("baud = 9600", &sum, "1 + 1", seven));
    assert!(
        unknown.contains("a sum, e.g. twos-complement, lrc, "),
        "{unknown}"
    );
}
