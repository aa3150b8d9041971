"""MATLAB 7.3 and other HDF5 files, written by hdf5storage and h5py."""

import h5py
import hdf5storage
import numpy as np
import pytest
from file_contents import contents
from scipy.io import savemat

from diffthrust import Column, InputError, read_log
from tests.damaged_files import outcomes

T, U, RPM = np.arange(5) / 10, np.array([0, 1, 2, 2, 1]), np.array([0.0, 60, 90, 120, 100])


def read(path, u="u", rpm="rpm", **more):
    given = dict(time="t", inputs={"command": u}, measured={"speed": Column(rpm, unit="rpm")})
    return read_log(path, **{**given, **more})


def check(log):
    np.testing.assert_array_equal(log.time, T)
    np.testing.assert_array_equal(log.inputs["command"], U)
    np.testing.assert_allclose(log.values("speed", "rpm"), RPM)


@pytest.fixture
def matlab(tmp_path):
    path = tmp_path / "run.mat"
    variables = {
        "t": T[None, :],
        "u": U.astype(np.int16)[:, None],
        "rpm": RPM,
        "run": {"rpm": RPM, "ctrl": {"u": U.astype(np.float32)}},
        "data": np.column_stack([T, U, RPM]),
        "rows": np.vstack([U, RPM]),
        "text": "Boat A",
        "cells": np.array([1, "a"], dtype=object),
        "wave": np.array([1 + 2j, 2, 3, 4, 5]),
        "on": U > 1,
        "mass": 12.5,
        "nothing": np.zeros((0, 0)),
    }
    hdf5storage.savemat(str(path), variables, format="7.3", oned_as="row")
    return path


def test_vectors_structs_and_matrices(matlab):
    assert b"MATLAB 7.3" in matlab.read_bytes()[:128]
    check(read(matlab))
    check(read(matlab, "run.ctrl.u", "run.rpm"))
    check(read(matlab, "data(:,2)", "data(:,3)", time="data(:,1)"))
    check(read(matlab, "rows(1,:)", "rows(2,:)"))
    np.testing.assert_array_equal(read(matlab, "on").inputs["command"], U > 1)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("text", "found text"),
        ("cells", "found a cell array"),
        ("wave", "found complex numbers"),
        ("data", r"an array of shape \(5, 3\)"),
        ("mass", "expected 5 samples as in 't', found 1"),
        ("nothing", "shape|found 0"),
        ("run", "expected a variable 'run'"),
        ("data(:,4)", "nearest is 'data"),
    ],
)
def test_variables_that_are_no_channels(matlab, name, words):
    with pytest.raises(InputError, match=words):
        read(matlab, name)


def test_what_is_in_it(matlab):
    found = contents(matlab)
    assert found.kind == "MATLAB 7.3 file"
    assert {field.name for field in found.fields} == {
        *("t", "u", "rpm", "run.rpm", "run.ctrl.u", "on"),
        *("data(:,1)", "data(:,2)", "data(:,3)", "rows(1,:)", "rows(2,:)"),
    }
    for told in ("'text' (text)", "'cells' (a cell array)", "'mass' (1 values)"):
        assert told in found.notes[0]


def test_a_matrix_of_an_older_file(tmp_path):
    path = tmp_path / "run.mat"
    savemat(path, {"data": np.column_stack([T, U, RPM])})
    check(read(path, "data(:,2)", "data(:,3)", time="data(:,1)"))
    assert [field.name for field in contents(path).fields] == [
        "data(:,1)",
        "data(:,2)",
        "data(:,3)",
    ]


def test_files_of_other_programs(tmp_path):
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["t"], file["log/u"] = T, U.astype(">i4")
        file.create_dataset("log/rpm", data=RPM, compression="gzip", chunks=(2,))
        file["names"] = ["a", "b"]
        file["gone"] = h5py.SoftLink("/nowhere")
        file["log/loop"] = h5py.SoftLink("/log")
        file["record"] = np.zeros(5, dtype=[("a", "f8"), ("b", "i4")])
    check(read(path, "log.u", "log.rpm"))
    assert contents(path).kind == "HDF5 file"
    with pytest.raises(InputError, match="values of type"):
        read(path, "record", "log.rpm")


def test_no_change_of_a_byte_ends_in_a_traceback(matlab):
    ended = outcomes(matlab, (read, contents), rounds=200, first=512)
    assert min(ended["read"], ended["told"]) > 20
    assert not ended["unnamed"]
