"""What replaces a parameter, its plain data, and the states and forms of effects."""

import math
from typing import ClassVar

import numpy as np
import pytest
from components import changed, described_fields, plain_description

import diffthrust as dft
from diffthrust import InputError, Parameter, parameter
from diffthrust.models import Normal, Ports, Signals, relative_to

# What replaces a parameter.

OLD = Parameter(1.0, "V", (0.0, 9.0), null=0.5, doc="old", pattern="{command}")


def test_a_value_or_a_description_or_some_fields():
    assert changed(OLD, 3, "level") == Parameter(
        3.0, "V", (0.0, 9.0), null=0.5, doc="old", pattern="{command}"
    )
    new = changed(OLD, Parameter(2.0, "", (1.0, None), fixed=True), "level")
    assert new == Parameter(2.0, "V", (1.0, None), True, null=0.5, doc="old", pattern="{command}")
    told = changed(OLD, Parameter(2.0, "V", null=2.0, doc="new"), "level")
    assert (told.null, told.doc) == (2.0, "new")
    fields = changed(OLD, {"size": 2.0, "prior": Normal(1.0, 0.5), "transform": "log"}, "level")
    assert (fields.value, fields.size, fields.prior.std, fields.transform) == (1.0, 2.0, 0.5, "log")
    for field in ("unit", "null", "doc", "probes"):
        with pytest.raises(InputError):
            changed(OLD, {field: "x"}, "level")
    for wrong in (True, "3", None, [1.0]):
        with pytest.raises(InputError, match="Parameter 'level': expected a number"):
            changed(OLD, wrong, "level")
    with pytest.raises(
        InputError,
        match=r"Parameter 'level': expected a value in the unit of command, found one in kg",
    ):
        changed(OLD, Parameter(1.0, "kg"), "level")


def test_the_same_value_is_the_same_object():
    assert OLD.with_value(OLD.value) is OLD
    assert OLD.with_value(2).value == 2.0


# As plain data.


def test_a_description_as_plain_data_and_back():
    p = parameter(0.3, "1/s", bounds=(0, None), null=0.0, size=2.0, prior=Normal(1, 2), fixed=True,
                  probes=relative_to("drive", 0.1, 0.2, power=-1), doc="told")  # fmt: skip
    told = plain_description("p", p)
    assert told == {
        "unit": "1/s", "value": 0.3, "bounds": (0, None), "fixed": True, "null": 0.0, "size": 2.0,
        "prior": {"mean": 1, "std": 2}, "doc": "told",
        "probes": {"signal": "drive", "factors": (0.1, 0.2), "power": -1},
    }  # fmt: skip
    assert parameter(**described_fields("p", told)) == p
    assert plain_description("p", "V") == "V"
    assert described_fields("p", "V") == {"unit": "V"}
    assert plain_description("p", Parameter(1.0)) == {"unit": "", "value": 1.0}
    log = plain_description("p", Parameter(1.0, transform="log"))
    assert log == {"unit": "", "value": 1.0, "transform": "log"}
    linear = plain_description("p", Parameter(1.0, bounds=(0, None)))
    assert linear["transform"] == "linear"
    assert plain_description("p", {"value": np.float64(2), "bounds": [0, None], "size": None}) == {
        "value": 2.0,
        "bounds": (0, None),
    }


@pytest.mark.parametrize(
    ("given", "bounds"),
    [((0, 2), (0.0, 2.0)), ((-math.inf, math.inf), (None, None)), ((None, 1), (None, 1.0))],
)
def test_infinite_bounds_are_none(given, bounds):
    assert described_fields("p", {"bounds": given})["bounds"] == bounds


@pytest.mark.parametrize(
    "fields",
    [
        {"value": "x"},
        {"null": [1.0]},
        {"probes": ("x",)},
        {"prior": {"mean": 1.0}},
        {"bounds": ("a", 1.0)},
        {"value": 10**400},
        {"probes": {"signal": "drive", "factors": ("x",)}},
    ],
)
def test_fields_that_describe_none(fields):
    with pytest.raises(InputError, match="describe no parameter"):
        described_fields("p", fields)


# Effects, their forms, and the ports.


class Pair(dft.Effect):
    """Two states of its own."""

    name = "pair"
    port = "drive"
    states: ClassVar = {"one": "V", "two": ""}
    gain: float = parameter(2.0, null=0.0)
    form_of: float = parameter(0.0, bounds=(0, 1), fixed=True, probes=(0.0, 1.0))
    held: float = parameter(0.3, bounds=(0, 1), fixed=True)

    def __call__(self, value, s):
        return value + self.gain * s.one - s.two

    def rates(self, value, s):
        return {"one": value - s.one, "two": 3.0 * s.two}

    def initial(self, value, s):
        return {"one": 0.5 * value}


def test_an_effect_keeps_its_states_apart():
    port = Ports((Pair(),), Signals({"pair.one": 3.0, "pair.two": 0.7, "command": 1.0}))
    assert port("load", 4.0) == 4.0
    assert port("drive", 4.0) == pytest.approx(4.0 + 6.0 - 0.7)
    assert port.rates == {"pair.one": 1.0, "pair.two": pytest.approx(2.1)}
    begin = Ports((Pair(),), Signals({"command": 1.0}), starting=True)
    assert begin("drive", 4.0) == pytest.approx(4.0 + 2.0 * 2.0)
    assert begin.initial == {"pair.one": 2.0, "pair.two": 0.0}


def test_the_form_of_an_effect():
    assert Pair().form == {}
    assert Pair(held=0.4, gain=1.0).form == {}
    assert Pair(form_of=1.0).form == {"form_of": 1.0}
    null = Pair(form_of=1.0).at_null()
    assert (null.gain, null.form_of, null._parameters["gain"].value) == (0.0, 1.0, 0.0)


def test_states_and_units_of_a_model_with_effects():
    model = dft.Thruster() + Pair()
    assert model.all_states == {"speed": "rad/s", "pair.one": "V", "pair.two": ""}
    assert dft.Thruster().channel_units["supply_voltage"] == "V"
    assert dft.Vessel().commanded_in("effort").parameters["m11"].unit == "kg/A"
    assert dft.Vessel("twin").commanded_in("effort").parameters["d33"].unit == "N m s/rad/A"
    twin = dft.Vessel("twin").commanded_in("effort")
    assert not twin.parameters["exponent"].fixed
    assert twin.commanded_in("N").parameters["exponent"].fixed
    kept = dft.Vessel("twin", command="effort", exponent=1.3).commanded_in("effort")
    assert kept.parameters["exponent"].value == 1.3


def test_what_acts_on_a_vessel_has_its_units_of_force():
    """A cross-flow drag stood as 7861 N s^2/m^2 beside masses in kg/A; it was some 390."""

    class Tow(dft.Effect):
        """A rope with a given pull; a user's own."""

        name = "tow"
        port = "surge_force"
        pull: float = dft.parameter(1.0, "N", null=0.0)
        length: float = dft.parameter(5.0, "m")

        def __call__(self, value, s):
            return value - self.pull

    added = ["quadratic_sway_drag", "sway_yaw_coupling", "wind", Tow()]
    names = (
        "m11",
        "quadratic_sway_drag.drag",
        "sway_yaw_coupling.mass",
        "wind.turning",
        "wind.direction",
        "tow.pull",
        "tow.length",
    )

    def units(model):
        return [model.parameters[name].unit for name in names]

    forces = ["kg", "N s^2/m^2", "kg m", "N s^2/m", "rad", "N", "m"]
    ratios = ["kg/A", "N s^2/m^2/A", "kg m/A", "N s^2/m/A", "rad", "N/A", "m"]
    twin = dft.Vessel("twin") + added
    assert units(twin) == forces
    assert units(twin.commanded_in("effort")) == ratios
    assert units(twin.commanded_in("effort").commanded_in("N")) == forces
    assert units(dft.Vessel() + added) == ratios
    assert twin.ports["yaw_moment"] == "moment about z [N m]"
    assert "steering" not in twin.ports
    assert dft.Vessel().ports["yaw_moment"] == "moment about z, in units of A m"
    assert twin.commanded_in("effort").ports["surge_force"] == "force along x, in units of A"
