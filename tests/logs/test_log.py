import copy
import dataclasses
import pickle

import numpy as np
import pytest

import diffthrust as dft
from diffthrust import InputError, Log

NAN = float("nan")


def make(**changes):
    given = dict(
        time=[0, 40, 80, 200],
        inputs={"command": [0.0, 1.0, 2.0, 2.0]},
        measured={"speed": [0.0, 60.0, NAN, 120.0], "thrust": [0.0, 0.001, 0.002, 0.003]},
        units={"time": "ms", "speed": "rpm", "thrust": "kN"},
        unsigned=("speed",),
        noise={"speed": 3.0},
        name="run1",
    )
    return Log(**{**given, **changes})


def test_numbers_are_kept_in_the_library_units():
    log = make()
    np.testing.assert_allclose(log.time, [0, 0.04, 0.08, 0.2])
    np.testing.assert_allclose(log.measured["speed"], np.array([0, 60, NAN, 120]) * np.pi / 30)
    np.testing.assert_allclose(log.measured["thrust"], [0, 1, 2, 3])
    assert dict(log.units) == {"command": "", "speed": "rad/s", "thrust": "N"}
    assert log.noise["speed"] == pytest.approx(3 * np.pi / 30)
    assert log.unsigned == {"speed"}
    assert dict(log.hold) == {"command": "zero"}
    assert len(log) == 4
    assert log.duration == pytest.approx(0.2)
    assert log.step == pytest.approx(0.04)
    assert log.notes == ("measured 'speed': 1 of 4 samples are missing and carry no weight.",)


def test_values_in_another_unit():
    log = make()
    np.testing.assert_allclose(log.values("speed", "rev/s"), [0, 1, NAN, 2])
    np.testing.assert_allclose(log.values("thrust", "kN"), [0, 0.001, 0.002, 0.003])
    assert log.noise_in("speed", "rpm") == pytest.approx(3.0)
    assert log.noise_in("thrust", "N") is None
    # Without a unit the numbers are the model's own, whatever that unit is.
    np.testing.assert_array_equal(log.values("command", "us"), [0, 1, 2, 2])


def test_values_in_a_wrong_unit_name_log_channel_and_units():
    with pytest.raises(InputError) as caught:
        make().values("speed", "N")
    for word in ("run1", "'speed'", "'rad/s'", "'N'"):
        assert word in str(caught.value)
    with pytest.raises(InputError):
        make().noise_in("speed", "N")


def test_absent_channel_names_the_nearest():
    for ask in (make().values, make().noise_in):
        with pytest.raises(InputError) as caught:
            ask("thrst", "N")
        assert "the nearest is 'thrust'" in str(caught.value)
        assert "'command', 'speed', 'thrust'" in str(caught.value)


def test_arrays_are_copies_and_read_only():
    time, command = np.arange(3.0), np.zeros(3)
    log = Log(time=time, inputs={"command": command})
    time[0], command[0] = -9.0, 9.0
    assert log.time[0] == 0
    assert log.inputs["command"][0] == 0
    for array in (log.time, log.inputs["command"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(TypeError):
        log.inputs["more"] = command  # type: ignore[index]
    with pytest.raises(dataclasses.FrozenInstanceError):
        log.name = "other"  # type: ignore[misc]


def test_slice_keeps_time_stamps_and_all_else():
    log = Log(
        time=np.arange(1000.0, 1010.0, 0.1),
        inputs={"command": np.arange(100.0)},
        measured={"speed": np.arange(100.0)},
        units={"speed": "rpm"},
        noise={"speed": 1.0},
    )
    part = log.slice(2.0, 5.0)
    assert len(part) == 31
    assert part.time[0] == pytest.approx(1002.0)
    assert part.time[-1] == pytest.approx(1005.0)
    np.testing.assert_array_equal(part.inputs["command"], np.arange(20.0, 51.0))
    np.testing.assert_allclose(part.values("speed", "rpm"), np.arange(20.0, 51.0))
    assert part.noise == log.noise
    assert not part.time.flags.writeable
    assert len(log.slice(stop=1.0)) == 11
    assert len(log.slice(9.0)) == 10
    with pytest.raises(InputError, match="lasts"):
        log.slice(20.0)


def test_pickle_copy_and_replace():
    log = make()
    for other in (pickle.loads(pickle.dumps(log)), copy.deepcopy(log), dataclasses.replace(log)):
        np.testing.assert_array_equal(other.time, log.time)
        np.testing.assert_array_equal(other.measured["speed"], log.measured["speed"])
        assert dict(other.units) == dict(log.units)
        assert dict(other.noise) == dict(log.noise)
        assert other.notes == log.notes
        assert not other.time.flags.writeable


def test_units_of_some_channels_leave_the_others_theirs():
    log = Log([0.0, 0.1], {"command": [0.0, 1.0]}, {"speed": [0.0, 9.0]})
    other = log.replaced(units={"command": "effort"})
    assert (other.units["command"], other.units["speed"]) == ("effort", log.units["speed"])


def test_a_channel_under_a_new_name_is_refused_with_the_mend():
    log = dft.Log([0.0, 1.0], {"force": [1.0, 2.0]}, {"velocity": [0.0, 1.0]}, {"force": "N"})
    with pytest.raises(
        dft.InputError, match=r"log: expected the channels 'force'.* found 'thrust'"
    ):
        log.replaced(inputs={"thrust": log.inputs["force"]})


def test_interpolation_on_request():
    given = dict(time=[0, 1, 3, 4, 5], inputs={"command": [NAN, 1.0, NAN, 4.0, NAN]})
    with pytest.raises(InputError, match="sample 0") as caught:
        Log(**given)
    assert "interpolate_inputs" in caught.value.mend
    log = Log(**given, interpolate_inputs=True)
    np.testing.assert_allclose(log.inputs["command"], [1, 1, 3, 4, 4])
    assert log.notes == ("input 'command': 3 of 5 samples were missing and were interpolated.",)


def test_hold_by_word_and_by_input():
    assert make(hold="linear").hold["command"] == "linear"
    assert make(hold={"command": "linear"}).hold["command"] == "linear"


def test_negative_samples_of_an_unsigned_sensor_are_told():
    log = Log(time=[0, 1], measured={"speed": [-1.0, 1.0]}, unsigned=["speed"])
    assert "1 samples are negative" in log.notes[0]


def test_one_sample_is_a_log():
    log = Log(time=[3.0], inputs={"command": [1.0]})
    assert log.duration == 0
    assert np.isnan(log.step)


def test_none_and_columns_of_other_types_are_read():
    log = Log(time=range(3), inputs={"command": [True, False, True]}, measured={"q": [1, None, 3]})
    np.testing.assert_array_equal(log.inputs["command"], [1, 0, 1])
    np.testing.assert_array_equal(log.measured["q"], [1, NAN, 3])


def test_repr_says_what_is_inside():
    text = repr(make())
    for word in ("'run1'", "4 samples", "0.2 s", "command", "speed [rpm] (1 missing, unsigned)"):
        assert word in text


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (dict(time=[0, 1, 1, 2]), ["run1", "time, sample 2", "the same again"]),
        (dict(time=[0, 2, 1, 3]), ["time, sample 2", "backward"]),
        (dict(time=[0, 1, NAN, 3]), ["time, sample 2", "none"]),
        (dict(time=[0, 1, np.inf, 3]), ["time, sample 2", "inf"]),
        (dict(time=[]), ["time", "none"]),
        (dict(time=[0, 1, 2]), ["'command'", "expected 3 samples", "found 4"]),
        (dict(time=[[0, 1, 2, 3]]), ["time", "one dimension", "(1, 4)"]),
        (dict(time=["a", "b", "c", "d"]), ["time", "expected numbers"]),
        (dict(inputs={"command": [0, 1, 2, np.inf]}), ["'command', sample 3", "finite"]),
        (dict(inputs={"command": [0, 1, 2j, 3]}), ["'command'", "complex"]),
        (dict(inputs={"command": [[0], [1, 2]]}), ["'command'", "expected numbers"]),
        (dict(inputs={"command": [NAN] * 4}), ["'command'", "no number in 4"]),
        (dict(measured={"speed": [NAN] * 4, "thrust": [1.0] * 4}), ["'speed'", "no number in 4"]),
        (dict(measured={"speed": [1, 2, -np.inf, 4], "thrust": [1.0] * 4}), ["sample 2", "-inf"]),
        (dict(inputs={"speed": [1.0] * 4}), ["'speed'", "found both"]),
        (dict(inputs={"time": [1.0] * 4}), ["'time'"]),
        (dict(units={"sped": "rpm"}), ["units", "'sped'", "the nearest is 'speed'"]),
        (dict(units={"time": "m"}), ["time", "'m'", "'s'"]),
        (dict(units={"speed": "Hz"}), ["'speed'", "ambiguous"]),
        (dict(units={"thrust": "kNN"}), ["'thrust'", "'kNN'", "not a known unit"]),
        (dict(unsigned=("command",)), ["unsigned", "'command'"]),
        (dict(noise={"speeed": 1.0}), ["noise", "'speeed'", "'speed'"]),
        (dict(noise={"speed": 0.0}), ["'speed'", "above zero", "0.0"]),
        (dict(noise={"speed": "much"}), ["'speed'", "above zero", "'much'"]),
        (dict(hold={"command": "cubic"}), ["'command'", "'cubic'"]),
        (dict(hold="cubic"), ["'command'", "'cubic'"]),
        (dict(hold={"speed": "zero"}), ["hold", "'speed'"]),
        (dict(measured={"speed": [1e308] * 4, "thrust": [1e308] * 4}), ["'thrust'", "inf"]),
    ],
)
def test_what_cannot_be_used_is_named(changes, words):
    with pytest.raises(InputError) as caught:
        make(**changes)
    for word in words:
        assert word in str(caught.value)
    assert caught.value.mend


def test_averages_stand_at_the_middle_of_their_samples():
    time = np.arange(10) * 0.1
    heading = np.array([170.0, 174, 178, -178, -174, -170, -166, -162, -158, -154])
    seen = np.array([1.0, 3, np.nan, 5, np.nan, np.nan, np.nan, np.nan, 9, 9])
    log = dft.Log(
        time,
        {"command": time},
        {"speed": seen, "heading": heading},
        units={"heading": "deg"},
        noise={"speed": 0.2},
    )
    coarse = log.averaged(4)
    np.testing.assert_allclose(coarse.time, [0.15, 0.55])
    np.testing.assert_allclose(coarse.inputs["command"], coarse.time)  # a ramp stays a ramp
    np.testing.assert_allclose(coarse.measured["speed"], [3.0, np.nan])
    heading = np.rad2deg(coarse.values("heading", "rad"))
    np.testing.assert_allclose(heading, [176.0, 192.0])  # across the jump
    assert coarse.noise["speed"] == pytest.approx(0.1)
    assert coarse.hold["command"] == "linear"
    assert "4 samples each were averaged into one" in coarse.notes[-1]
    assert len(log.averaged(1)) == 10
    with pytest.raises(InputError, match=r"from 1 to 10, found 11"):
        log.averaged(11)
    with pytest.raises(InputError, match=r"whole number"):
        log.averaged(2.5)


def test_a_fit_to_averages_finds_the_same_parameters():
    rng = np.random.default_rng(1)
    time = np.arange(4000) * 0.01
    command = 2.0 * np.sin(0.8 * time) * np.sin(0.13 * time)
    run = dft.simulate(dft.Thruster(), dft.Log(time, {"command": command}))
    measured = {n: run[n] + 0.3 * rng.standard_normal(time.size) for n in ("speed", "thrust")}
    log = dft.Log(time, {"command": command}, measured)
    fine, coarse = (dft.fit(dft.Thruster(), one, starts=1) for one in (log, log.averaged(5)))
    for name, estimate in fine.parameters.items():
        # to what the averages blur of a motion that takes a few of them
        assert coarse.parameters[name].value == pytest.approx(estimate.value, rel=0.02)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"inputs": np.zeros(3)}, "inputs: expected a dictionary .* found ndarray"),
        ({"measured": [1.0, 2.0, 3.0]}, "measured: expected a dictionary .* found list"),
        ({"units": "rpm"}, "units: expected a dictionary .* found str"),
        ({"measured": {"speed": ["1", "2", "3"]}}, "'speed': .* of text.\nMend: convert it"),
        (
            {"time": np.array(["2020-01-01", "2020-01-02", "2020-01-03"], "datetime64[s]")},
            "time: .* of dates.\nMend: give seconds",
        ),
    ],
)
def test_a_field_of_another_kind_is_named(given, words):
    fields = {"time": [0.0, 1.0, 2.0], "inputs": {"command": [0.0, 1.0, 1.0]}, **given}
    with pytest.raises(InputError, match=words):
        Log(**fields)
