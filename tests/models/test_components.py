"""Models and effects as components: their data, structure, refusals, and what may be read."""

import inspect
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from components import Effect, effect_module, elementwise, expect, file_of

import diffthrust as dft
from diffthrust import InputError
from diffthrust.effects import ActuatorLag, CommandOffset, Curve, Formula
from diffthrust.models import Ports, Signals


class Own(dft.Thruster):
    """With an argument that is kept, and one that is not."""

    name = "own_thruster"

    def __init__(self, blades=3, hidden=None, **parameters):
        self._set(blades=blades)
        super().__init__(**parameters)


def test_a_component_as_plain_data():
    told = (dft.Thruster(alpha=0.05) + ActuatorLag()).as_plain()
    assert told["name"] == "thruster"
    assert told["own"] is None
    assert told["arguments"] == {"command": "V"}
    assert told["parameters"]["alpha"].value == 0.05
    (effect,) = told["effects"]
    assert (effect["name"], effect["own"], effect["arguments"]) == ("actuator_lag", None, {})
    assert dft.Vessel("twin").arguments == {"drive": "twin", "command": "N"}
    own = Own(blades=4)
    assert own.own
    assert not dft.Thruster().own
    with pytest.raises(InputError, match="argument 'hidden', which it does not keep"):
        own.as_plain()
    own._set(hidden=None)
    whole = own.as_plain()
    assert whole["own"] == {
        "class": "Own", "module": __name__, "file": inspect.getfile(Own),
    }  # fmt: skip
    for fine in (3, 1.5, "a", True, (1, "b"), {"x": (1, 2)}, None):
        own._set(blades=fine)
        assert own.as_plain()["arguments"]["blades"] == fine
    for wrong in ([1], {1}, object(), (1, [2]), {"x": [1]}):
        own._set(blades=wrong)
        with pytest.raises(InputError, match="argument 'blades', now "):
            own.as_plain()


def test_the_script_that_defines_a_class():
    assert file_of(Own) == inspect.getfile(Own)
    assert file_of(type("Empty", (), {})) is None


def test_structure_is_class_and_options():
    assert dft.Thruster().structure == (dft.Thruster, "V")
    assert dft.Vessel().structure == (dft.Vessel, "propeller", "rev/s")
    both = dft.Thruster() + CommandOffset()
    assert both.structure == (dft.Thruster, "V", (CommandOffset,))
    leaves, tree = jax.tree.flatten(both.replace(alpha=0.3))
    assert leaves == [0.3, 42.0, 0.019, 0.1]
    fixed = jax.tree.structure(both.fix("alpha"))
    assert tree != fixed
    assert hash(tree) == hash(jax.tree.structure(both))


def test_names_that_are_none_are_refused_with_the_nearest():
    with pytest.raises(InputError, match=r"Thruster has no parameter 'alpa' \(the nearest is 'alp"):
        dft.Thruster(alpa=1.0)
    with pytest.raises(InputError, match=r"no parameter 'zzz'; it has 'alpha', 'beta', 'ct'"):
        dft.Thruster(zzz=1.0)
    with pytest.raises(InputError, match='Add the effect "command_deadband" first'):
        dft.Thruster().replace({"command_deadband.half_width": 0.1})
    for name in ("sway_yaw_coupling.mass", "command_deadband.half_widht"):  # that has no place
        with pytest.raises(InputError, match="Correct the name"):
            dft.Thruster().replace({name: 0.1})
    with pytest.raises(InputError, match=r"expected a command in 'V', .*, found 'kg'"):
        dft.Thruster(command="kg")
    with pytest.raises(InputError, match="expected a command in the unit that it names itself"):
        dft.AxisVehicle().commanded_in("N")
    assert dft.AxisVehicle().commanded_in("").inputs == {"thrust": "N"}
    with pytest.raises(InputError, match="found ''"):
        dft.Thruster().commanded_in("")


def test_a_model_in_another_unit_of_its_command():
    model = (dft.Thruster(beta=7.0) + CommandOffset()).commanded_in("A")
    assert (model.command, model.inputs, model.beta) == ("A", {"command": "A"}, 7.0)
    assert model.parameters["beta"].unit == "rad/(A s^2)"
    assert model.parameters["command_offset.offset"].unit == "A"
    assert (dft.Thruster(command="effort") + CommandOffset()).effects[0]._parameters[
        "offset"
    ].unit == "effort"


def test_what_surrounds_a_thruster_keeps_its_value_in_another_unit_of_the_command():
    bound = dft.actuators.Azimuth(dft.Thruster()).bind({"slew_time": 3.0})
    assert bound.commanded_in("effort").slew_time == 3.0


def test_what_may_be_read_at_a_port_and_on_a_channel():
    twin = dft.Vessel("twin")
    assert twin.signals_at("left_force") == (
        "time", "left_force", "right_force", "wind_speed", "wind_direction",
    )  # fmt: skip
    states = tuple(twin.states)
    here = ("time", "left_force", "right_force", *states, "wind_speed", "wind_direction")
    assert twin.signals_at("surge_through_water") == here
    told = ("surge_through_water", "sway_through_water", "m22", "i33")
    assert twin.signals_at("surge_force") == (*here, *told)
    late = ("sway_alone", "yaw_alone")
    assert twin.signals_at("sway_acceleration") == (*here, *told, *late)
    assert dft.Thruster().signals_at("thrust") == (
        "time", "command", "speed", "thrust", "inflow", "supply_voltage",
    )  # fmt: skip


def test_a_made_effect_needs_the_optional_channels_that_it_reads():
    formula = Formula("load", "a * inflow * speed", a="")
    added = (dft.Thruster() + formula).effects[0]
    assert added.needs == ("inflow",)
    assert (dft.Thruster() + Formula("load", "a * speed", a="")).effects[0].needs == ()
    with pytest.raises(InputError, match=r"already has the effect 'formula'") as refused:
        _ = dft.Thruster() + formula + formula
    assert refused.value.mend.endswith("Or give one of them another name.")
    with pytest.raises(InputError) as refused:
        _ = dft.Thruster() + ActuatorLag() + ActuatorLag()
    assert refused.value.mend == 'Take it out first: model - "actuator_lag".'


def test_made_effects_as_tables():
    curve = Curve("load", "speed", -1.0, 2.0, name="stall")
    table = curve.as_table()
    assert next(iter(table.items())) == ("curve", "speed")
    assert (table["port"], table["low"], table["name"]) == ("load", -1.0, "stall")
    assert "signal" not in table
    formula = Formula("load", "a * speed", a={"unit": "1/s", "value": 0.0})
    assert formula.as_table() == {
        "formula": "a * speed", "port": "load", "name": "formula",
        "a": {"unit": "1/s", "value": 0.0},
    }  # fmt: skip


@pytest.mark.parametrize("name", ["two words", "", "1a", "größe", None])
def test_names_and_ports_are_words(name):
    for given in ({"name": name, "port": "load"}, {"name": "a", "port": name}):
        with pytest.raises(InputError, match="made of letters, digits and underscores"):
            Formula(given["port"], "b * speed", name=given["name"], b="")


def test_an_effect_says_of_itself_what_it_must():
    with pytest.raises(InputError, match="expected port in the class body"):
        type("NoPort", (Effect,), {"name": "no_port"})
    with pytest.raises(InputError, match="expected port in the class body"):
        type("NoPort", (dft.effects.CommandOffset,), {"name": "my_offset", "port": ""})
    with pytest.raises(InputError, match="is not made of letters"):
        type("Wrong", (Effect,), {"name": "a b", "port": "load"})
    made = type("Two", (Effect,), {"name": "two_ports", "ports": ("load", "drive")})
    assert made.port == "load"
    one = type("One", (Effect,), {"name": "one_port", "port": "load"})
    assert one.ports == ("load",)
    with pytest.raises(InputError, match="has states but no rates"):
        one().rates(1.0, Signals({}))
    assert one().initial(1.0, Signals({})) == {}
    assert one().scaled(dict) is not None


def test_a_port_called_like_a_channel_is_refused():
    for kind in ("inputs", "optional_inputs", "outputs"):
        with pytest.raises(InputError, match="the port 'push' has the name of an input or"):
            type(
                "Twice", (dft.Model,), {"name": "twice", kind: {"push": "N"}, "ports": {"push": ""}}
            )


def test_signals():
    s = Signals({"speed": 3.0, "lag.x": 1.0})
    assert (s.speed, s["speed"], list(s), len(s)) == (3.0, 3.0, ["speed", "lag.x"], 2)
    assert s.also({"speed": 4.0}).speed == 4.0
    assert s.speed == 3.0
    with pytest.raises(InputError, match=r"'command', which .* do not have; there are 'speed'\.\n"):
        _ = s.command
    assert not hasattr(s, "__array__")


def test_what_is_not_elementwise_is_told():
    def branch(x):
        with elementwise("Here"):
            return x if x > 0 else -x

    for wrong in (branch, lambda x: np.sin(x) if False else float_of(x)):
        with pytest.raises(InputError, match="Here: a Python 'if'"):
            jax.jit(wrong)(1.0)
    with pytest.raises(ZeroDivisionError), elementwise("Here"):
        _ = 1 / 0


def float_of(x):
    with elementwise("Here"):
        return np.asarray(x)


def test_a_mapping_that_lacks_a_name():
    expect("f", "rate", ("a",), {"a": 1, "b": 2})
    with pytest.raises(InputError, match="f: expected a rate 'b', found 'a'"):
        expect("f", "rate", ("a", "b"), {"a": 1})
    with pytest.raises(InputError, match="found none"):
        expect("f", "rate", ("a",), {})


def test_rates_that_lack_a_state():
    class Lame(ActuatorLag):
        name = "lame"

        def rates(self, value, s):
            return {}

    port = Ports((Lame(),), Signals({"lame.response": 1.0}))
    with pytest.raises(InputError, match=r"Lame\.rates: expected a rate of the state"):
        port("drive", jnp.asarray(1.0))


# The catalogue, with what installed packages add.


class Fouling(CommandOffset):
    """Of another package."""

    name = "test_fouling"


@pytest.fixture
def installed(monkeypatch):
    def of(*things):
        points = [SimpleNamespace(name=n, load=lambda t=thing: t) for n, thing in things]
        monkeypatch.setattr(effect_module, "entry_points", lambda group: points)
        effect_module.catalogue.cache_clear()

    yield of
    monkeypatch.undo()
    effect_module.catalogue.cache_clear()


def test_effects_of_installed_packages(installed):
    installed(("fouling", Fouling))
    known = list(effect_module.catalogue())
    assert known[-1] == "test_fouling"
    assert known[:5] == [
        "command_deadband", "command_delay", "command_offset", "command_rate_limit",
        "command_saturation",
    ]  # fmt: skip
    assert isinstance(effect_module.effect_named("test_fouling"), Fouling)
    with pytest.raises(InputError, match=r"'test_foulin' is not known; .* are 'test_fouling'"):
        effect_module.effect_named("test_foulin")
    with pytest.raises(InputError) as error:
        effect_module.effect_named("command_dedband")
    assert "names the nearest are 'command_deadband', " in str(error.value)
    assert len(str(error.value)) < 400  # and not the whole catalogue


@pytest.mark.parametrize("thing", [3, dft.Thruster, CommandOffset()])
def test_an_entry_point_that_is_no_effect(installed, thing):
    installed(("odd", thing))
    with pytest.raises(InputError, match=r"entry point 'odd' .* which is no effect"):
        effect_module.catalogue()


def test_an_entry_point_with_a_name_that_is_taken(installed):
    installed(("again", CommandOffset))
    with pytest.raises(InputError, match="gives an effect 'command_offset', a name that is taken"):
        effect_module.catalogue()


def test_the_table_of_a_notebook():
    told = dft.Thruster().fix("ct").replace(alpha={"bounds": (0.01, 0.5)})._repr_html_()
    for words in ("thruster", "0.037", "0.01", "0.5", "fixed", "propeller load"):
        assert words in told
