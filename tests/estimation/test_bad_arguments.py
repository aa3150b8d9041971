"""Arguments as new users write them wrong: each is refused by name, with a mend."""

import re

import numpy as np
import pandas as pd
import pytest

import diffthrust as dft

TIME = np.arange(0.0, 5.0, 0.05)
COMMAND = np.repeat([0.5, -1.0, 2.0, -1.5, 1.0], 20)


def log(name="monday", shift=0.0):
    speed = 30.0 * np.sign(COMMAND) * np.sqrt(np.abs(COMMAND)) + shift
    return dft.Log(TIME, {"command": COMMAND}, {"speed": speed}, name=name)


LOG = log()
CORRECTED = {"likelihood": "innovations"}


def refusal(work):
    with pytest.raises(dft.InputError) as caught:
        work()
    message, _, mend = str(caught.value).partition("\nMend: ")
    assert mend not in ("", "Correct it.")
    return message, mend


@pytest.mark.parametrize("verb", [dft.fit, dft.diagnose])
@pytest.mark.parametrize(
    ("model", "logs", "options", "said", "mended"),
    [
        (dft.Thruster, LOG, {}, "a model, found the class Thruster", r"Thruster\(\)"),
        ("thruster", LOG, {}, "a model, found 'thruster'", "instance"),
        (LOG, dft.Thruster(), {}, "logs: expected a Log .* found Thruster", "read_log"),
        (dft.Thruster(), "a.csv", {}, "logs: .* found 'a.csv' .str.", "read_log"),
        (dft.Thruster(), [LOG, "b.csv"], {}, "logs: .* 'b.csv' .str. in a list", "read_log"),
        (dft.Thruster(), {"time": [0, 1]}, {}, "logs: expected a Log .* found dict", "read_log"),
        (dft.Thruster(), pd.DataFrame({"t": TIME}), {}, "found DataFrame", "from_dataframe"),
        (dft.Thruster(), [], {}, "logs: expected at least one log", "Give"),
        (dft.Thruster(), LOG, {"holdout": False}, "holdout: .* found False", "read_log"),
        (dft.Thruster(), LOG, {"holdout": log("b")}, "holdout: 'b' is also a training log", "out"),
        (dft.Thruster(), LOG, {"seed": 1.5}, "seed: expected a whole number .* 1.5", "seed=0"),
        (dft.Thruster(), LOG, {"progress": "yes"}, "progress: .* found 'yes'", "progress=True"),
        (dft.Thruster(), LOG, {"progress": []}, r"progress: .* found \[\]", "progress=True"),
        (dft.Thruster(), LOG, {"progress": lambda text: None}, "not take two", "message, share"),
    ],
)
def test_a_wrong_argument_is_named_with_its_mend(verb, model, logs, options, said, mended):
    message, mend = refusal(lambda: verb(model, logs, **options))
    assert re.search(said, message)
    assert re.search(mended, mend)


@pytest.mark.parametrize(
    ("options", "said", "mended"),
    [
        ({"loss": ["gaussian"]}, r"loss: .* found \['gaussian'\]", "loss='gaussian'"),
        ({"loss": None}, "loss: .* found None", "loss='gaussian'"),
        ({"loss": "huber"}, "loss: expected one of gaussian, student_t", "loss='gaussian'"),
        ({"initial": "zero"}, "initial: expected one of", "initial='auto'"),
        ({"noise_model": "ar2"}, "one of white, ar1, .* nearest is 'ar1'", "noise_model='white'"),
        ({"starts": "3"}, "starts: expected a whole number of at least 1, found '3'", "starts=8"),
        ({"starts": 0}, "starts: expected a whole number of at least 1", "starts=8"),
        ({"starts": 2.5}, "starts: expected a whole number of at least 1", "starts=8"),
        ({"seed": -1}, "seed: expected a whole number of at least 0", "seed=0"),
        ({"substeps": 0}, "substeps: .* at least 1, found 0", "Leave it out"),
        ({"substeps": -1}, "substeps: expected a whole number of at least 1", "Leave it out"),
        ({"substeps": 1.5}, "substeps: expected a whole number of at least 1", "Leave it out"),
        ({"doubts": "no"}, "doubts: expected True or False, found 'no'", "doubts=False"),
        ({"horizon": "long"}, "horizon: expected seconds or 'auto', found 'long'", "seconds"),
        ({"horizon": []}, r"horizon: expected .* found \(\)", "whole runs"),
        ({"horizon": -1.0}, "horizon: expected a positive", "seconds"),
        ({"horizon": 1e-10}, "horizon: .* above the step", "seconds"),
        ({"horizon": 5.0, **CORRECTED}, "whole runs, found 5.0", "Leave the horizon out"),
        ({"horizon": [5.0, None], **CORRECTED}, "horizon: .* whole runs", "Leave the horizon out"),
        ({"noise_model": "ar1", **CORRECTED}, "lasting sensor errors of its own", "simulation"),
        ({"likelihood": "filter"}, "one of simulation, innovations, found 'filter'", "others"),
        ({"guesses": {"alpha": 1.0}}, "guesses: expected a list", "guesses="),
        ({"guesses": [{"alfa": 1.0}]}, "guesses: .* 'alfa' .the nearest is 'alpha'.", "name"),
        ({"guesses": [{"alpha": "x"}]}, "'alpha': expected a number in 1/rad, found 'x'", "number"),
    ],
)
def test_a_wrong_option_of_a_fit_is_named_with_its_mend(options, said, mended):
    message, mend = refusal(lambda: dft.fit(dft.Thruster(), LOG, **options))
    assert re.search(said, message)
    assert re.search(mended, mend)


@pytest.mark.parametrize(
    ("options", "said", "mended"),
    [
        ({"candidates": 3}, "candidates: expected names, .* found 3", "command_deadband"),
        ({"candidates": ["coulomb_frction"]}, "nearest are 'coulomb_friction'", "name"),
        ({"experiment": "yes"}, "experiment: expected True or False, found 'yes'", "=False"),
        ({"limits": [1, 2]}, r"limits: expected a dictionary .* found \[1, 2\]", "low, high"),
        ({"limits": {"command": 3}}, "limits: expected a lower .* 'command', found 3", "low, high"),
        ({"limits": {"command": (1, -1)}}, r"limits: .* found \(1, -1\)", "low, high"),
        ({"limits": {"command": (np.nan, 1)}}, r"limits: .* found \(nan, 1\)", "low, high"),
    ],
)
def test_a_wrong_option_of_a_diagnosis_is_named_with_its_mend(options, said, mended):
    message, mend = refusal(lambda: dft.diagnose(dft.Thruster(), LOG, **options))
    assert re.search(said, message)
    assert re.search(mended, mend)


def test_any_callable_of_two_arguments_receives_progress():
    shares = []
    dft.fit(dft.Thruster(), LOG, starts=1, progress=lambda message, share: shares.append(share))
    assert shares[-1] == 1.0
    dft.fit(dft.Thruster(), LOG, starts=1, progress=print)
