"""Data classes of the numerical core cannot be changed, and are compared as they can be."""

import importlib
import pkgutil
from dataclasses import is_dataclass

import equinox as eqx

BY_IDENTITY = {  # they hold series, of which no one truth can be told
    "Batch", "Gaps", "Intervals", "Links", "ProblemNumbers", "Profile", "Profiles", "Record",
    "Restart", "Sandwich", "Scores", "Varying",
}  # fmt: skip


def data_classes():
    """Those that are written in the folders of the core, not in folders below them."""
    found = {}
    for folder in ("models", "models._base", "effects", "simulation", "estimation", "uncertainty"):
        package = importlib.import_module(f"diffthrust.{folder}")
        for each in pkgutil.iter_modules(package.__path__):
            module = importlib.import_module(f"{package.__name__}.{each.name}")
            for cls in vars(module).values():
                ours = getattr(cls, "__module__", "") == module.__name__
                if ours and is_dataclass(cls) and not issubclass(cls, eqx.Module):
                    found[cls.__name__] = cls
    return found


def test_none_can_be_changed():
    classes = data_classes()
    assert len(classes) > 30
    assert {name for name, cls in classes.items() if not cls.__dataclass_params__.frozen} == set()


def test_those_that_hold_series_are_compared_by_identity():
    found = {name for name, cls in data_classes().items() if not cls.__dataclass_params__.eq}
    assert found == BY_IDENTITY


def test_what_prints_itself_in_a_line_does():
    for cls in data_classes().values():
        assert not hasattr(cls, "_line") or not cls.__dataclass_params__.repr
