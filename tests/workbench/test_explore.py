"""Opening and closing of a workbench, without a browser."""

from __future__ import annotations

import sys
import threading
import urllib.request

import example_names
import pytest

import diffthrust as dft
from diffthrust.workbench._server import PageServer  # private: how long it waits is its own


def test_a_fit_is_explored_in_a_notebook_as_on_a_page(monkeypatch):
    monkeypatch.setitem(sys.modules, "ipykernel", sys)  # as in a notebook: it comes back at once
    monkeypatch.setattr("webbrowser.open", lambda address: pytest.fail("a browser was opened"))
    bench = dft.explore(example_names.fit())
    assert bench.address.startswith("http://127.0.0.1:")
    assert f'<iframe src="{bench.address}"' in bench._repr_html_()
    with urllib.request.urlopen(bench.address) as page:
        assert "thruster: diffthrust" in page.read().decode()
    assert bench.session.fitted
    bench.close()
    bench.wait()
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(bench.address)


def test_a_page_that_nobody_comes_back_to_ends_the_server():
    left = threading.Event()
    server = PageServer(lambda document: None, left.set, patience=200)
    assert not server.ended.wait(1.0)  # nobody has come yet
    urllib.request.urlopen(server.address).close()
    assert server.ended.wait(120.0)
    assert left.is_set()


def test_a_port_in_use_is_said():
    first = PageServer(lambda document: None)
    port = int(first.address.partition("?")[0].rstrip("/").rpartition(":")[2])
    with pytest.raises(dft.InputError, match=f"port {port}: the workbench cannot listen there"):
        PageServer(lambda document: None, port=port)
    first.close()
    assert first.ended.wait(120.0)


def test_without_bokeh_the_extra_is_named(monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "bokeh"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "diffthrust.workbench._server", raising=False)
    monkeypatch.setitem(sys.modules, "bokeh", None)
    with pytest.raises(dft.InputError, match=r"pip install 'diffthrust\[workbench\]'"):
        dft.explore(example_names.fit(), browser=False, wait=False)
