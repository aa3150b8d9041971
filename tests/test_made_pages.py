"""The pages that are made when the site is built: nothing of the package is left out."""

import sys

import pytest
from places import ROOT

import diffthrust as dft
from diffthrust.effects import EFFECTS

sys.path.insert(0, str(ROOT / "docs" / "_ext"))

import atlas_path
import docstrings
import reference_cli
import reference_errors
import reference_spec
from atlas_logs import benches

CATALOGUE = [name for name in EFFECTS if name not in ("curve", "formula")]


def shown_on(name):
    """The first bench of the atlas whose model has the port of an effect."""
    for bench in benches():
        try:
            return bench, (bench.model + EFFECTS[name]()).effects[0]
        except dft.InputError:
            continue
    raise AssertionError(f"no bench has the port of {name}")


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_effect_is_marked_on_a_drawn_path(name):
    bench, effect = shown_on(name)
    drawn = atlas_path.drawn(bench.code, effect.ports, set(), {})
    assert drawn.count(atlas_path.MARKED) == 2 * len(effect.ports)


def test_a_drawn_path_has_every_port_input_and_measured_output():
    for bench in benches():
        places, arrows = atlas_path.PATHS[bench.code]
        ends = {*bench.model.inputs, *bench.noise}
        assert {*bench.model.ports, *ends} <= {*places}
        assert {word for arrow in arrows for word in arrow.split()} <= {*places}


def test_every_key_of_a_spec_file_says_what_it_means():
    for model in reference_spec.TABLES.values():
        told = reference_spec.meanings(model)
        assert not [key for key in model.model_fields if not told.get(key)]


def test_the_page_of_keys_names_every_table():
    assert reference_spec.spec_page().count("\n## ") == len(reference_spec.TABLES)


def test_every_command_has_a_section_with_a_help_of_each_option():
    page = reference_cli.command_line()
    for name in ("look", "fit", "compare", "diagnose", "check", "new-effect"):
        assert f"\n## diffthrust {name}\n" in page
    assert "|  |\n" not in page


def test_messages_are_found_with_their_mends():
    found = [m for folder in reference_errors.messages().values() for m in folder]
    assert len(found) > 400
    assert sum(bool(m.mend) for m in found) > 0.95 * len(found)
    deadband = [m.problem for m in found if "has no parameter" in m.problem]
    assert deadband
    assert {*reference_errors.messages()} <= {*reference_errors.TITLES}


def test_equations_and_bars_of_a_docstring_stay_as_they_are():
    told = docstrings.as_rst(
        ["A law.", "", "    a' = b * c", "", "With |u| u, x_ and *two* of them.", "", "Args:"]
    )
    assert told[2:5] == ["::", "", "    a' = b * c"]
    assert "\\|u\\|" in told[6]
    assert "x\\_ " in told[6]
