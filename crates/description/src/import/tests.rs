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
    let cases: &[(&str, &[&str])] = &[
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
        // Hexadecimal addresses have no prefix of a table.
        (
            "Address,Name,Type\n0x0000,a,u16\n0x0010,b,u16\n0x9C41,c,u16\n0100h,d,u16\n0xFFFF,e,u16\n",
            &[
                "at = 0, name = \"a\"",
                "at = 16, name = \"b\"",
                "at = 256, name = \"d\"",
                "at = 40001, name = \"c\"",
                "at = 65535, name = \"e\"",
            ],
        ),
        // The orders of words and bytes of 0xAABBCCDD: ABCD, CDAB, BADC, DCBA.
        (
            "at,type,word order\n0,f32,Big Endian\n2,f32,LSW first\n4,f32,BADC\n6,f32,dcba\n8,u32,little-endian\n",
            &[
                "at = 0, name = \"holding_0\", type = \"f32\"",
                "at = 2, name = \"holding_2\", type = \"f32\", words = \"little\"",
                "at = 4, name = \"holding_4\", type = \"f32\", endian = \"little\", words = \"big\"",
                "at = 6, name = \"holding_6\", type = \"f32\", endian = \"little\", words = \"little\"",
                "at = 8, name = \"holding_8\", type = \"u32\", words = \"little\"",
            ],
        ),
        // Sizes in registers select the type, or count two bytes of a text each.
        (
            "at,type,registers\n0,uint,2\n2,int,4\n6,,1\n7,string,8\n15,str_utf8,3\n18,int32,2\n",
            &[
                "at = 0, name = \"holding_0\", type = \"u32\"",
                "at = 2, name = \"holding_2\", type = \"i64\"",
                "at = 6, name = \"holding_6\"",
                "at = 7, name = \"holding_7\", type = \"str\", size = 16",
                "at = 15, name = \"holding_15\", type = \"str\", size = 6",
                "at = 18, name = \"holding_18\", type = \"i32\"",
            ],
        ),
        (
            "at,type,bytes\n0,uint,2\n1,int,4\n3,string,20\n",
            &[
                "at = 0, name = \"holding_0\"",
                "at = 1, name = \"holding_1\", type = \"i32\"",
                "at = 3, name = \"holding_3\", type = \"str\", size = 20",
            ],
        ),
        // Access, and bits.
        (
            "at;table;mode;default\n0;Coil;R/W;no\n1;coils;read-only;0.0\n2;co;3/6/16;ON\n5;holding;3;1,5\n",
            &[
                "at = 0, name = \"coils_0\", initial = false",
                "at = 1, name = \"coils_1\", access = \"read\", initial = false",
                "at = 2, name = \"coils_2\", initial = true",
                "at = 5, name = \"holding_5\", access = \"read\", initial = 1.5",
            ],
        ),
        // Not all addresses have a prefix of a table.
        (
            "at\n30000\n30001\n32080\n37113\n",
            &[
                "at = 30000, name = \"holding_30000\"",
                "at = 30001, name = \"holding_30001\"",
                "at = 32080, name = \"holding_32080\"",
                "at = 37113, name = \"holding_37113\"",
            ],
        ),
        // With a column of tables, a table is numbered if all of its addresses are.
        (
            "fc,at\n3,40001\n3,40011\n4,0\n",
            &[
                "at = 0, name = \"input_0\"",
                "at = 0, name = \"holding_0\"",
                "at = 10, name = \"holding_10\"",
            ],
        ),
        // A line break in a title; a name that begins like a comment.
        (
            "Name,Address,\"Data\ntype\",\"Valid\nrange\"\n# 1 flow,0,u32,1-2\n# a comment,,,\n",
            &["at = 0, name = \"r_1_flow\", type = \"u32\", about = \"# 1 flow\""],
        ),
    ];
    for (text, wanted) in cases {
        let draft = import("meter", "map.csv", text).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(rows(&draft), *wanted, "{text}");
    }
}

/// Parts that are dropped, and the reading of ambiguous parts, are printed and in the draft.
#[test]
fn dropped_and_ambiguous_parts_are_reported() {
    let cases: &[(&str, &[&str], &[&str])] = &[
        (
            "at\n40001\n40012\n",
            &[],
            &["address 40001 is read as holding 0, and the others alike"],
        ),
        (
            "at\n30000\n30001\n",
            &[],
            &[
                "address 30001 is read as holding 30001, not as input 0: other addresses have no such prefix",
            ],
        ),
        (
            "fc,at,\"max\nvalue\",max\n3,0,1,7\n,1,,\n4,,,\n",
            &[
                "the column \"max value\"",
                "lines without an address: 1, at 5",
                "\"max\" of line 3, which has no second limit",
            ],
            &["lines without a table take the table of the line before: 1"],
        ),
        (
            "at,type,size\n0,string,16\n",
            &[],
            &["sizes of texts are read as bytes; a column \"registers\" would be in registers"],
        ),
        // All words and codes that allow no read.
        (
            "at,access\n0,W\n1,R\n2,RW\n3,Write Only\n4,WO\n5,write\n6,6/16\n7,3/6\n8,\n",
            &[],
            &[
                "write-only registers: 5, in line 2, 5, 6, 7, 8; the device also answers reads of them, with the value written last (a register of a description cannot refuse reads)",
            ],
        ),
    ];
    for (text, left_out, notes) in cases {
        let draft = import("meter", "map.csv", text).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(
            (&draft.left_out[..], &draft.notes[..]),
            (
                &left_out
                    .iter()
                    .map(|part| (*part).to_owned())
                    .collect::<Vec<_>>()[..],
                &notes
                    .iter()
                    .map(|part| (*part).to_owned())
                    .collect::<Vec<_>>()[..],
            ),
            "{text}"
        );
        for part in left_out.iter().chain(*notes) {
            assert!(draft.text.contains(&format!("{part}.\n")), "{text}: {part}");
        }
    }
}

/// Words outside of the lists are refused, with line, column and the expected words.
#[test]
fn no_word_is_guessed() {
    let cases = [
        ("words", "middle", "ABCD, CDAB"),
        ("words", "PDP", "ABCD, CDAB"),
        ("access", "unknown", "R, RW"),
        ("access", "not writable", "R, RW"),
        ("access", "view", "R, RW"),
        ("mode", "power", "R, RW"),
        ("access", "Lesen/Schreiben", "R, RW"),
        ("access", "99", "R, RW"),
        ("function", "Config", "coil, discrete"),
        ("kind", "Counter", "coil, discrete"),
        ("object", "Dint", "coil, discrete"),
        ("object", "Diagnostic", "coil, discrete"),
        ("fc", "1/3", "coil, discrete"),
        ("max", "\"65,535\"", "a number with a point"),
        ("scale", "\"1,000\"", "a number with a point"),
        ("scale", "\"0,1\"", "a number with a point"),
        ("size", "2", "the size of the type"),
        ("size", "0", "a number from 1"),
        ("registers", "3", "the size of the type"),
        ("type", "string[65535]", "the size of the type"),
        ("type", "string[0]", "the size of the type"),
        ("type", "string", "the size of the type"),
        ("type", "str_utf99x", "a type as"),
        ("default", "maybe", "a number with a point"),
        ("at", "70000", ""),
        ("at", "1.5", "an address"),
    ];
    for (column, word, expected) in cases {
        let text = match column {
            "at" => format!("at\n{word}\n"),
            column => format!("at,{column}\n7,{word}\n"),
        };
        let error = import("meter", "m", &text).expect_err(&text);
        let plain = word.trim_matches('"');
        let start = format!("m: line 2: {column}: is \"{plain}\", expected {expected}");
        assert!(error.starts_with(&start), "{text:?}: {error}");
    }
    let more = [
        (
            "at;scale\n1;1,000\n",
            "m: line 2: scale: is \"1,000\", expected a number, without",
        ),
        (
            "at,type,size\n1,u32,1\n",
            "m: line 2: size: is \"1\", expected the size",
        ),
        (
            "at,type,size\n1,uint,2\n",
            "m: line 2: size: is \"2\", expected the size",
        ),
        (
            "at,type,registers\n1,str8,5\n",
            "m: line 2: registers: is \"5\", expected the size",
        ),
        (
            "at,scale,gain\n1,0.1,100\n",
            "m: line 2: gain: is \"100\", expected nothing",
        ),
        (
            "at,table,initial\n1,coil,open\n",
            "m: line 2: initial: is \"open\", expected 0, 1",
        ),
        (
            "Name,at\n#1 flow,x\n",
            "m: line 2: at: is \"x\", expected an address",
        ),
    ];
    for (text, wanted) in more {
        let error = import("meter", "m", text).expect_err(text);
        assert!(error.starts_with(wanted), "{text:?}: {error}");
    }
}

/// Defaults of the simulator: a value and an action apply to entries without one.
#[test]
fn entries_without_a_value_get_the_default() {
    let text = r#"{ "setup": { "co size": 1, "di size": 1, "ir size": 4, "hr size": 8,
          "shared blocks": false, "defaults": {
            "value": { "bits": 1, "uint16": 122, "string": "x" }, "action": { "uint16": "random" } } },
        "bits": [0, { "addr": 1, "value": true }],
        "uint16": [[6, 7], { "addr": 8, "value": 9, "action": "timestamp" }],
        "string": [{ "addr": [9, 10], "value": "ab" }, { "addr": 11 }] }"#;
    let draft = import("meter", "m", text).unwrap_or_else(|error| panic!("{error}"));
    let found = rows(&draft);
    assert_eq!(
        found[0],
        "at = 0, name = \"coils_0\", access = \"read\", initial = true"
    );
    assert_eq!(found[16], "at = 0, name = \"discrete_0\", initial = true");
    assert_eq!(
        found[32..],
        [
            "at = 0, name = \"holding_0\", access = \"read\", initial = 122",
            "at = 1, name = \"holding_1\", access = \"read\", initial = 122",
            "at = 2, name = \"holding_2\", access = \"read\", initial = 9",
            "at = 3, name = \"holding_3\", type = \"str\", size = 4, access = \"read\", initial = \"ab  \"",
            "at = 5, name = \"holding_5\", type = \"str\", size = 2, access = \"read\", initial = \"x \"",
        ]
    );
    let actions = ["random\" of uint16[0]", "timestamp\" of uint16[1]"];
    let actions = actions.map(|action| format!("the action \"{action}: a source of the register"));
    assert_eq!(draft.left_out, actions);
    let missing = text.replace("\"uint16\": 122, ", "");
    let error = import("meter", "m", &missing).expect_err("no value");
    assert_eq!(
        error,
        "m: uint16[0].value: is missing, expected it here or in setup.defaults.value.uint16"
    );
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
            "at = 4, name = \"holding_4\", type = \"str\", size = 4, access = \"read\", initial = \"ab  \"",
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

/// A title that names the base of its numbers decides about digits without a mark.
#[test]
fn a_column_of_hexadecimal_numbers_is_read_as_such() {
    for title in [
        "Address (hex)",
        "Address [HEX]",
        "Hex Address",
        "address_hex",
        "Register (0x)",
        "Modbus address (hexadecimal)",
    ] {
        let map =
            format!("{title},name,type\n10,a,uint16\n1F,b,uint16\n0x20,c,uint16\n21h,d,uint16\n");
        let draft = import("x", "x.csv", &map).expect(title);
        let wanted = [16, 31, 32, 33].into_iter().zip(["a", "b", "c", "d"]);
        let wanted: Vec<_> = wanted
            .map(|(at, name)| format!("at = {at}, name = \"{name}\""))
            .collect();
        assert_eq!(rows(&draft), wanted, "{title}");
    }
    let map = "Address (dec),name,default (hex)\n10,a,1F\n";
    let draft = import("x", "x.csv", map).expect("a map");
    assert_eq!(rows(&draft), ["at = 10, name = \"a\", initial = 31"]);
    let error = import("x", "x.csv", "Address (hex),name\n1G,a\n").expect_err("no number");
    let wanted =
        "x.csv: line 2: Address (hex): is \"1G\", expected a hexadecimal address, as 10 or 0x10";
    assert_eq!(error, wanted);
}

/// A property that a register cannot have is an error with its line; it is not left out.
#[test]
fn a_scale_of_0_and_a_value_beyond_the_type_are_refused() {
    for (map, wanted) in [
        (
            "address,name,scale\n2,c,0\n",
            "x.csv: line 2: scale: is \"0\", expected a number other than 0, or an empty cell for no scale",
        ),
        (
            "address,name,gain\n2,c,0.0\n",
            "x.csv: line 2: gain: is \"0.0\", expected a number other than 0, or an empty cell for no scale",
        ),
        (
            "address,name,type,initial\n1,b,uint16,1\n0,a,uint16,70000\n",
            "line 3: ",
        ),
        ("address,name,type,initial\n0,a,uint16,-5\n", "line 2: "),
    ] {
        let error = import("x", "x.csv", map).expect_err(map);
        assert!(error.contains(wanted), "{error}");
    }
}
