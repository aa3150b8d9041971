"""PX4's logs, written by the published format and read by PX4's own library."""

import numpy as np
import pytest
from file_contents import contents

from diffthrust import Column, InputError, read_robot_log
from tests.damaged_files import outcomes
from tests.robot_files import write_ulog

pytest.importorskip("pyulog")

FORMATS = {
    "esc_report": [("int32_t", "esc_rpm"), ("float", "esc_voltage")],
    "actuator_outputs": [
        ("uint64_t", "timestamp"),
        ("uint32_t", "noutputs"),
        ("float[4]", "output"),
    ],
    "esc_status": [("uint64_t", "timestamp"), ("esc_report[2]", "esc")],
    "spectrum": [("uint64_t", "timestamp"), ("float[32]", "power"), ("float", "peak")],
}
STEPS = range(20)


@pytest.fixture
def flight(tmp_path):
    rows = []
    for k in STEPS:
        stamp = 5_000_000 + 50_000 * k
        rows.append((0, (stamp, 4, 1500 + 10 * (k // 5), 1500, 0, 0)))
        rows.append((1, (stamp + 10_000, 60 * k, 16.0, -60 * k, 15.5)))
        rows.append((2, (stamp + 20_000, 7 * k, 12.0, 0, 0.0)))
        rows.append((3, (stamp + 30_000, *[0.5] * 32, float("nan") if k < 5 else 2.0)))
    subscriptions = [("actuator_outputs", 0), ("esc_status", 0), ("esc_status", 1), ("spectrum", 0)]
    return write_ulog(tmp_path / "flight.ulg", FORMATS, subscriptions, rows, dropouts=[120])


def test_fields_are_read_back(flight):
    log = read_robot_log(
        flight,
        base="messages",
        inputs={"command": Column("actuator_outputs.output[0]", pwm={"stop": 1500, "full": 1900})},
        measured={"speed": Column("esc_status[0].esc[1].esc_rpm", unit="rpm")},
    )
    at = np.isfinite(log.measured["speed"])
    np.testing.assert_allclose(log.time[at], [0.01 + 0.05 * k for k in STEPS], atol=1e-9)
    np.testing.assert_allclose(log.values("speed", "rpm")[at], [-60 * k for k in STEPS])
    np.testing.assert_allclose(log.inputs["command"][at], [0.025 * (k // 5) for k in STEPS])
    assert any("lost messages 1 times, 0.12 s in all" in note for note in log.notes)


@pytest.mark.parametrize(
    ("column", "words", "mend"),
    [
        (
            "esc_status.esc[0].esc_rpm",
            "several 'esc_status': '0', '1'",
            "esc_status[0].esc[0].esc_rpm",
        ),
        (
            "esc_status[2].esc[0].esc_rpm",
            "'esc_status' as named, found the instances '0', '1'",
            "number",
        ),
        ("esc_stat.esc[0]", "the message 'esc_stat', found .*'esc_status'", "nearest"),
        ("spectrum.peek", "the field 'peek'", "nearest is 'peak'"),
        ("spectrum.timestamp", "the field 'timestamp'", "name a field"),
        ("spectrum", "a message and its field", "write it as"),
        ("a b.c", "a message and one of its fields", "write it as"),
    ],
)
def test_columns_that_cannot_be_meant(flight, column, words, mend):
    with pytest.raises(InputError, match=words) as caught:
        read_robot_log(flight, base=0.1, measured={"speed": column})
    assert "flight.ulg" in caught.value.problem
    assert mend in caught.value.mend


def test_all_fields_are_listed_but_for_long_arrays(flight):
    found = contents(flight)
    assert (found.kind, found.messages) == ("PX4 ULog", True)
    fields = {field.name: field for field in found.fields}
    assert set(fields) == {
        "actuator_outputs.noutputs",
        *(f"actuator_outputs.output[{k}]" for k in range(4)),
        *(
            f"esc_status[{i}].esc[{k}].esc_{what}"
            for i in (0, 1)
            for k in (0, 1)
            for what in ("rpm", "voltage")
        ),
        "spectrum.peak",
    }
    np.testing.assert_allclose(fields["spectrum.peak"].time, [0.03 + 0.05 * k for k in STEPS])
    assert np.isnan(fields["spectrum.peak"].values[:5]).all()
    for name, field in fields.items():  # what is listed can be read by its name
        if np.isfinite(field.values).all():
            log = read_robot_log(flight, base="q", measured={"q": name})
            np.testing.assert_allclose(log.measured["q"], field.values)


def test_no_change_of_a_byte_ends_in_a_traceback(flight):
    peak = {"q": "spectrum.peak"}
    readers = (contents, lambda path: read_robot_log(path, base=0.05, measured=peak))
    ended = outcomes(flight, readers, rounds=200, first=8)
    assert min(ended["read"], ended["told"]) > 20
    assert not ended["unnamed"]
