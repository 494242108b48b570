"""Strategies made from the shipped descriptions."""

from pathlib import Path

import pytest
from hypothesis import given, settings

import hilrig

DEVICES = Path(__file__).parent.parent.parent / "devices"
METER = hilrig.strategies(DEVICES / "modbus-meter.toml")


@settings(max_examples=50, deadline=None)
@given(write=METER.writes())
def test_writes_stay_within_type_and_limits(write) -> None:
    register, value = write
    # The rows of the description that a driver may write.
    limits = {"node": (1, 247), "alarm_voltage": (100, 300), "pulse_ms": (60, 1000)}
    if register.name == "relay":
        assert value in (True, False)
    elif register.name == "label":
        assert len(value) <= 8
    else:
        low, high = limits[register.name]
        assert low - 1e-6 <= value <= high + 1e-6
        # A count of the alarm is worth 0.1 V.
        assert round(value * 10) == pytest.approx(value * 10)


@settings(max_examples=20, deadline=None)
@given(factor=METER.values("power_factor"), volts=METER.values("voltage"), fault=METER.faults())
def test_values_fit_their_type(factor, volts, fault) -> None:
    assert -32.768 <= factor <= 32.767 and volts == volts
    assert fault in ("wrong-current", "off", *METER.fault_names)


def test_every_shipped_description_has_strategies() -> None:
    for path in sorted(DEVICES.glob("*.toml")):
        for register in hilrig.strategies(path).registers.values():
            assert register.values() is not None, f"{path.name} {register.name}"


def test_what_is_unknown_is_told_with_what_is_known() -> None:
    with pytest.raises(KeyError, match="no register 'volt', expected one of relay, voltage"):
        METER.values("volt")
    with pytest.raises(ValueError, match=r"has no \[faults\]"):
        empty = hilrig.strategies(DEVICES / "senseair-s8.toml")
        empty.fault_names = []
        empty.faults()
