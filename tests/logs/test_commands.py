"""Commands as vehicles log them: widths of pulses, shares, per cent, set points."""

import numpy as np
import pytest
from robot_files import write_dataflash

import diffthrust as dft
from diffthrust import Column, InputError
from diffthrust.logs import PWM, Written

WIDTHS = np.array([1500.0, 1900.0, 1100.0, 1700.0, 1400.0])
EFFORT = np.array([0.0, 1.0, -1.0, 0.5, -0.25])


def read(tmp_path, column, numbers, channel="command"):
    path = tmp_path / "run.csv"
    rows = [f"{0.1 * i:.1f},{number}" for i, number in enumerate(numbers)]
    path.write_text("\n".join(["t,u", *rows]))
    return dft.read_log(path, time="t", inputs={channel: column})


@pytest.mark.parametrize(
    ("column", "numbers", "effort"),
    [
        (Column("u", pwm={"stop": 1500, "full": 1900}), WIDTHS, EFFORT),
        (Column("u", unit="us", pwm={"stop": 1500, "full": 1900}), WIDTHS, EFFORT),
        (Column("u", pwm={"stop": 1500, "full": 1100}), WIDTHS, -EFFORT),
        (
            Column("u", pwm={"stop": 1500, "full": 1900, "reverse": 1300}),
            WIDTHS,
            np.where(EFFORT < 0, 2 * EFFORT, EFFORT),
        ),
        (Column("u", pwm=PWM(1500, 1900), scale=-1), WIDTHS, -EFFORT),
        (Column("u", pwm=PWM(*np.uint16([1500, 1100, 1900]))), WIDTHS, -EFFORT),
        (Column("u", unit="%", effort=True), 100 * EFFORT, EFFORT),
        (Column("u", effort=True), EFFORT, EFFORT),
        (Column("u", unit="effort"), EFFORT, EFFORT),
        (Column("u", effort=True, scale=1 / 255), 255 * EFFORT, EFFORT),
        (Column("u", effort=True, scale=2, offset=-1), (EFFORT + 1) / 2, EFFORT),
    ],
)
def test_every_form_of_an_effort_is_read(tmp_path, column, numbers, effort):
    log = read(tmp_path, column, numbers)
    assert log.units["command"] == "effort"
    np.testing.assert_allclose(log.inputs["command"], effort, atol=1e-12)


def test_a_servo_becomes_an_angle_and_a_voltage_has_an_offset(tmp_path):
    servo = Column("u", pwm={"stop": 1500, "full": 1900}, scale=35, unit="deg")
    log = read(tmp_path, servo, WIDTHS, "rudder_angle")
    np.testing.assert_allclose(log.inputs["rudder_angle"], np.deg2rad(35 * EFFORT), atol=1e-12)
    volts = read(tmp_path, Column("u", unit="mV", scale=2.0, offset=500.0), [0.0, 250.0])
    np.testing.assert_allclose(volts.inputs["command"], [0.5, 1.0])


def test_no_pulse_counts_as_the_stop_and_is_told(tmp_path):
    log = read(tmp_path, Column("u", pwm={"stop": 1500, "full": 1900}), [0.0, 0.0, 1700.0])
    np.testing.assert_allclose(log.inputs["command"], [0.0, 0.0, 0.5])
    assert any("2 samples have no pulse" in note for note in log.notes)


@pytest.mark.parametrize(
    ("column", "numbers", "told"),
    [
        (Column("u", pwm={"stop": 1500}), WIDTHS, "a stop and a full width"),
        (Column("u", pwm={"stop": 1500, "full": 1900, "revers": 1}), WIDTHS, "reverse"),
        (Column("u", pwm={"stop": 1500, "full": 1500}), WIDTHS, "between full ahead"),
        (Column("u", pwm={"stop": 1500, "full": 1900, "reverse": 1700}), WIDTHS, "between"),
        (Column("u", pwm={"stop": 1500, "full": "x"}), WIDTHS, "a width of pulses, found 'x'"),
        (Column("u", pwm={"stop": None, "full": 1900}), WIDTHS, "a width of pulses, found None"),
        (Column("u", pwm=PWM(1500, None)), WIDTHS, "a width of pulses, found None"),
        (Column("u", pwm={"stop": 1500, "full": 1900}), EFFORT, "numbers from -1 to 1"),
        (Column("u", unit="V", effort=True), EFFORT, "found the unit 'V'"),
        (Column("u", pwm={"stop": 1500, "full": 1900}, effort=True), WIDTHS, "found both"),
        (Column("u", hold="held", pwm=PWM(1500, 1900), effort=True), WIDTHS, "hold of 'zero'"),
        (Column("u", offset=float("nan")), WIDTHS, "a finite offset"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_the_column(tmp_path, column, numbers, told):
    with pytest.raises(InputError, match=told) as refused:
        read(tmp_path, column, numbers)
    assert "run.csv" in str(refused.value)
    assert refused.value.mend


def test_the_user_reads_what_the_user_wrote():
    pulses = Written("us", pwm=PWM(1500, 1900))
    np.testing.assert_allclose(pulses.values(EFFORT, "effort", "here"), WIDTHS)
    assert pulses.width(0.0625, "effort", "here") == pytest.approx(25.0)
    assert Written("%").values([0.5], "effort", "here") == pytest.approx(50.0)
    assert Written("kgf").width(9.80665, "N", "here") == pytest.approx(1.0)


def test_a_log_keeps_how_it_was_written_through_copies(tmp_path):
    log = read(tmp_path, Column("u", pwm={"stop": 1500, "full": 1900}), WIDTHS)
    for copy in (log, log.slice(0.1, 0.3), log.averaged(2)):
        assert copy.written["command"] == Written("us", "u", PWM(1500, 1900))


# Models.


def simulated(model, command, unit):
    time = 0.05 * np.arange(len(command))
    log = dft.Log(time, {"command": command}, units={"command": unit})
    outputs = dft.simulate(model, log)
    return dft.Log(time, {"command": command}, dict(outputs), units={"command": unit})


STEPS = np.repeat(np.random.default_rng(4).uniform(-1, 1, 40), 15)


@pytest.mark.parametrize(
    ("unit", "kind", "told"),
    [
        ("effort", "effort", "rad/s^2 per full effort"),
        ("rpm", "rad/s", "rad/s^2 per rad/s"),
        ("A", "A", "rad/(A s^2)"),
        ("mV", "V", "rad/(V s^2)"),
    ],
)
def test_a_fit_takes_the_command_as_the_log_has_it(unit, kind, told):
    truth = dft.Thruster(alpha=0.02, beta=1500.0, ct=5e-4, command=kind)
    log = simulated(truth, STEPS * {"rpm": 60 / (2 * np.pi), "mV": 1000.0}.get(unit, 1.0), unit)
    fit = dft.fit(dft.Thruster(), log)
    assert fit.status.ok
    assert fit.model.command == kind
    assert fit.parameters["beta"].unit == told
    for name, p in truth.parameters.items():
        assert fit.parameters[name].value == pytest.approx(p.value, rel=1e-4)


def test_numbers_for_volts_are_not_used_with_an_effort():
    log = simulated(dft.Thruster(command="effort"), STEPS, "effort")
    with pytest.raises(InputError, match="command='effort'"):
        dft.simulate(dft.Thruster(), log)
    with pytest.raises(InputError, match="beta is held"):
        dft.fit(dft.Thruster().fix("beta"), log)
    with pytest.raises(InputError, match="Name one of these"):
        dft.Thruster(command="m/s")
    other = simulated(dft.Thruster(), STEPS, "V")
    with pytest.raises(InputError, match="different units"):
        dft.fit(dft.Thruster(), [log, other])


def test_pulses_without_a_map_are_refused_with_the_mend():
    log = dft.Log([0.0, 0.1], {"command": [1500.0, 1600.0]}, units={"command": "us"})
    with pytest.raises(InputError, match="pwm"):
        dft.simulate(dft.Thruster(), log)


def test_a_boat_commanded_by_efforts_has_a_power_law():
    boat = dft.Vessel(drive="twin", command="effort", exponent=1.5, lever_arm=0.285)
    assert boat.parameters["m11"].unit == "kg/A"
    assert not boat.parameters["exponent"].fixed
    rng = np.random.default_rng(3)
    left, right = (np.repeat(rng.uniform(-0.2, 1, 20), 30) for _ in range(2))
    inputs, units = {"left_force": left, "right_force": right}, {}
    time = 0.1 * np.arange(left.size)
    outputs = dft.simulate(boat, dft.Log(time, inputs, units=dict.fromkeys(inputs, "effort")))
    forces = {name: np.sign(x) * np.abs(x) ** 1.5 for name, x in inputs.items()}
    values = {k: p.value for k, p in boat.parameters.items() if k != "exponent"}
    same = dft.simulate(dft.Vessel(drive="twin", **values), dft.Log(time, forces, units=units))
    for name in ("surge", "sway", "yaw_rate"):
        np.testing.assert_allclose(outputs[name], same[name], rtol=1e-9, atol=1e-12)


def test_a_spec_says_it_in_a_line(tmp_path):
    log = simulated(dft.Thruster(alpha=0.02, beta=1500.0, command="effort"), STEPS, "effort")
    rows = np.column_stack([log.time, 1500 + 400 * STEPS, log.measured["speed"]])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,pwm,w", comments="")
    (tmp_path / "fit.toml").write_text(
        'model = "thruster"\nlogs = { train = ["run.csv"], time = "t" }\n'
        '[channels.command]\ncolumn = "pwm"\npwm = { stop = 1500, full = 1900 }\n'
        '[channels.speed]\ncolumn = "w"\nunit = "rad/s"\n'
    )
    spec = dft.specs.load_spec(tmp_path)
    assert spec.model.command == "effort"
    assert spec.fit().parameters["beta"].value == pytest.approx(1500.0, rel=1e-4)


@pytest.mark.thorough
def test_the_log_of_an_autopilot_fits_as_the_docstring_of_its_reader_says(tmp_path):
    pytest.importorskip("pymavlink")
    truth = dft.Thruster(alpha=0.02, beta=1500.0, command="effort")
    step, effort = 0.02, np.round(400 * np.repeat(STEPS[::15], 40)) / 400
    exact = dft.Log(step * np.arange(effort.size), {"command": effort}).replaced(
        units={"command": "effort"}
    )
    speed = np.abs(dft.simulate(truth, exact)["speed"]) * 60 / (2 * np.pi)
    rows = []
    for k, share in enumerate(effort):
        rows.append(("RCOU", (1_000_000 + 20_000 * k, round(1500 + 400 * share))))
        if k % 5 == 0:
            rows.append(("ESC", (1_000_000 + 20_000 * k, 0, float(speed[k]))))
    kinds = {"RCOU": ("QH", ["TimeUS", "C1"]), "ESC": ("QBf", ["TimeUS", "Instance", "RPM"])}
    path = write_dataflash(tmp_path / "00000042.bin", kinds, rows, {"ESC": "Instance"})
    log = dft.read_robot_log(
        path,
        base="messages",
        inputs={"command": Column("RCOU.C1", pwm={"stop": 1500, "full": 1900})},
        measured={"speed": Column("ESC[0].RPM", unit="rpm", unsigned=True)},
    )
    fit = dft.fit(dft.Thruster(), log)
    assert fit.status.ok
    assert fit.parameters["alpha"].value == pytest.approx(0.02, rel=0.01)
    assert fit.parameters["beta"].value == pytest.approx(1500.0, rel=0.01)
    assert fit.train.channels["speed"].shown.unit == "rpm"


def test_pulses_that_are_declared_a_share_are_refused_with_the_mend(tmp_path):
    with pytest.raises(InputError, match="widths of pulses: declare them by pwm"):
        read(tmp_path, Column("u", effort=True), WIDTHS)
    with pytest.raises(InputError, match=r"scale=0\.01"):
        read(tmp_path, Column("u", effort=True), 100 * EFFORT)
    with pytest.raises(InputError, match="an effort, 1 at the full command"):
        read(tmp_path, Column("u", pwm=PWM(1500, 1900), offset=5.0), WIDTHS)


def test_only_of_an_effort_is_the_static_curve_fitted():
    loop = dft.SpeedLoopThruster()
    assert not loop.parameters["exponent"].fixed
    for unit, told in (("V", "rad/(V s)"), ("rad/s", "rad/s per rad/s")):
        other = loop.commanded_in(unit)
        assert other.parameters["exponent"].fixed
        assert other.parameters["gain"].unit == told
        assert dft.SpeedLoopThruster(command=unit).parameters["exponent"].fixed
        assert not other.commanded_in("effort").parameters["exponent"].fixed
