"""Fixes in degrees, which become metres from the first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import diffthrust as dft
from diffthrust import Column, InputError, Log


def track(folder: Path, latitude: np.ndarray, longitude: np.ndarray) -> Path:
    path = folder / "boat.csv"
    rows = (
        f"{k},1,{1 + k % 2},{a:.9f},{b:.9f},{3 * k}"
        for k, (a, b) in enumerate(zip(latitude, longitude, strict=True))
    )
    path.write_text("time,left_force_N,right_force_N,lat,lon,heading_deg\n" + "\n".join(rows))
    return path


def read(path: Path, **columns: Column) -> Log:
    return dft.read_log(path, inputs={"left_force": "left_force_N"}, measured=columns)


LATITUDE = Column("lat", unit="deg")
LONGITUDE = Column("lon", unit="deg")


def test_fixes_become_metres_from_the_first(tmp_path: Path) -> None:
    # One minute of arc is a nautical mile, 1852 m, of latitude at 45 degrees; a degree of longitude
    # at 60 degrees is 55.80 km on the ellipsoid of WGS 84 (tables of the Defense Mapping Agency).
    path = track(tmp_path, 60 + np.arange(4) / 60 / 100, 10 + np.arange(4) / 100)
    log = read(path, north=LATITUDE, east=LONGITUDE)
    np.testing.assert_allclose(log.measured["north"], np.arange(4) * 18.57, atol=0.01)
    np.testing.assert_allclose(log.measured["east"], np.arange(4) * 558.0, rtol=1e-4)
    assert log.units["north"] == log.units["east"] == "m"
    assert any("first fix, at 60.0000000, 10.0000000 degrees" in note for note in log.notes)


def test_neither_the_date_line_nor_a_receiver_without_a_fix_makes_a_jump(tmp_path: Path) -> None:
    longitude = np.array([0.0, 179.999, -180.0, -179.999])
    latitude = np.array([0.0, -17.0, -17.0, -17.0])
    log = read(track(tmp_path, latitude, longitude), north=LATITUDE, east=LONGITUDE)
    assert np.isnan(log.measured["east"][0])  # no fix yet: zeros
    np.testing.assert_allclose(np.diff(log.measured["east"])[1:], 106.5, rtol=1e-3)


def test_integers_of_autopilots_and_a_known_noise_are_scaled(tmp_path: Path) -> None:
    path = track(tmp_path, 1e7 * (45 + np.arange(4) / 6000), 1e7 * (7 + np.zeros(4)))
    latitude = Column("lat", unit="deg", scale=1e-7, noise=1e-5)
    log = read(path, north=latitude, east=Column("lon", unit="deg", scale=1e-7))
    np.testing.assert_allclose(np.diff(log.measured["north"]), 18.52, atol=0.01)
    assert log.noise["north"] == pytest.approx(1.11, rel=0.01)


@pytest.mark.parametrize(
    ("columns", "problem"),
    [
        ({"north": LATITUDE}, "'east' is none"),
        ({"north": LATITUDE, "east": Column("lon", unit="m")}, "'east' is none"),
        ({"north": LONGITUDE, "east": LATITUDE}, "latitude of -90 to 90 degrees, found 151"),
    ],
)
def test_a_position_that_is_no_fix_is_refused(
    tmp_path: Path, columns: dict[str, Column], problem: str
) -> None:
    path = track(tmp_path, -33 + np.zeros(4), 151 + np.zeros(4))
    with pytest.raises(InputError, match=problem):
        read(path, **columns)


def test_look_takes_fixes_for_the_position_of_a_vessel(tmp_path: Path) -> None:
    path = track(tmp_path, 60 + np.arange(40) / 1e4, 10 + np.arange(40) / 1e4)
    spec = tmp_path / "boat.toml"
    dft.look(path).save_spec(spec)
    (log,) = dft.load_spec(spec).train_logs()
    assert log.measured["north"][-1] == pytest.approx(434.5, abs=1)
    assert {"north", "east", "heading"} <= set(log.measured)
