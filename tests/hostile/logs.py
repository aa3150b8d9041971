"""Logs as nobody should record them: a sound table, spoilt, in one of many formats, damaged."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import campaign_specs
import h5py
import numpy as np
import pandas as pd
from damaged_files import damaged
from scipy.io import savemat

from .specs import pick

Rng = np.random.Generator
ROWS = 60
CELLS = (
    *(
        "",
        " ",
        "nan",
        "NaN",
        "n/a",
        "NULL",
        "-",
        "inf",
        "-inf",
        "1e300",
        "-1e300",
        "1e-300",
        "1e999",
    ),
    *(
        "abc",
        "1,5",
        "1 000",
        "1_000",
        "0x10",
        "١٢",
        "2024-13-45",
        "12:00:00",
        "TRUE",
        '"',
        "'",
        "\x00",
    ),
    *("5e-324", "1.7976931348623157e308", "9" * 400, "1e-999", "--1", "+-2", "1.2.3", "#", "=1+1"),
)
"""Cells of a text table."""


NUMBERS = (0.0, -1.0, 1e300, -1e12, 1e-300, 1e-320, float("nan"), float("inf"), -float("inf"))
"""Numbers that a sensor does not give."""


def sound(rng: Rng) -> pd.DataFrame:
    """A thruster's log: time, command and speed."""
    time = 0.1 * np.arange(ROWS)
    command = np.repeat(rng.uniform(-2.0, 2.0, ROWS // 10), 10)
    speed = 20.0 * np.tanh(np.cumsum(command) / 20.0) + 0.1 * rng.standard_normal(ROWS)
    return pd.DataFrame({"t": time, "u": command, "n": speed})


def _column(rng: Rng) -> str:
    return str(pick(rng, ["t", "u", "n"]))


def _filled(
    values: Callable[[Rng, int], np.ndarray | float],
) -> Callable[[pd.DataFrame, Rng], pd.DataFrame]:
    """A change of a whole column."""

    def changed(frame: pd.DataFrame, rng: Rng) -> pd.DataFrame:
        frame[_column(rng)] = values(rng, len(frame))
        return frame

    return changed


def _spots(odd: Callable[[Rng], float]) -> Callable[[pd.DataFrame, Rng], pd.DataFrame]:
    """A change of some numbers of a column."""

    def changed(frame: pd.DataFrame, rng: Rng) -> pd.DataFrame:
        name = _column(rng)
        column = pd.to_numeric(frame[name], errors="coerce").to_numpy(float, copy=True)
        column[rng.integers(len(column), size=int(rng.integers(1, 20)))] = odd(rng)
        frame[name] = column
        return frame

    return changed


def _cells(frame: pd.DataFrame, rng: Rng) -> pd.DataFrame:
    name = _column(rng)
    column = frame[name].astype(object)
    column.iloc[rng.integers(len(column), size=int(rng.integers(1, 4)))] = str(pick(rng, CELLS))
    frame[name] = column
    return frame


def _time(frame: pd.DataFrame, rng: Rng) -> pd.DataFrame:
    time = pd.to_numeric(frame["t"], errors="coerce").to_numpy(float, copy=True)
    some = rng.integers(len(time), size=5)
    kinds: tuple[Callable[[], np.ndarray], ...] = (
        lambda: time[::-1],
        lambda: np.zeros_like(time),
        lambda: rng.permutation(time),
        lambda: np.repeat(time[::2], 2)[: len(time)],
        lambda: time + 1e15,
        lambda: time * 10.0 ** rng.integers(-12, 13),
        lambda: np.where(np.isin(np.arange(len(time)), some), np.nan, time),
        lambda: np.where(np.isin(np.arange(len(time)), some), time - 3.0, time),
        lambda: time + np.where(time > 3.0, 10.0 ** rng.integers(2, 9), 0.0),
        lambda: np.cumsum(rng.exponential(0.1, len(time))),
        lambda: -time,
    )
    frame["t"] = kinds[int(rng.integers(len(kinds)))]()
    return frame


def _columns(frame: pd.DataFrame, rng: Rng) -> pd.DataFrame:
    names = list(frame.columns)
    names[int(rng.integers(3))] = str(
        pick(rng, ["t", "u", "n", "", " u ", "U", "u [V]", "ü😀", "u\n", "1", "u,n", "#u"])
    )
    frame.columns = names
    return frame


def _wide(frame: pd.DataFrame, rng: Rng) -> pd.DataFrame:
    zeros = pd.DataFrame(np.zeros((len(frame), 500)), index=frame.index)
    return pd.concat([frame, zeros.add_prefix("c")], axis=1)


def _noise(rng: Rng, n: int) -> np.ndarray:
    return 10.0 ** rng.uniform(-300, 300, n)


TABLES: dict[str, Callable[[pd.DataFrame, Rng], pd.DataFrame]] = {
    "cells": _cells,
    "time": _time,
    "names of columns": _columns,
    "constant": _filled(lambda rng, n: pick(rng, NUMBERS)),
    "any size": _filled(_noise),
    "noise": _filled(lambda rng, n: rng.standard_normal(n)),
    "whole numbers": _filled(lambda rng, n: rng.integers(-(2**62), 2**62, n)),
    "words": _filled(lambda rng, n: np.array(["on", "off"] * n)[:n]),
    "flags": _filled(lambda rng, n: rng.random(n) < 0.5),
    "odd numbers": _spots(lambda rng: pick(rng, NUMBERS)),
    "few rows": lambda frame, rng: frame.iloc[: int(pick(rng, [0, 1, 2, 3, 5]))],
    "a column gone": lambda frame, rng: frame.drop(columns=_column(rng)),
    "wide": _wide,
    "none": lambda frame, rng: frame,
}


def _text(frame: pd.DataFrame, rng: Rng) -> bytes:
    text = frame.to_csv(
        index=False,
        sep=str(pick(rng, [",", ";", "\t", " "])),
        lineterminator=str(pick(rng, ["\n", "\r\n", "\r"])),
        quotechar='"',
        escapechar="\\",
    )
    begin = str(pick(rng, ["", "", "", "\ufeff", "# a comment\n", "\n\n", "a title\n"]))
    coding = str(pick(rng, ["utf-8", "utf-8", "utf-8", "utf-16", "latin-1", "utf-32-be"]))
    return (begin + text).encode(coding, "replace")


def _mat(frame: pd.DataFrame, rng: Rng) -> bytes:
    out = io.BytesIO()
    columns = {
        f"{name}".strip() or "x": frame.iloc[:, i].to_numpy() for i, name in enumerate(frame)
    }
    if rng.random() < 0.3:
        columns["odd"] = np.array([1 + 2j, np.nan])
    if rng.random() < 0.3:
        columns["struct"] = {"a": np.zeros((2, 3, 4)), "b": "text"}  # type: ignore[assignment]
    savemat(out, columns, do_compression=rng.random() < 0.5)
    return out.getvalue()


def _hdf5(frame: pd.DataFrame, rng: Rng) -> bytes:
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        for i, name in enumerate(frame):
            values = frame.iloc[:, i].to_numpy()
            where = str(name).strip().replace("/", "|") or "x"
            if where not in file:
                file[where] = values.astype("S") if values.dtype == object else values
        if rng.random() < 0.3:
            file["group/deep"] = np.zeros((3, 4))
            file["link"] = h5py.ExternalLink("no.h5", "/x")
            file["dangling"] = h5py.SoftLink("/nowhere")
    return out.getvalue()


def _parquet(frame: pd.DataFrame, rng: Rng) -> bytes:
    out = io.BytesIO()
    frame.loc[:, ~frame.columns.duplicated()].map(_plain).to_parquet(out)
    return out.getvalue()


def _excel(frame: pd.DataFrame, rng: Rng) -> bytes:
    out = io.BytesIO()
    frame.map(_plain).map(
        lambda x: x if np.isscalar(x) and x == x and x not in (np.inf, -np.inf) else None
    ).to_excel(out, index=False)
    return out.getvalue()


def _plain(cell: object) -> object:
    """A cell that binary tables can hold: text without control characters, or a number."""
    return cell.replace("\x00", "") if isinstance(cell, str) else cell


FORMATS: dict[str, Callable[[pd.DataFrame, Rng], bytes]] = {
    ".csv": _text,
    ".txt": _text,
    ".tsv": _text,
    ".mat": _mat,
    ".h5": _hdf5,
    ".parquet": _parquet,
    ".xlsx": _excel,
}


def hostile_log(rng: Rng) -> tuple[bytes, str, str]:
    """The bytes of a log, the ending of its file, and what was done to it."""
    ending = str(pick(rng, [".csv", ".csv", *FORMATS]))
    while True:
        frame, done = sound(rng), []
        for _ in range(int(pick(rng, [1, 1, 2]))):
            done.append(str(pick(rng, list(TABLES))))
            if list(frame.columns)[:3] == ["t", "u", "n"] and len(frame):
                frame = TABLES[done[-1]](frame.copy(), rng)
        try:
            data = FORMATS[ending](frame, rng)
            break
        except (ValueError, TypeError, OverflowError, LookupError, OSError):
            continue  # what this format cannot hold
        except Exception as error:  # of pyarrow and openpyxl, which have kinds of their own
            if not type(error).__module__.startswith(("pyarrow", "openpyxl")):
                raise
    if data and rng.random() < 0.3:
        data = bytes(damaged(data, rng))
        done.append("bytes")
    if rng.random() < 0.05:
        ending = str(pick(rng, list(FORMATS)))
        done.append("another ending")
    return data, ending, ", ".join(done)


def write_hostile_log(folder: Path, seed: int) -> str:
    """A folder with a hostile log, a sound one and a spec of both; what is hostile about it."""
    rng = np.random.default_rng([seed, 2])
    data, ending, done = hostile_log(rng)
    folder.mkdir(parents=True)
    (folder / f"log{ending}").write_bytes(data)
    campaign_specs.thruster_log(folder / "unseen.csv", 2, 0.25)
    text = campaign_specs.THRUSTER.replace("train.csv", f"log{ending}")
    (folder / "fit.toml").write_text(text)
    return f"{ending}: {done}"
