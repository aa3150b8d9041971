"""Settings of autopilots: in their logs, and in the files that ground stations save."""

import pytest

from diffthrust import InputError
from diffthrust.logs import parameters_in
from tests.robot_files import (
    attitude,
    dataflash_parameters,
    parameter,
    write_dataflash,
    write_telemetry,
    write_ulog,
)

ATTITUDE = {"ATT": ("Qf", ["TimeUS", "Yaw"])}


def test_the_last_value_in_a_dataflash_log_counts(tmp_path):
    formats, rows = dataflash_parameters({"FRAME_CONFIG": 1.0, "MOT_3_DIRECTION": -1.0})
    rows += [("ATT", (5000, 1.0)), ("PARM", (6000, "FRAME_CONFIG", 2.0))]
    path = write_dataflash(tmp_path / "dive.bin", formats | ATTITUDE, rows)
    assert parameters_in(path) == {"FRAME_CONFIG": 2.0, "MOT_3_DIRECTION": -1.0}
    bare = write_dataflash(tmp_path / "bare.bin", ATTITUDE, [("ATT", (5000, 1.0))])
    assert parameters_in(bare) == {}


def test_parameters_of_a_telemetry_log(tmp_path):
    pytest.importorskip("pymavlink")
    messages = [(0.0, 1, parameter("FRAME_CONFIG", 4.0)), (0.1, 1, attitude(0.5))]
    assert parameters_in(write_telemetry(tmp_path / "a.tlog", messages)) == {"FRAME_CONFIG": 4.0}


def test_parameters_of_a_ulog(tmp_path):
    pytest.importorskip("pyulog")
    formats = {"depth": [("uint64_t", "timestamp"), ("float", "z")]}
    path = write_ulog(
        tmp_path / "a.ulg",
        formats,
        [("depth", 0)],
        [(0, (1000, 1.0))],
        parameters={"CA_AIRFRAME": 7, "CA_ROTOR0_PX": 0.25},
    )
    assert parameters_in(path) == {"CA_AIRFRAME": 7.0, "CA_ROTOR0_PX": 0.25}


@pytest.mark.parametrize(
    "text",
    [
        "# saved\nFRAME_CONFIG,2\nMOT_1_DIRECTION,-1.0\n",
        "\ufeffFRAME_CONFIG,2\nMOT_1_DIRECTION,-1.0\n",
        "FRAME_CONFIG 2 # vectored\nMOT_1_DIRECTION -1.000000\n",
        "# Vehicle-Id Component-Id Name Value Type\n1\t1\tFRAME_CONFIG\t2\t2\n"
        "1\t1\tMOT_1_DIRECTION\t-1\t2\n",
    ],
)
def test_files_of_three_ground_stations(text, tmp_path):
    path = tmp_path / "rov.params"
    path.write_text(text, "utf-8")
    assert parameters_in(path) == {"FRAME_CONFIG": 2.0, "MOT_1_DIRECTION": -1.0}


def test_what_holds_no_parameters_is_refused(tmp_path):
    (tmp_path / "rov.param").write_text("FRAME_CONFIG,2\nMOT_1_DIRECTION,\n")
    with pytest.raises(InputError, match=r"rov.param, line 2: .*'MOT_1_DIRECTION,'"):
        parameters_in(tmp_path / "rov.param")
    (tmp_path / "empty.param").write_text("# nothing\n")
    with pytest.raises(InputError, match=r"empty\.param: expected parameters, found none"):
        parameters_in(tmp_path / "empty.param")
    (tmp_path / "run.csv").write_text("t,u\n0,1\n1,2\n")
    with pytest.raises(InputError, match="or a file of its parameters, found a table of text"):
        parameters_in(tmp_path / "run.csv")
