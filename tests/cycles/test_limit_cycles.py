"""Limit cycles against loops with known answers, python-control, SciPy and the paper."""

import math
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import control
import numpy as np
import pytest
from limit_cycle_bank import BANK, third_order
from scipy.integrate import solve_ivp
from test_examples import figure, run

import diffthrust as dft
from diffthrust import InputError
from diffthrust._support.transfer import transfer_of  # private: the linear part alone
from diffthrust.cycles import (
    Backlash,
    DeadZone,
    ModelElement,
    Nonlinearity,
    Relay,
    Saturation,
    StaticNonlinearity,
    limit_cycles,
    plot_pole_motion,
    thruster_loop_cycle,
)
from diffthrust.cycles._static_element import output_of  # private: the harmonics of one passage
from diffthrust.effects import (
    ActuatorLag,
    CommandDeadband,
    CommandDelay,
    CommandRateLimit,
    ReverseThrustAsymmetry,
)

JASON = {"alpha": 0.037, "beta": 42.0, "ct": 0.022}


@lru_cache
def found_in(index: int):
    case = BANK[index]
    return limit_cycles(case.linear, case.element, **case.ranges)


@lru_cache
def jason(**options):
    return thruster_loop_cycle(dft.Thruster(**JASON), **options)


# The bank: closed forms and one equation solved apart.

INDICES = range(len(BANK))
NAMES = [case.name for case in BANK]


def test_the_bank_holds_at_least_twenty_loops_with_none_one_and_two_cycles():
    assert len(BANK) >= 20
    assert {len(case.expected) for case in BANK} == {0, 1, 2}


@pytest.mark.parametrize("index", INDICES, ids=NAMES)
def test_solutions_of_the_balance_are_the_known_ones(index):
    case, found = BANK[index], found_in(index)
    seen = [(c.amplitude, c.frequency) for c in found]
    np.testing.assert_allclose(seen, [known[:2] for known in case.expected] or seen, rtol=1e-6)
    assert len(found) == len(case.expected)
    assert [c.stable for c in found] == [known[2] for known in case.expected]


@pytest.mark.parametrize(
    "index", [pytest.param(i, marks=pytest.mark.slow) if i % 3 else i for i in INDICES], ids=NAMES
)
def test_simulation_agrees_on_stability_and_with_the_refined_cycle(index):
    for c in found_in(index):
        assert c.lasts == c.stable
        assert (c.refined is None) == (c.simulated is None)
        if c.refined is not None:
            a, b = c.refined, c.simulated
            np.testing.assert_allclose(a.amplitude, b.amplitude, rtol=0.005)
            np.testing.assert_allclose(a.peak, b.peak, rtol=0.005)
            np.testing.assert_allclose(a.frequency, b.frequency, rtol=0.005)
        if c.stable:
            assert c.refined is not None


@pytest.mark.parametrize(
    "index", [i for i in INDICES if BANK[i].exact], ids=[c.name for c in BANK if c.exact]
)
def test_cycles_with_a_closed_form_come_out_beyond_the_describing_function(index):
    peak, frequency = BANK[index].exact
    (c,) = found_in(index)
    np.testing.assert_allclose(c.refined.frequency, frequency, rtol=1e-4)
    np.testing.assert_allclose(c.simulated.frequency, frequency, rtol=1e-4)
    np.testing.assert_allclose([c.refined.peak, c.simulated.peak], peak, rtol=0.005)


def test_van_der_pol_has_the_period_of_its_series():
    (c,) = found_in(NAMES.index("Van der Pol"))
    mu = 0.3
    series = 1 - mu**2 / 16 + 17 * mu**4 / 3072
    np.testing.assert_allclose(c.refined.frequency, series, rtol=2e-5)


def test_relay_cycle_is_that_of_a_scipy_simulation():
    gain, a, b = 6.0, 1.0, 2.0
    (c,) = found_in(0)

    def rates(_t, x):
        return [x[1], x[2], -gain * math.copysign(1.0, x[0]) - a * b * x[1] - (a + b) * x[2]]

    def switch(_t, x):
        return x[0]

    x, when = np.array([c.refined.peak, 0.0, 0.0]), []
    switch.terminal, time = True, 0.0
    for _ in range(40):
        run = solve_ivp(rates, (time, time + 30), x, events=switch, rtol=1e-10, atol=1e-12)
        time, x = run.t[-1], run.y[:, -1]
        x[0] = 1e-13 * math.copysign(1.0, x[1])
        when.append(time)
    frequency = math.pi / (when[-1] - when[-2])
    np.testing.assert_allclose(c.refined.frequency, frequency, rtol=5e-5)
    np.testing.assert_allclose(c.simulated.frequency, frequency, rtol=1e-5)


# Describing functions and balances of the elements.

CLASSICAL = {
    "saturation": (Saturation(1.0), control.saturation_nonlinearity(1.0)),
    "relay": (Relay(1.5), control.relay_hysteresis_nonlinearity(1.5, 0.0)),
    "hysteresis": (Relay(1.5, hysteresis=0.4), control.relay_hysteresis_nonlinearity(1.5, 0.4)),
    "backlash": (Backlash(0.3), control.friction_backlash_nonlinearity(0.6)),
}


@pytest.mark.parametrize("name", CLASSICAL)
def test_describing_functions_are_those_of_python_control(name):
    ours, theirs = CLASSICAL[name]
    a = np.array([0.5, 0.9, 1.1, 2.0, 7.0])
    expected = [theirs.describing_function(x) for x in a]
    np.testing.assert_allclose(ours.describing(a, 1.0), expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("element", "curve", "bends"),
    [
        (Saturation(1.0, slope=2.0), lambda e: np.clip(2 * e, -1, 1), (-0.5, 0.5)),
        (DeadZone(0.4), lambda e: e - np.clip(e, -0.4, 0.4), (-0.4, 0.4)),
        (Relay(2.0, dead_zone=0.3), lambda e: 2 * np.sign(e) * (np.abs(e) > 0.3), (-0.3, 0.3)),
    ],
)
def test_quadrature_of_a_curve_gives_the_closed_form(element, curve, bends):
    a = np.array([0.6, 1.0, 5.0])
    own = StaticNonlinearity(curve, bends=bends)
    np.testing.assert_allclose(own.describing(a, 1.0), element.describing(a, 1.0), rtol=1e-10)


@pytest.mark.parametrize(
    "element",
    [
        Relay(2.0),
        Relay(2.0, hysteresis=0.3),
        Relay(2.0, dead_zone=0.3),
        Saturation(1.0, slope=3.0),
        DeadZone(0.4),
        Backlash(0.2, slope=1.5),
    ],
    ids=str,
)
def test_first_harmonic_over_a_period_is_the_describing_function(element):
    order = np.arange(1, 8, 2)
    for a in (0.7, 3.0):
        e = np.array([a, 0, 0, 0], complex)
        first = output_of(element, order, e)[0] / a
        np.testing.assert_allclose(first, element.describing(a, 1.0), rtol=2e-5, atol=1e-6)


def test_passing_step_by_step_and_over_a_period_are_the_same():
    e = 1.3 * np.sin(np.linspace(0, 4 * np.pi, 4001))
    for element in (Relay(1.0, hysteresis=0.4), Backlash(0.3), Saturation(0.5), DeadZone(0.2)):
        memory, steps = element.rest(0.0), []
        for one, two in pairwise(e):
            _, last, memory = element.passage(one, two, memory)
            steps.append(last)
        whole = element.over(e[2001:])
        differs = np.abs(np.array(steps[2000:]) - whole) > 2e-3
        assert differs.sum() <= 2  # where a relay switches, the line has another end


def test_intersections_are_those_of_python_control():
    plant = control.tf([15.0], [1.0, 3.0, 2.0, 0.0])
    theirs = control.describing_function_response(
        plant, control.saturation_nonlinearity(1.0), np.linspace(1.0, 5.0, 60)
    )
    ((a, w),) = theirs.intersections
    (c,) = limit_cycles(plant, Saturation(1.0), verify=False)
    np.testing.assert_allclose((c.amplitude, c.frequency), (a, w), rtol=1e-3)


class Cube(Nonlinearity):
    def describing(self, amplitude, frequency):
        a, _ = np.broadcast_arrays(np.asarray(amplitude, float), np.asarray(frequency, float))
        return (0.75 * a**2).astype(complex)


class SimulatedCube(Cube):
    def courses(self, transfer, cycle, factors, periods):
        curve = StaticNonlinearity(lambda e: e**3)
        return curve.courses(transfer, cycle, factors, periods)


def test_a_new_element_is_one_class():
    linear = third_order(6.0, 1.0, 2.0)
    (known,) = limit_cycles(linear, StaticNonlinearity(lambda e: e**3), verify=False)
    (found,), (simulated,) = limit_cycles(linear, Cube()), limit_cycles(linear, SimulatedCube())
    for c in (found, simulated):
        np.testing.assert_allclose((c.amplitude, c.frequency), (known.amplitude, 2**0.5), rtol=1e-6)
        assert c.refined is None
    assert found.lasts is None
    assert found.simulation.startswith("not simulated: ")
    assert simulated.lasts is False


class ManyHarmonics(Cube):
    harmonics = 201


def test_the_harmonics_of_a_new_element_are_limited_as_those_that_are_asked_for():
    linear = third_order(6.0, 1.0, 2.0)
    for element, harmonics in ((ManyHarmonics(), None), (Cube(), 201)):
        with pytest.raises(InputError, match="harmonics: expected at most 200, found 201"):
            limit_cycles(linear, element, harmonics=harmonics)


class Wide(Saturation):
    @property
    def scale(self):
        return 7.0


def test_the_scale_follows_the_element_and_a_subclass_may_have_its_own():
    element = Saturation(1.0)
    element.slope = 4.0
    assert element.scale == 0.25
    assert Wide(1.0).scale == 7.0


# The linear part.


def test_linear_part_is_the_same_by_numbers_and_by_objects():
    num, den = [2.0, 1.0], [1.0, 3.0, 2.0, 0.5]
    s = 1j * np.array([0.1, 1.0, 10.0])
    expected = np.polyval(num, s) / np.polyval(den, s)
    plant = control.tf(num, den)
    for given in ((num, den), plant, control.ss(plant), (num, den, 0.0)):
        np.testing.assert_allclose(transfer_of(given)(s), expected, rtol=1e-9)
    a, b, c, d = transfer_of((num, den)).state_space()
    by_states = [c @ np.linalg.solve(x * np.eye(3) - a, b) + d for x in s]
    np.testing.assert_allclose(by_states, expected, rtol=1e-9)
    late = transfer_of((num, den, 0.3))
    np.testing.assert_allclose(late(s), expected * np.exp(-0.3 * s))
    np.testing.assert_allclose(late.rational()(s[:2]), late(s[:2]), rtol=1e-8)


@pytest.mark.parametrize(
    ("linear", "words"),
    [
        (([1.0, 0.0, 0.0], [1.0, 1.0]), "improper"),
        (([1.0], [0.0]), "denominator of the linear part is zero"),
        (([np.nan], [1.0, 1.0]), "finite real coefficients"),
        (([1.0], ["a"]), "finite real coefficients"),
        (([1.0], [1.0, 1.0], -0.1), "dead time"),
        (([1.0], [1.0, 1.0], "soon"), "dead time"),
        ("1/s", "expected \\(num, den\\)"),
        (control.tf([1.0], [1.0, -0.5], 0.1), "sample time 0.1"),
        (control.ss(np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2))) * -1.0, "2 inputs"),
    ],
)
def test_linear_parts_that_cannot_be_used_are_refused(linear, words):
    with pytest.raises(InputError, match=words):
        limit_cycles(linear, Relay(1.0))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"amplitudes": (0.0, 1.0)}, "amplitudes"),
        ({"amplitudes": (-1.0, 1.0)}, "amplitudes"),
        ({"amplitudes": 1.0}, "amplitudes"),
        ({"amplitudes": (2.0, 1.0)}, "amplitudes"),
        ({"frequencies": (0.0, 1.0)}, "frequencies"),
        ({"frequencies": (1.0, math.inf)}, "frequencies"),
        ({"frequencies": "all"}, "frequencies"),
        ({"amplitudes": (0.01, 0.02)}, "no output up to an input of 0.1"),
        ({"harmonics": 0}, "harmonics"),
        ({"harmonics": 2.5}, "harmonics"),
    ],
)
def test_ranges_that_cannot_be_meant_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        limit_cycles(third_order(6.0, 1.0, 2.0), DeadZone(0.1), **options)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Relay(0.0), "level: expected a number above zero"),
        (lambda: Relay(1.0, hysteresis=-1.0), "hysteresis"),
        (lambda: Relay(1.0, hysteresis=0.1, dead_zone=0.1), "both hysteresis and a dead zone"),
        (lambda: Saturation(math.nan), "limit"),
        (lambda: Backlash(True), "gap"),
        (lambda: StaticNonlinearity(3.0), "function"),
        (lambda: StaticNonlinearity(lambda e: e / 0.0 if False else np.inf * e), "finite"),
        (lambda: StaticNonlinearity(lambda e: 1.0), "shape"),
        (lambda: limit_cycles(([1.0], [1.0, 1.0]), 3.0), "nonlinear element"),
        (lambda: ModelElement(dft.Thruster(), input="inflow"), "no input 'inflow'"),
        (lambda: ModelElement(dft.Thruster(), output="torque"), "no output 'torque'"),
        (lambda: ModelElement(dft.Vessel()), "no input 'command'"),
        (
            lambda: ModelElement(dft.Thruster() + CommandRateLimit()),
            "(?s)earlier samples.*dft.control",
        ),
        (lambda: thruster_loop_cycle(dft.Thruster(), mass=0.0), "mass"),
        (lambda: thruster_loop_cycle(dft.Thruster(), drag=-1.0), "drag"),
        (lambda: thruster_loop_cycle(dft.AxisVehicle()), "alpha, beta and ct"),
        (lambda: thruster_loop_cycle("thruster"), "Expected a model"),
    ],
)
def test_elements_that_cannot_be_used_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


# Words.


def words(result):
    """A report without the ends of its lines."""
    return " ".join(result.report().split())


def test_no_cycle_one_and_several_are_answered_in_words():
    none = found_in(NAMES.index("saturation, low gain: none"))
    assert none.sentence.startswith("No limit cycle for amplitudes of")
    assert "oscillations die out" in none.sentence
    grows = found_in(NAMES.index("straight line, unstable: none"))
    assert "oscillations grow" in grows.sentence
    two = found_in(NAMES.index("relay with dead zone: two cycles"))
    assert two.sentence.startswith("2 limit cycles")
    assert repr(two) == f"LimitCycles({two.sentence})"
    assert "unstable" in two.sentence
    assert "dies out" in words(two)
    assert "come back to it" in words(two)
    one = found_in(NAMES.index("dead zone: one unstable cycle"))
    assert "from 10 % above it grows a thousandfold" in words(one)
    lossless = found_in(NAMES.index("saturation and double integrator: none"))
    assert "real at all frequencies" in words(lossless)
    assert "by itself is unstable" in words(found_in(NAMES.index("Van der Pol")))


def test_the_edge_of_the_range_is_named():
    linear = third_order(6.0, 1.0, 2.0)
    beyond = limit_cycles(linear, Relay(1.0), amplitudes=(2.0, 9.0), verify=False)
    assert not len(beyond)
    assert "widen the range" in words(beyond)
    at = limit_cycles(linear, Relay(1.0), amplitudes=(1.27, 9.0), verify=False)
    assert at[0].at_edge
    assert "at the edge of the range" in words(at)
    late = limit_cycles(([2.0], [3.0, 1.0], 0.8), Relay(1.0), frequencies=(0.1, 30.0), verify=False)
    assert len(late) == 4  # the dead time's further turns
    assert [c.stable for c in late] == [False, False, False, True]


def test_an_offset_is_found_with_an_element_that_is_not_odd():
    def uneven(e):
        return np.where(e > 0, 1.0, -0.6)

    element = StaticNonlinearity(uneven, jumps=(0.0,), name="uneven relay")
    (c,) = limit_cycles(([3.0], np.poly([-1.0, -1.0, -1.0])), element)
    assert c.lasts
    assert abs(c.refined.offset) > 0.1
    for name in ("amplitude", "peak", "frequency", "offset"):
        np.testing.assert_allclose(getattr(c.refined, name), getattr(c.simulated, name), rtol=0.005)


def test_a_linear_part_that_passes_steps_at_once_is_not_simulated_and_says_so():
    (c,) = limit_cycles(([0.2, 0.0, 0.0, 6.0], [1.0, 3.0, 2.0, 0.0]), Saturation(0.5, slope=2.0))
    assert c.refined is not None
    assert c.simulated is None
    assert "passes a step at once" in c.simulation


# The thruster loop of Yoerger et al. 1990, section IV.


@pytest.mark.thorough
def test_jason_loop_has_the_amplitude_and_frequency_of_an_independent_integrator():
    loop = jason()
    c, k = loop.cycle, loop.newton
    assert len(loop.found) == 1
    assert c.verdict == "stable"
    for o in (c.simulated, c.refined):
        np.testing.assert_allclose(k * o.peak, 15.70, rtol=0.005)
        np.testing.assert_allclose(k * o.amplitude, 15.15, rtol=0.005)
        np.testing.assert_allclose(o.frequency, 0.9755, rtol=0.005)
    np.testing.assert_allclose(c.refined.peak, c.simulated.peak, rtol=0.005)
    np.testing.assert_allclose(c.refined.frequency, c.simulated.frequency, rtol=0.005)


def test_jason_loop_without_drag():
    loop = jason(drag=0.0)
    c, k = loop.cycle, loop.newton
    for o in (c.simulated, c.refined):
        np.testing.assert_allclose((k * o.peak, k * o.amplitude), (15.94, 15.36), rtol=0.005)
        np.testing.assert_allclose(o.frequency, 0.978, rtol=0.005)


def test_both_formulas_stand_beside_the_papers_figures():
    loop = jason()
    np.testing.assert_allclose((loop.printed, loop.consistent), (19.3, 16.4), atol=0.05)
    np.testing.assert_allclose(loop.break_frequency, 1 / (2 * 0.707))
    report = loop.report()
    for words in ("19.3", "16.4", "15.6", "15.7", "simulation is reproduced within 1 %"):
        assert words in report
    assert "printed prediction is not reproduced" in report


@pytest.mark.parametrize(
    ("model", "theirs"),
    [
        (dft.Thruster(**JASON), True),
        (dft.Thruster(**{**JASON, "ct": 0.019}), True),  # their dynamic test
        (dft.Thruster(**{**JASON, "alpha": 0.08}), False),
        (dft.Thruster(**{**JASON, "beta": 50.0}), False),
        (dft.Thruster(**{**JASON, "ct": 0.005}), False),
        pytest.param(
            dft.Thruster(**JASON) + ActuatorLag(time_constant=0.2),
            False,
            marks=pytest.mark.thorough,
        ),
    ],
)
def test_only_the_papers_thruster_is_held_against_the_papers_figures(model, theirs):
    loop = thruster_loop_cycle(model, verify=False)
    assert loop.as_in_paper == theirs
    assert ("paper, simulated" in loop.report()) == theirs


@pytest.mark.parametrize(
    ("design", "factor"), [({"natural_frequency": 0.5}, 0.5), ({"natural_frequency": 2.0}, 2.0)]
)
def test_amplitude_of_a_pure_inertia_grows_with_the_square_of_the_frequency(design, factor):
    slow, base = jason(drag=0.0, **design), jason(drag=0.0)
    # in a time unit of 1 / wn the loop is the same one, commands go with wn^2
    for name, power in (("peak", 2), ("frequency", 1)):
        ours, known = (getattr(x.cycle.refined, name) for x in (slow, base))
        np.testing.assert_allclose(ours, factor**power * known, rtol=1e-5)
    assert slow.cycle.lasts


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.4, 1.0])
def test_thruster_loops_of_other_damping_stay_near_the_consistent_formula(damping):
    loop = jason(drag=0.0, damping=damping)
    c = loop.cycle
    assert c.verdict == "stable"
    np.testing.assert_allclose(loop.newton * c.amplitude, loop.consistent, rtol=0.06)
    np.testing.assert_allclose(c.refined.peak, c.simulated.peak, rtol=0.005)


def test_thruster_loop_is_that_of_scipy():
    mass, drag, alpha, ct = 340.0, 67.0, 0.037, 0.022

    def rates(_t, x):
        place, v, speed = x
        force = -mass * (2 * 0.707 * v + place)
        thrust = ct * speed * abs(speed)
        return [
            v,
            (thrust - drag * v * abs(v)) / mass,
            alpha / ct * force - alpha * speed * abs(speed),
        ]

    run = solve_ivp(rates, (0, 120), [0.05, 0, 0], method="DOP853", rtol=1e-9, atol=1e-11,
                    dense_output=True)  # fmt: skip
    time = np.linspace(100, 120, 20001)
    place, v, _ = run.sol(time)
    command = mass * (2 * 0.707 * v + place)
    rises = np.flatnonzero((command[:-1] < 0) & (command[1:] >= 0))
    c, k = jason().cycle, jason().newton
    np.testing.assert_allclose(k * c.simulated.peak, np.abs(command).max(), rtol=2e-3)
    period = np.diff(time[rises]).mean()
    np.testing.assert_allclose(c.simulated.period, period, rtol=1e-3)


@pytest.mark.slow
def test_loop_of_a_model_with_effects_agrees_with_its_simulation():
    effects = [
        CommandDeadband(half_width=0.1),
        ActuatorLag(time_constant=0.1),
        ReverseThrustAsymmetry(change=-0.3),
    ]
    c = thruster_loop_cycle(dft.Thruster(**JASON) + effects).cycle
    assert c.verdict == "stable"
    assert abs(c.refined.offset) > 0.01 * c.refined.amplitude
    for name in ("peak", "amplitude", "frequency", "offset"):
        np.testing.assert_allclose(getattr(c.refined, name), getattr(c.simulated, name), rtol=0.005)


DELAY = 0.15  # [s]
LATE = dft.Thruster(**JASON) + CommandDeadband(half_width=0.1) + CommandDelay(delay=DELAY)


def test_a_delay_of_the_command_is_counted_with_the_linear_part():
    loop = thruster_loop_cycle(LATE, drag=0.0, verify=False)
    assert loop.found.transfer.delay == DELAY
    assert "delay of the command, 0.15 s, is counted with G" in words(loop)


@pytest.mark.thorough
def test_a_delay_of_the_command_is_carried_exactly():
    """Against a loop in plain numpy that keeps the commands of the last moments."""
    mass, gain, step = 340.0, 0.022 * 42.0 / 0.037, DELAY / 100
    c = thruster_loop_cycle(LATE, drag=0.0).cycle
    assert c.verdict == "stable"

    def rates(x, u):
        u = math.copysign(max(abs(u) - 0.1, 0.0), u)
        thrust = 0.022 * x[2] * abs(x[2])
        return np.array([x[1], thrust / mass, 42.0 * u - 0.037 * x[2] * abs(x[2])])

    def wanted(x):
        return -mass / gain * (2 * 0.707 * x[1] + x[0])

    x, course = np.array([0.05, 0.0, 0.0]), [0.0] * 101
    for k in range(round(150 / step)):
        course.append(wanted(x))
        now, then = course[k + 1], course[k + 2]
        one = rates(x, now)
        two = rates(x + 0.5 * step * one, 0.5 * (now + then))
        three = rates(x + 0.5 * step * two, 0.5 * (now + then))
        four = rates(x + step * three, then)
        x = x + step / 6 * (one + 2 * two + 2 * three + four)
    u = np.array(course[101:])
    late_half = u[u.size // 2 :]
    rises = np.flatnonzero((late_half[:-1] < 0) & (late_half[1:] >= 0))
    period = step * (rises[-1] - rises[0]) / (rises.size - 1)
    for o in (c.refined, c.simulated):
        np.testing.assert_allclose(o.peak, np.abs(late_half).max(), rtol=2e-3)
        np.testing.assert_allclose(o.period, period, rtol=2e-3)


def test_quick_thrusters_do_not_cycle():
    damped = dft.Thruster(**JASON) + "linear_damping"
    loop = thruster_loop_cycle(damped.replace({"linear_damping.rate": 6.0}))
    assert not len(loop.found)
    assert "No limit cycle" in words(loop)
    with pytest.raises(InputError, match="No limit cycle"):
        _ = loop.cycle


def test_a_balance_of_one_harmonic_is_the_consistent_formula():
    loop = jason(drag=0.0)
    c = loop.cycle
    first = loop.found.element.balanced(loop.found.transfer, c.amplitude, c.frequency, 1)
    o = first.oscillation
    np.testing.assert_allclose(loop.newton * o.amplitude, loop.consistent, rtol=1e-3)
    np.testing.assert_allclose(o.frequency, loop.natural_frequency, rtol=1e-3)
    relay, (c,) = BANK[0], found_in(0)
    first = relay.element.balanced(transfer_of(relay.linear), c.amplitude, c.frequency, 1)
    np.testing.assert_allclose(first.oscillation.amplitude, c.amplitude, rtol=1e-6)


def test_describing_function_of_a_model_is_that_of_the_map():
    model = dft.Thruster(**JASON)
    a, w = np.array([0.05, 0.5, 5.0]), np.array([0.3, 1.0, 4.0])
    found = dft.describing_function(model, a, w, method="harmonic_balance")
    ours = ModelElement(model).describing(a[:, None], w[None, :])
    np.testing.assert_allclose(ours, found.complex, rtol=1e-3)


@pytest.mark.slow
def test_the_course_from_rest_grows_into_the_cycle(tmp_path):
    loop = jason()
    course = loop.course(displacement=0.01, duration=80.0)
    late = np.abs(course.input[course.time > 60]).max()
    np.testing.assert_allclose(late, 15.70, rtol=0.005)
    assert np.abs(course.input[course.time < 2]).max() < 5.0
    figure = loop.plot(duration=30.0)
    figure.savefig(tmp_path / "course.png")
    assert all(np.isfinite(values).all() for values in numbers_of(figure))
    with pytest.raises(InputError, match="duration"):
        loop.course(duration=0.0)


def test_the_course_is_that_of_the_vehicle_that_the_result_has():
    loop = jason(verify=False)
    light, heavy = (replace(loop, drag=drag).course(0.01, 20.0) for drag in (0.5, 50.0))
    assert np.abs(heavy.input).max() != np.abs(light.input).max()


@pytest.mark.slow
def test_the_example_prints_both_formulas_and_draws_its_figures(tmp_path):
    printed = " ".join(run("limit_cycle", tmp_path).split())  # wrapped to a terminal's width
    for words in ("19.32", "16.40", "15.70", "15.60", "is not reproduced", "grows a thousandfold"):
        assert words in printed
    for name in ("yoerger_figure_13", "yoerger_figure_14", "saturation", "saturation_poles"):
        figure(tmp_path, f"{name}.png")


# Figures.


def numbers_of(figure):
    for axes in figure.axes:
        for line in axes.get_lines():
            yield np.asarray(line.get_xdata(), float)
            yield np.asarray(line.get_ydata(), float)
        for points in axes.collections:
            yield np.asarray(points.get_offsets(), float)


@pytest.mark.parametrize("index", [0, 6, 8, 9, 12, 13, 18])
def test_polar_plots_have_a_point_for_each_cycle_and_no_gaps_that_are_not_numbers(index, tmp_path):
    found = found_in(index)
    figure = found.plot()
    figure.savefig(tmp_path / "nyquist.png")
    assert all(np.isfinite(values).all() for values in numbers_of(figure))
    texts = " ".join(text.get_text() for text in figure.axes[0].texts)
    assert ("no limit cycle" in texts) == (not len(found))
    named = " ".join(text.get_text() for text in figure.legends[0].get_texts())
    for number, c in enumerate(found, 1):
        assert f"{number}. {c.verdict}" in named


def test_poles_of_the_thruster_loop_move_from_right_to_left(tmp_path):
    figure = jason(drag=0.0).plot_poles()
    figure.savefig(tmp_path / "poles.png")
    assert all(np.isfinite(values).all() for values in numbers_of(figure))
    text = figure.axes[0].texts[0].get_text()
    assert text.startswith("stable cycle: 15.7")


def test_poles_of_a_conditionally_stable_loop_move_from_left_to_right():
    figure = plot_pole_motion(([3.0, 12.0, 12.0], [1.0, 0.0, 0.0, 0.0]), Saturation(1.0))
    assert figure.axes[0].texts[0].get_text().startswith("unstable cycle: 3.7")
    with pytest.raises(InputError, match="no output up to"):
        plot_pole_motion(third_order(6.0, 1.0, 2.0), DeadZone(1.0), amplitudes=(0.1, 0.2))


# Long studies.


@pytest.mark.slow
def test_many_random_loops_are_found_and_judged_as_their_simulation_does():
    rng = np.random.default_rng(5)
    judged = 0
    for _ in range(120):
        a, b = rng.uniform(0.2, 5.0, 2)
        gain = a * b * (a + b) * rng.uniform(1.2, 5.0)
        element, stable = [
            (Relay(rng.uniform(0.2, 3.0)), True),
            (Saturation(rng.uniform(0.2, 3.0)), True),
            (DeadZone(rng.uniform(0.1, 1.0)), False),
        ][rng.integers(3)]
        found = limit_cycles(third_order(gain, a, b), element)
        assert len(found) == 1, found.report()
        (c,) = found
        np.testing.assert_allclose(c.frequency, math.sqrt(a * b), rtol=1e-6)
        n = complex(element.describing(c.amplitude, c.frequency)).real
        np.testing.assert_allclose(n * gain / (a * b * (a + b)), 1.0, rtol=1e-6)
        assert c.stable is stable
        if c.lasts is not None:
            judged += 1
            assert c.lasts is stable, found.report()
            np.testing.assert_allclose(c.refined.peak, c.simulated.peak, rtol=0.005)
            np.testing.assert_allclose(c.refined.frequency, c.simulated.frequency, rtol=0.005)
    assert judged >= 110


@pytest.mark.slow
def test_many_random_thruster_loops_agree_with_their_simulation():
    rng = np.random.default_rng(6)
    for _ in range(40):
        loop = thruster_loop_cycle(
            dft.Thruster(**JASON),
            mass=rng.uniform(50, 2000),
            drag=rng.uniform(1, 300),
            natural_frequency=rng.uniform(0.2, 3.0),
            damping=rng.uniform(0.3, 1.2),
        )
        c = loop.cycle
        assert c.verdict == "stable", loop.report()
        np.testing.assert_allclose(c.refined.peak, c.simulated.peak, rtol=0.005)
        np.testing.assert_allclose(c.refined.frequency, c.simulated.frequency, rtol=0.005)
