use super::*;

/// The registers of a draft: their lines without the indent.
fn rows(draft: &Draft) -> Vec<&str> {
    let lines = draft.text.lines();
    let rows = lines.filter_map(|line| line.strip_prefix("  { ")?.strip_suffix(" },"));
    rows.collect()
}

/// Maps as manuals print them: each line of the draft was worked out by hand.
#[test]
fn a_map_becomes_registers() {
    let cases: [(&str, &[&str]); 4] = [
        (
            "Address,Name,Type,Scale,Unit,Access,Remarks\n\
             0x10,Voltage L1,uint16,0.1,V,R,line voltage\n\
             17,Set point,int16,0.5,°C,R/W,\n",
            &[
                "at = 16, name = \"voltage_l1\", access = \"read\", scale = 0.1, unit = \"V\", about = \"line voltage\"",
                "at = 17, name = \"set_point\", type = \"i16\", scale = 0.5, unit = \"°C\", about = \"Set point\"",
            ],
        ),
        // Numbers with the table in front, a comma as decimal point, a quoted separator.
        (
            "register;description;data type;gain;min;max\n\
             40001;\"mode; off, on\";enum;;0;1\n\
             30003;power;Float;;;\n\
             30001-30002;energy;UDINT;100;;\n",
            &[
                "at = 0, name = \"energy\", type = \"u32\", scale = 0.01",
                "at = 2, name = \"power\", type = \"f32\"",
                "at = 0, name = \"mode_off_on\", limits = [0.0, 1.0], about = \"mode; off, on\"",
            ],
        ),
        // Tables in a column: 40001 is then an address.
        (
            "function code\taddr\tname\ttype\tdefault\n1\t0\trelay\tbool\ttrue\n\
             4\t40001\tserial\tstring[7]\tA1\n3\t0\tserial\tstring[8]\t17\n",
            &[
                "at = 0, name = \"relay\", initial = true",
                "at = 40001, name = \"serial\", type = \"str\", size = 8, initial = \"A1\"",
                "at = 0, name = \"serial_2\", type = \"str\", size = 8, initial = \"17\", about = \"serial\"",
            ],
        ),
        ("at,size\n3,\n", &["at = 3, name = \"holding_3\""]),
    ];
    for (text, wanted) in cases {
        let draft = import("meter", "map.csv", text).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(rows(&draft), wanted, "{text}");
    }
}

/// The layout of blocks is that of pymodbus 3.16: coils, discrete, input, holding.
#[test]
fn the_memory_of_a_simulator_becomes_tables() {
    let text = r#"{ "device_list": { "meter": {
        "setup": { "co size": 1, "di size": 1, "ir size": 4, "hr size": 8, "shared blocks": false },
        "write": [0, [6, 9]],
        "bits": [{ "addr": 0, "value": 5 }],
        "uint16": [{ "addr": [6, 7], "value": 9, "action": "random" }],
        "float32": [{ "addr": [2, 5], "value": 1.5 }],
        "string": [{ "addr": [10, 11], "value": "ab  " }]
    } } }"#;
    let draft = import("meter", "sim.json", text).unwrap_or_else(|error| panic!("{error}"));
    let found = rows(&draft);
    assert_eq!(found.len(), 16 + 5);
    assert_eq!(found[2], "at = 2, name = \"coils_2\", initial = true");
    assert_eq!(found[1], "at = 1, name = \"coils_1\"");
    assert_eq!(
        found[16..],
        [
            "at = 0, name = \"input_0\", type = \"f32\", initial = 1.5",
            "at = 2, name = \"input_2\", type = \"f32\", initial = 1.5",
            "at = 0, name = \"holding_0\", initial = 9",
            "at = 1, name = \"holding_1\", initial = 9",
            "at = 4, name = \"holding_4\", type = \"str\", size = 4, access = \"read\", initial = \"ab\"",
        ]
    );
    assert_eq!(
        draft.left_out,
        ["the action \"random\" of uint16[0]: a source of the register"]
    );
}

#[test]
fn a_wrong_map_is_refused_with_line_column_and_the_expected_value() {
    let cases = [
        ("", "m: is empty, expected a first line"),
        (
            "name,type\nx,u16\n",
            "m: line 1: no column of addresses, expected one called at, address",
        ),
        ("at,name\n", "m: has no register"),
        (
            "at,name\nx,y\n",
            "m: line 2: at: is \"x\", expected an address",
        ),
        (
            "at,type\n\n1,quark\n",
            "m: line 3: type: is \"quark\", expected a type as",
        ),
        (
            "at,scale\n1,two\n",
            "m: line 2: scale: is \"two\", expected a number",
        ),
        (
            "at,table\n1,attic\n",
            "m: line 2: table: is \"attic\", expected coil",
        ),
        (
            "at,name\n1,\"open\n",
            "m: line 2: a quotation mark is not closed",
        ),
        ("at,type\n1,u32\n2,u16\n", "m: line 3: "),
        ("{ \"a\": 1 }", "m: has no \"setup\""),
        (
            "{ \"a\": ",
            "m: line 1: EOF while parsing a value, expected JSON",
        ),
        (
            "{ \"setup\": { \"co size\": -1 } }",
            "m: setup.co size: expected a number",
        ),
    ];
    for (text, wanted) in cases {
        let error = import("meter", "m", text).expect_err(text);
        assert!(error.starts_with(wanted), "{text:?}: {error}");
    }
}

/// Damaged maps are refused or read; none panics.
#[test]
fn a_damaged_map_never_panics() {
    let maps = [
        "Address,Name,Type,Scale\n0x10,\"a \"\"b\"\"\",uint16,0.1\n40017,c,str8,1\n65535,d,u64,0,\n",
        r#"{"setup":{"co size":1,"di size":1,"ir size":4,"hr size":8},"uint32":[{"addr":[6,9],"value":1}],"write":[[6,7]]}"#,
    ];
    for map in maps {
        for at in 0..map.len() {
            let _ = import("m", "m", &map[..at]);
            let byte = ["", "9", "\"", ",", "é", "\n", "99999999999999999999", "-"][at % 8];
            let _ = import("m", "m", &format!("{}{byte}{}", &map[..at], &map[at + 1..]));
        }
    }
}
