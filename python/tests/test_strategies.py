"""Strategies for descriptions."""

import struct
from pathlib import Path

import pytest

pytest.importorskip("tomllib", reason="Python 3.11 has it")
pytest.importorskip("hypothesis")
from hypothesis import Phase, find, given, settings  # noqa: E402
from hypothesis.errors import NoSuchExample  # noqa: E402
from hypothesis.strategies import tuples  # noqa: E402

import hilrig  # noqa: E402

DEVICES = Path(__file__).parent.parent.parent / "devices"
#: The same examples in each run.
SAME = settings(max_examples=200, derandomize=True, database=None)
METER = hilrig.strategies(DEVICES / "modbus-meter.toml")


@settings(SAME, max_examples=50, deadline=None)
@given(write=METER.writes())
def test_writes_stay_within_type_and_limits(write) -> None:
    register, value = write
    # The registers of the description that a driver may write.
    limits = {"node": (1, 247), "alarm_voltage": (100, 300), "pulse_ms": (60, 1000)}
    if register.name == "relay":
        assert value in (True, False)
    elif register.name == "label":
        assert len(value) <= 8
    else:
        low, high = limits[register.name]
        assert low - 1e-6 <= value <= high + 1e-6
        # One count of the alarm is 0.1 V.
        assert round(value * 10) == pytest.approx(value * 10)


def described(tmp_path: Path, row: str) -> "hilrig.strategies.Strategies":
    path = tmp_path / "own.toml"
    keys = ", ".join(filter(None, ["at = 0", 'name = "it"', row]))
    path.write_text(f"[registers]\nholding = [{{ {keys} }}]\n")
    return hilrig.strategies(path)


def test_extremes_are_those_of_type_and_limits(tmp_path) -> None:
    single = lambda bits: struct.unpack(">f", bytes.fromhex(bits))[0]  # noqa: E731
    cases = [
        ("", 0, 65535),
        ('type = "u16le"', 0, 65535),
        ('type = "i24be"', -8388608, 8388607),
        ("limits = [0, 0.3], scale = 0.1", 0, 3 * 0.1),
        ('type = "i16", limits = [-2, 3], scale = -0.5', -2, 3),
        # 100 million counts of 0.01, whose limits are rounded.
        ('type = "u32", limits = [0.07, 1000000.07], scale = 0.01', 7 * 0.01, 100000007 * 0.01),
        # The 32-bit floats just inside 0.1 and 0.3: 3DCCCCCD is 0.100000001,
        # 3E99999A is 0.300000012.
        ('type = "f32be", limits = [0.1, 0.3]', single("3dcccccd"), single("3e999999")),
        ('type = "f64", limits = [0.1, 0.3]', 0.1, 0.3),
    ]
    for row, low, high in cases:
        values = described(tmp_path, row).values("it")
        for bound, is_beyond in ((low, lambda one: one < low), (high, lambda one: one > high)):
            assert find(values, lambda one: one == bound, settings=SAME) == bound, row
            with pytest.raises(NoSuchExample):
                find(values, is_beyond, settings=SAME)


def test_only_what_a_driver_may_write_is_written(tmp_path) -> None:
    cases = [
        ("unit = \"V\"", True),
        ('access = "read"', False),
        ('source = { kind = "ramp" }', False),
        ('value = "2 + 2"', False),
    ]
    for row, is_writable in cases:
        one = described(tmp_path, row)
        assert one.registers["it"].is_writable is is_writable, row
        if not is_writable:
            with pytest.raises(ValueError, match="own.toml has no register that a driver may"):
                one.writes()


def test_every_shipped_description_gives_values_of_its_types() -> None:
    kinds = set()
    for path in sorted(DEVICES.glob("*.toml")):
        registers = hilrig.strategies(path).registers.values()
        each = tuples(*[register.values() for register in registers])
        first = settings(SAME, phases=[Phase.generate])
        for register, found in zip(registers, find(each, lambda _: True, settings=first)):
            kinds.add(type(found))
            assert isinstance(found, str) == (register.kind == "str"), f"{path.name} {register}"
    assert kinds == {bool, int, float, str}


def test_faults_are_those_of_all_devices_and_its_own() -> None:
    common = ["off", "restart", "stuck", "garbage", "wrong", "slow"]
    assert METER.fault_names[:6] == common and "wrong-current" in METER.fault_names
    assert find(METER.faults(), lambda fault: fault == "wrong-current", settings=SAME)
    assert hilrig.strategies(DEVICES / "senseair-s8.toml").fault_names[:6] == common


def test_what_is_wrong_is_told_with_its_file(tmp_path) -> None:
    with pytest.raises(KeyError, match="no register 'volt', expected one of relay, voltage"):
        METER.values("volt")
    for row, said in [
        ('type = "u17"', "the register it has the type u17, expected one of u8"),
        ("limits = [0.2, 0.8]", r"no value of the register it \(u16\) is within its limits"),
    ]:
        with pytest.raises(ValueError, match=f"own.toml: {said}"):
            described(tmp_path, row).values("it")
    path = tmp_path / "own.toml"
    path.write_text('[registers]\ninput = [{ name = "it" }]\n')
    with pytest.raises(ValueError, match=r"own.toml: a register of .*input\]\] has no 'at'"):
        hilrig.strategies(path)
