//! Structures of Kaitai Struct and their drafts, worked out by hand from its user guide.

use super::super::{Draft, import};
use crate::schema::message::From;
use crate::value::Value;
use crate::{Description, Record};

fn drafted(text: &str) -> Draft {
    import("probe", "probe.ksy", text).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

/// The fields of a draft: their lines without braces.
fn fields(draft: &Draft) -> Vec<&str> {
    let lines = draft.text.lines();
    let lines = lines.filter_map(|line| line.strip_prefix("  { ")?.strip_suffix(" },"));
    lines.collect()
}

/// A file with the fields `seq`, each in one line.
fn with_fields(seq: &[&str]) -> String {
    let seq: Vec<String> = seq
        .iter()
        .map(|field| format!("  - {{{field}}}\n"))
        .collect();
    format!("meta: {{id: probe, endian: be}}\nseq:\n{}", seq.concat())
}

#[test]
fn fields_have_the_types_of_descriptions() {
    let cases: &[(&[&str], &[&str])] = &[
        (
            &["id: a, type: u1", "id: b, type: s2le", "id: c, type: f8"],
            &[
                "name = \"a\", type = \"u8\"",
                "name = \"b\", type = \"i16le\"",
                "name = \"c\", type = \"f64\"",
            ],
        ),
        // Bits are filled up to whole bytes.
        (
            &["id: a, type: b3", "id: b, type: u1"],
            &[
                "name = \"a\", type = \"b3\"",
                "name = \"unused_bits_1\", type = \"b5\"",
                "name = \"b\", type = \"u8\"",
            ],
        ),
        (
            &[
                "id: len, type: u2",
                "id: text, type: str, size: len - 2, encoding: ASCII",
            ],
            &[
                "name = \"len\", type = \"u16\", calc = \"len(text) + 2\"",
                "name = \"text\", type = \"str\", size = \"len - 2\"",
            ],
        ),
        (
            &[
                "id: n, type: u1",
                "id: all, type: u2, repeat: expr, repeat-expr: n / 2",
                "id: end, size-eos: true",
            ],
            &[
                "name = \"n\", type = \"u8\"",
                "name = \"all\", type = \"u16\", repeat = \"n // 2\"",
                "name = \"end\", type = \"bytes\", size = \"rest\"",
            ],
        ),
        (
            &[
                "id: a, type: u1, valid: 7, doc: always seven",
                "id: b, type: u1, valid: {min: 1, max: 0x10}",
                "id: state, type: u1, if: \"a & 0b11 != 0 and not (b == 1)\"",
            ],
            &[
                "name = \"a\", type = \"u8\", value = 7, about = \"always seven\"",
                "name = \"b\", type = \"u8\", limits = [1, 16]",
                "name = \"r_state\", type = \"u8\", if = \"a & 0b11 != 0 and not (b == 1)\"",
            ],
        ),
        // Constant bytes in the middle.
        (
            &["id: a, type: u1", "contents: [0x0D, 10]"],
            &[
                "name = \"a\", type = \"u8\"",
                "name = \"constant_4\", type = \"group\", fields = [{ type = \"u8\", value = 13 }, \
                 { type = \"u8\", value = 10 }]",
            ],
        ),
    ];
    for (seq, wanted) in cases {
        let draft = drafted(&with_fields(seq));
        assert_eq!(fields(&draft), *wanted, "{}", draft.text);
        assert_eq!(draft.left_out, [""; 0], "{}", draft.text);
    }
}

/// The frame as far as it follows from the fields.
#[test]
fn frames_follow_from_the_fields() {
    let magic = "contents: [0xAA, 0x55]";
    let cases: &[(&[&str], &str)] = &[
        (
            &[magic, "id: a, type: u4"],
            "sync = [0xAA, 0x55]\nsize = 6\n",
        ),
        (
            &[
                magic,
                "id: len, type: u2le",
                "id: data, size: len",
                "id: crc, type: u2",
            ],
            "sync = [0xAA, 0x55]\nhead = 4\nsize = \"6 + ((b2 | (b3 << 8)))\"\n",
        ),
        (
            &[
                "id: n, type: u1",
                "id: all, type: u2, repeat: expr, repeat-expr: n",
            ],
            "head = 1\nsize = \"1 + (((b0)) * 2)\"\n",
        ),
        (&["id: all, size-eos: true"], "silence = 3.5\n"),
    ];
    for (seq, wanted) in cases {
        let draft = drafted(&with_fields(seq));
        let frame = draft.text.split("[frame]\n").nth(1).expect("a frame");
        let frame = frame.split("\n[").next().expect("text");
        assert_eq!(frame, *wanted, "{}", draft.text);
        let has_note = draft
            .notes
            .iter()
            .any(|note| note.contains("the end of a frame"));
        assert_eq!(has_note, wanted.contains("silence"));
    }
}

const NESTED: &str = "
meta:
  id: packet
  title: A packet of a meter
  endian: le
  license: CC0-1.0
seq:
  - id: magic
    contents: 'MX'
  - id: kind
    type: u1
    enum: kinds
  - id: len
    type: u1
  - id: body
    size: len
    type:
      switch-on: kind
      cases:
        'kinds::reading': reading
        2: u2
  - id: sum
    type: u2be
types:
  reading:
    seq:
      - id: flags
        type: flags
      - id: count
        type: u1
      - id: values
        type: s2
        repeat: expr
        repeat-expr: count
      - id: extra
        type: u1
        if: flags.has_extra and _parent.kind == kinds::reading
    instances:
      mean:
        value: values[0]
  flags:
    seq:
      - {id: has_extra, type: b1}
      - {id: rest, type: b7}
enums:
  kinds:
    1: reading
    2: {id: short, doc: two bytes}
";

/// A frame worked out by hand: a reading with two values and the optional byte.
#[test]
fn a_draft_decodes_a_frame_of_the_structure() {
    let draft = drafted(NESTED);
    let nothing = |_: &str| Err(String::new());
    let of = Description::parse("probe", &draft.text, &nothing).expect("a draft");
    let bytes = [
        b'M', b'X', 1, 7, 0x80, 2, 0x34, 0x12, 0xFF, 0xFF, 9, 0xAB, 0xCD,
    ];
    let mut cutter = of.cutter();
    let frames: Vec<_> = protocols::Decode::push(&mut cutter, &bytes)
        .flatten()
        .collect();
    assert_eq!(frames.len(), 1, "{}", draft.text);
    let (message, values) = of.message(&frames[0], From::Device).expect("fits");
    assert_eq!(message.name(), "packet");
    let get = |record: &Record, name: &str| record.get(name).cloned();
    assert_eq!(get(&values, "kind"), Some(Value::Int(1)));
    let list = Value::List(vec![Value::Int(0x1234), Value::Int(-1)]);
    assert_eq!(get(&values, "body.values"), Some(list));
    assert_eq!(get(&values, "body.extra"), Some(Value::Int(9)));
    assert_eq!(get(&values, "sum"), Some(Value::Int(0xABCD)));
    assert!(of.words(&frames[0]).contains("kind reading"));
    let parts: Vec<_> = draft.left_out.iter().map(String::as_str).collect();
    assert_eq!(
        parts,
        [
            "line 6: meta.license: has no counterpart",
            "line 39: types.reading.instances.mean: is computed or at another position",
            "line 16: seq.body.kinds::reading.size: the fields of the type must fill it",
            "line 17: seq.body.type: a frame with another value and a size above 0 is an unknown message",
        ]
    );
}

/// In Kaitai Struct, a field whose value has no case has no bytes, or its bytes without a type. The
/// frames that the device of the draft sends, with 0 in each field, are messages of the draft.
#[test]
fn a_frame_without_a_case_of_its_value_is_a_message() {
    for size in ["", "    size: 2\n"] {
        let text = format!(
            "meta:\n  id: probe\n  endian: le\nseq:\n  - id: kind\n    type: u1\n    enum: kinds\n  \
             - id: body\n{size}    type:\n      switch-on: kind\n      cases:\n        \
             'kinds::a': s2\n  - id: tail\n    type: u1\nenums:\n  kinds:\n    1: a\n"
        );
        let draft = drafted(&text);
        let nothing = |_: &str| Err(String::new());
        let of = Description::parse("probe", &draft.text, &nothing).expect("a draft");
        let message = &of.messages()[0];
        assert!(draft.text.contains("\"switch\""), "{}", draft.text);
        let frame = of.frame(message, &Record::default()).expect("it fits");
        let mut cutter = of.cutter();
        let mut found: Vec<_> = protocols::Decode::push(&mut cutter, &frame)
            .flatten()
            .collect();
        protocols::Decode::idle(&mut cutter);
        found.extend(protocols::Decode::push(&mut cutter, &[]).flatten());
        let [frame] = &found[..] else {
            panic!("{found:?}");
        };
        assert!(of.message(frame, From::Device).is_some(), "{}", draft.text);
    }
}

/// Keys without a counterpart are reported with line and key. From a field that needs one, the
/// message is bytes.
#[test]
fn what_cannot_be_carried_over_is_reported() {
    let cases: &[(&str, &str)] = &[
        (
            "id: x, size: 4, process: xor(3)",
            "seq.x.process: changes the bytes",
        ),
        (
            "id: x, type: u1, repeat: until, repeat-until: _ == 0",
            "seq.x.repeat-until: ends at a value",
        ),
        (
            "id: x, type: other",
            "seq.x.type: there is no type \"other\" in the file",
        ),
        ("id: x, type: other(3)", "seq.x.type: has parameters"),
        (
            "id: x, size: _io.size",
            "seq.x.size: \"_io.size\" is no earlier field",
        ),
        (
            "id: x, size: later",
            "seq.x.size: \"later\" is no earlier field",
        ),
        (
            "id: x, size: a.to_s(10)",
            "seq.x.size: \"a.to_s\" has no counterpart",
        ),
        (
            "id: x, type: str, terminator: 10",
            "seq.x: ends at a character",
        ),
        ("id: x", "seq.x: has no \"type\" and no \"size\""),
        ("type: u1", "seq[1]: has no \"id\""),
    ];
    for (field, wanted) in cases {
        let draft = drafted(&with_fields(&["id: a, type: u1", field, "id: z, type: u1"]));
        assert_eq!(
            fields(&draft),
            [
                "name = \"a\", type = \"u8\"",
                "name = \"rest\", type = \"bytes\", size = \"rest\"",
            ],
            "{field}"
        );
        let wanted = format!("line 4: {wanted}");
        assert_eq!(draft.left_out, [wanted.as_str()], "{field}");
        assert!(draft.text.contains(&format!("# Left out: {wanted}.")));
    }
    // A key that changes nothing in the bytes is dropped alone.
    let draft = drafted(&with_fields(&[
        "id: a, type: u1, -webide-representation: '{a}'",
    ]));
    assert_eq!(
        draft.left_out,
        ["line 3: seq.a.-webide-representation: has no counterpart"]
    );
}

#[test]
fn wrong_files_are_refused() {
    let deep = format!("seq: {}", "[".repeat(100));
    let cases = [
        (
            "",
            "probe.ksy: is empty, expected a table with the key \"seq\"",
        ),
        ("meta: {id: a}", "probe.ksy: line 1: has no key \"seq\""),
        ("seq: [", "probe.ksy: line "),
        (&*deep, "probe.ksy: line 1: is nested too deep"),
        ("a: &x 1\nseq: *x", "probe.ksy: line 2: has an alias"),
        (
            "seq: []\nseq: []",
            "probe.ksy: line 2: has the key \"seq\" a second time",
        ),
        (
            "--- {seq: []}\n--- {seq: []}",
            "probe.ksy: line 2: begins a second document",
        ),
        ("seq: []", "probe.ksy: cannot be carried over: message[0]"),
    ];
    for (text, wanted) in cases {
        let error = import("probe", "probe.ksy", text).expect_err(text);
        assert!(error.starts_with(wanted), "{text}: {error}");
    }
    // A type within itself ends at its depth.
    let endless = "seq: [{id: a, type: t}]\ntypes: {t: {seq: [{id: b, type: t}]}}";
    let draft = drafted(endless);
    assert!(draft.left_out[0].contains("is nested too deep, or in itself"));
}
