"""The table of real diagnoses, with one that failed."""

import io

from rich.console import Console

from . import diagnoses


def test_a_diagnosis_that_fails_is_a_row_without_figures(monkeypatch):
    done = {"cpu": 12.4, "wall": 9.0, "peak": 800.0, "maps": 2000, "compiled": 40,
            "verdict": "adequate", "added": []}  # fmt: skip

    def measured(name, tree, cache, limit):
        return {"verdict": "none within 5 s", "added": []} if name == "esso" else done

    monkeypatch.setattr(diagnoses, "measured", measured)
    rows = diagnoses.by_turns(["demo", "esso"], [diagnoses.HERE] * 2, 5.0)
    assert [(row["case"], row["cache"], row["version"]) for row in rows][:4] == [
        ("demo", "cold", "now"), ("demo", "cold", "before"),
        ("demo", "cached", "now"), ("demo", "cached", "before"),
    ]  # fmt: skip
    shown = io.StringIO()
    Console(file=shown, width=160).print(diagnoses.table(rows))
    lines = shown.getvalue().splitlines()
    assert sum("none within 5 s" in line for line in lines) == 4
    assert sum("adequate" in line and "800" in line for line in lines) == 4
