"""The keys that a spec file may hold, each with its meaning below it: the reference shows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AllowInfNan,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    field_validator,
    model_validator,
)

from diffthrust._support.names import nearest
from diffthrust.estimation import _arguments
from diffthrust.estimation._arguments import STARTS_LIMIT, SUBSTEPS_LIMIT
from diffthrust.logs._columns import Column
from diffthrust.logs._written import PWM


def _as_list(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


def _as_effects(value: Any) -> Any:
    entries = [value] if isinstance(value, str | dict) else value
    if not (isinstance(entries, list) and all(isinstance(e, str | dict) for e in entries)):
        raise ValueError('a list of names and tables: ["actuator_lag", { formula = "...", ... }]')
    return entries


def _named(key: str, *kinds: type) -> BeforeValidator:
    """A bare value stands for a table with this key."""
    return BeforeValidator(lambda value: {key: value} if isinstance(value, kinds) else value)


@dataclass(frozen=True)
class RegisteredWord:
    """A key whose words are those of a registry in `estimation._arguments`: a check of pydantic."""

    registry: str

    @property
    def words(self) -> tuple[str, ...]:
        """The words, in the order of the registry."""
        return tuple(getattr(_arguments, self.registry))

    def __call__(self, value: Any) -> Any:
        if value not in self.words:
            near = nearest(value, self.words) if isinstance(value, str) else ""
            words = " or ".join(map(repr, self.words))
            raise ValueError(f"Input should be {words}{f' ({near})' if near else ''}")
        return value


def _as_time(value: Any) -> Any:
    step = isinstance(value, int | float) and not isinstance(value, bool)
    if value is False:
        return None
    if not isinstance(value, str | dict) and not (step and 0 < value < float("inf")):
        raise ValueError("a column, a step in seconds above zero, or false")
    return {"column": value} if isinstance(value, str) else value


def _stage(value: Any) -> float | None:
    if value == "whole":
        return None
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not 0 < value < float("inf"):
        raise ValueError("seconds above zero, 'auto', 'whole', or a list of seconds and 'whole'")
    return float(value)


class _Part(BaseModel):
    model_config: ClassVar[ConfigDict] = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False
    )


class TimePart(_Part):
    """The time column; ``dates`` is the format of dates that do not begin with the year."""

    column: str
    """The column of time."""
    unit: str = ""
    """Its unit: s, ms, us, ...; dates need none."""
    dates: str = ""
    """The format of dates that do not begin with the year, as in ``strptime``."""


class LeaveOutPart(_Part):
    """``leave_out = [{ log = "run1.csv", start = 3, stop = 5, note = "weed" }]``."""

    log: str
    """Name of the log, as reports give it: its file."""
    start: float
    """First moment to leave out, in seconds after the first sample."""
    stop: float
    """Last moment to leave out, likewise."""
    note: str = ""
    """Why."""


class LogsPart(_Part):
    """``[logs]``: which files, and how they are read; ``base`` and below are of robots' logs.

    ``time`` is a column, a step [s], or false; ``sheet`` is of Excel files.
    """

    train: Annotated[list[str], BeforeValidator(_as_list), Field(min_length=1)]
    """Files to fit to, relative to the spec; patterns such as ``run*.csv`` are allowed."""
    holdout: Annotated[list[str], BeforeValidator(_as_list)] = []
    """Files that the fit does not see."""
    time: Annotated[TimePart | float | None, BeforeValidator(_as_time)] = TimePart(column="time")
    """The time column, a step [s] where there is none, or false for samples without time."""
    static: bool = False
    """The rows are points of a table, not recorded in time, each held for the step of ``time``."""
    sheet: str | None = None
    """The sheet of an Excel file."""
    missing_values: Annotated[list[str | float], BeforeValidator(_as_list)] = []
    """What stands for a missing sample, such as ``"n/a"`` or -999."""
    interpolate_inputs: bool = False
    """Fill missing samples of inputs instead of refusing them."""
    start: float | None = None
    """Leave out what comes before [s]."""
    stop: float | None = None
    """Leave out what comes after [s]."""
    leave_out: list[LeaveOutPart] = []
    """Stretches in which nothing counts as measured."""
    rate: Annotated[float, Field(gt=0)] | None = None
    """Samples a second to bring the logs to, by means: for rows merged from several messages."""
    base: str | float | None = None
    """Time stamps of a robot's log: ``"messages"``, a channel, or a step [s]."""
    gap: Annotated[float, Field(ge=0)] | None = None
    """Largest gap of a robot's channel to interpolate across [s]; three of its periods if none."""
    faster: Annotated[float, Field(ge=1)] = 2.0
    """How many times faster than an interpolated channel the base may be."""
    stamps: Literal["recorder", "header"] = "recorder"
    """Whose stamps of a bag count: of the recorder, or of the messages' headers."""


class PWMPart(_Part):
    """``pwm = { stop = 1500, full = 1900 }``: what widths of pulses mean."""

    stop: float
    """Width at which the motor stands [us]."""
    full: float
    """Width at full ahead [us]."""
    reverse: float | None = None
    """Width at full astern [us]; as far below stop as full is above where not given."""


_Bound = Annotated[float, AllowInfNan(True)]
_Quantity = float | str


class ChannelPart(_Part):
    """``[channels.NAME]``: the column of a channel."""

    column: str
    """The column, or ``TOPIC.FIELD`` of a robot's log."""
    unit: str = ""
    """The column's unit; without one the numbers are taken to be in the model's.

    A ``north`` and an ``east`` in deg are a latitude and a longitude.
    """
    role: Literal["input", "measured"] | None = None
    """Whether it is an input or measured, where the model has the name as both."""
    unsigned: bool | None = None
    """The sensor reports the absolute value."""
    noise: Annotated[float, Field(gt=0)] | None = None
    """Known standard deviation of the sensor, in the column's unit."""
    hold: Literal["zero", "linear"] | None = None
    """How an input runs between samples: it keeps its value, or straight to the next."""
    scale: float = 1.0
    """value = scale * column + offset."""
    offset: float = 0.0
    """See ``scale``."""
    pwm: PWMPart | None = None
    """The column holds widths of pulses."""
    effort: bool = False
    """The column is a share of the full command, such as per cent."""
    rails: Annotated[list[_Bound], Field(min_length=2, max_length=2)] | None = None
    """Where the range of the sensor ends, low and high; ``inf`` where it does not."""
    censored: bool = False
    """Samples at a rail count as "at least" or "at most" it."""
    shift: float = 0.0
    """Seconds by which it comes later; below zero for earlier."""

    def as_column(self) -> Column:
        """The column that it describes."""
        fields = {key: getattr(self, key) for key in self.model_fields_set - {"role", "shift"}}
        if self.pwm is not None:
            fields["pwm"] = PWM(**self.pwm.model_dump())
        return Column(**{key: value for key, value in fields.items() if value is not None})


class ThrusterPart(_Part):
    """``[thrusters.NAME]``: one thruster of a craft."""

    model: str = ""
    """Its model, as "thruster" or "static_thruster"; that of all, or of ``like``, by default."""
    on: str = ""
    """The thruster that an azimuth turns, or that has a rudder behind it."""
    at: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None
    """Where it acts: forward, to starboard, down [m]."""
    pointing: Annotated[list[float], Field(min_length=3, max_length=3)] = [1.0, 0.0, 0.0]
    """Where a positive thrust pushes."""
    like: str = ""
    """The thruster whose numbers it shares."""
    reaction: float | None = None
    """Torque per thrust that its propeller leaves on the hull [m]."""
    input: str = ""
    """The column of its command."""
    unit: str = ""
    """The column's unit."""
    pwm: PWMPart | None = None
    """The column holds widths of pulses."""
    effort: bool = False
    """The column is a share of the full command."""


class ThrustersPart(_Part):
    """``[thrusters]``: those of a craft, each in a table, or all of a ready layout."""

    frame: str = ""
    """A ready layout: "bluerov2", "bluerov2_heavy", "blueboat", "otter", ..."""
    columns: list[str] = []
    """The columns of the commands, in the order of the layout."""
    model: str = ""
    """The model of all of them."""
    on: str = ""
    """The thruster that an azimuth turns, or that has a rudder behind it."""
    unit: str = ""
    """The unit of the columns."""
    pwm: PWMPart | None = None
    """The columns hold widths of pulses."""
    effort: bool = False
    """The columns are shares of the full command."""
    each: dict[str, ThrusterPart] = {}
    """The thrusters by name; in the file they stand below ``[thrusters]`` itself."""

    @model_validator(mode="before")
    @classmethod
    def _split(cls, value: Any) -> Any:
        """Tables of thrusters stand beside the keys of all: both below ``[thrusters]``."""
        if not isinstance(value, dict):
            return value
        keys = set(cls.model_fields) - {"each"}
        tables = {k: v for k, v in value.items() if k not in keys and isinstance(v, dict)}
        return {**{k: v for k, v in value.items() if k not in tables}, "each": tables}


class SensorPart(_Part):
    """``[sensors]``: ``gps = "gnss"``, or a table with its place."""

    model: str
    """What it is: "gnss", "dvl", "imu", "pressure", "attitude"."""
    at: Annotated[list[float], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
    """Where it sits: forward, to starboard, down [m]."""
    frame: str = ""
    """The axes of its readings: "FRD" or "FLU", of an attitude "NED" or "ENU"."""


_Sensors = dict[str, Annotated[SensorPart, _named("model", str)]]


class CraftPart(_Part):
    """What describes a craft alone."""

    body: str = ""
    """The name of its body."""
    thrusters: ThrustersPart
    """Its thrusters and their places."""
    sensors: _Sensors = {}
    """Its sensors and theirs."""


class PriorPart(_Part):
    """A Gaussian prior."""

    mean: _Quantity
    """Its mean, as ``value``."""
    std: _Quantity
    """Its standard deviation, above zero."""


class ParameterPart(_Part):
    """``[parameters]``: what differs from the model's own description."""

    value: _Quantity | None = None
    """Where the search begins, or where the parameter is held.

    A number in the parameter's unit, or one with its unit as in a report: ``"25 us"``.
    """
    bounds: Annotated[list[_Bound | str], Field(min_length=2, max_length=2)] | None = None
    """Lowest and highest value, as ``value``; ``-inf`` and ``inf`` for none."""
    fixed: bool | None = None
    """Hold it at its value."""
    prior: PriorPart | None = None
    """What is known of it beforehand."""
    per_log: bool | None = None
    """It differs from log to log, about ``value``."""
    width: Annotated[float, Field(gt=0)] | None = None
    """By how much, as a standard deviation in the parameter's unit; a fit estimates it."""


class FitPart(_Part):
    """``[fit]``: the arguments of `fit`; only those that are given are passed on."""

    starts: Annotated[int, Field(ge=1, le=STARTS_LIMIT)] = 8
    """How many starts the search makes."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Of the draws of the starts."""
    horizon: Any = "auto"
    """Length of segments [s], ``"auto"``, ``"whole"``, or a list of stages."""
    likelihood: Annotated[str, BeforeValidator(RegisteredWord("LIKELIHOODS"))] = "simulation"
    """Of whole runs, or of the next sample under random forces."""
    loss: Annotated[str, BeforeValidator(RegisteredWord("LOSSES"))] = "gaussian"
    """The law of the errors."""
    noise_model: Annotated[str, BeforeValidator(RegisteredWord("NOISE_MODELS"))] = "white"
    """Whether errors last from sample to sample, as under ``"ar1"``."""
    initial: Literal["auto", "estimate", "measured"] = "auto"
    """Where states begin: estimated, or as measured."""
    substeps: Annotated[int, Field(ge=1, le=SUBSTEPS_LIMIT)] | None = None
    """Integrator steps per sample; found where not given."""
    per_log: list[str] = []
    """Parameters that differ from log to log, each about a mean of all."""

    @field_validator("horizon")
    @classmethod
    def _stages(cls, value: Any) -> Any:
        if value == "auto":
            return value
        return tuple(map(_stage, value)) if isinstance(value, list) and value else _stage(value)


class ExpectedNumber(_Part):
    """A value, its standard error, and how far it may move."""

    value: float
    """What was found."""
    std_error: Annotated[float, Field(ge=0)] | None = None
    """Its standard error, by which a move is measured."""
    tolerance: Annotated[float, Field(ge=0)] | None = None
    """Largest difference allowed, where it is not to follow from the standard error."""


class ExpectedPart(_Part):
    """``[expected]``: what `diffthrust check` compares with, and of what it was found."""

    library: str | None = None
    """The versions with which it was written."""
    spec: str | None = None
    """Hash of the spec without this block."""
    data: dict[str, str] = {}
    """Hash of each file of data."""
    status: str | None = None
    """The status of the fit."""
    train_nrmse: Annotated[ExpectedNumber | None, _named("value", int, float, str)] = None
    """The error on the training logs."""
    holdout_nrmse: Annotated[ExpectedNumber | None, _named("value", int, float, str)] = None
    """The error on the unseen logs."""
    parameters: dict[str, Annotated[ExpectedNumber, _named("value", int, float, str)]] = {}
    """The estimates by name."""


class SpecFile(_Part):
    """A whole spec file."""

    model: str
    """Name of a model, or ``script.py:Class``."""
    effects: Annotated[list[Any], BeforeValidator(_as_effects)] = []
    """Names of effects, ``script.py:Class``, or tables of a formula."""
    options: dict[str, str | bool | int | float] = {}
    """Arguments of the model, such as ``drive = "twin"``."""
    body: str = ""
    """Of a craft: the name of its body, as "planar"."""
    thrusters: ThrustersPart | None = None
    """Of a craft: its thrusters and their places."""
    sensors: _Sensors = {}
    """Of a craft: its sensors and their places."""
    logs: LogsPart
    """Which files, and how they are read."""
    channels: Annotated[
        dict[str, Annotated[ChannelPart, _named("column", str)]], Field(min_length=1)
    ]
    """The column of each channel, by its name in the model."""
    parameters: dict[str, Annotated[ParameterPart, _named("value", int, float, str)]] = {}
    """What differs from the model's own description, by name."""
    fit: FitPart = FitPart()
    """Arguments of the fit."""
    expected: ExpectedPart | None = None
    """What ``diffthrust check`` compares with; written by ``check --update``."""

    @property
    def words(self) -> tuple[str, ...]:
        """The model and those effects that are named by a word, which may be a script's."""
        return (self.model, *(entry for entry in self.effects if isinstance(entry, str)))
