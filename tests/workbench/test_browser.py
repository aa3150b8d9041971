"""The workbench in a real browser: the whole loop, by mouse and by keyboard alone."""

from __future__ import annotations

import http.client
import os
import re
import socket
from contextlib import closing
from pathlib import Path

import chromium
import command_line
import example_names
import nbformat
import pytest
from chromium import NEEDED
from nbclient import NotebookClient

import diffthrust as dft
from diffthrust.cli._demo import hidden_folder  # private: the demo's command writes by it
from tests.workbench.page import explored, lacking_folder, looked_at, served

pytestmark = NEEDED


@pytest.fixture(scope="module")
def demo(tmp_path_factory) -> Path:
    return hidden_folder(tmp_path_factory.mktemp("demo") / "hidden")


@pytest.fixture
def lacking(tmp_path) -> Path:
    return lacking_folder(tmp_path)


FOCUSED = """() => {
  let e = document.activeElement
  while (e.shadowRoot?.activeElement) e = e.shadowRoot.activeElement
  return e.innerText?.trim() || e.className || e.type
}"""
"""What has the focus, within the parts of the page that Bokeh has closed off."""
FIRST_SLIDER = """() =>
  [...Bokeh.documents[0]._all_models.values()].find(model => model.type == "Slider").value
"""


def errors_shown(page) -> list[float]:
    """The errors of the logs, as the list on the left gives them."""
    labels = page.locator(".bk-RadioGroup label").all_inner_texts()
    return [float(re.search(r"\) (\S+)$", label.strip())[1]) for label in labels]


def add_what_was_found_and_save(page, model, before, unseen):
    """Undo the tick and add all that was found instead; the errors fall, and it is saved."""
    page.get_by_text("fit: converged").wait_for()
    page.get_by_role("button", name="Undo").click()
    page.get_by_text("thruster", exact=True).wait_for()
    page.get_by_role("button", name="Add what was found").click()
    page.get_by_text(model).wait_for()
    page.get_by_text(re.compile(rf"kept out\) {unseen}")).wait_for()
    after = errors_shown(page)
    assert all(new < 0.2 * old for old, new in zip(before, after, strict=True))
    page.get_by_role("button", name="Save", exact=True).click()
    page.get_by_text(re.compile("Saved in .*explored")).wait_for()


def test_the_clicks_from_the_error_to_what_is_saved(lacking, monkeypatch):
    """All clicks of the whole loop; the diagnosis is one of the same logs that is there already."""
    diag = example_names.diag()
    monkeypatch.setattr("diffthrust.workbench._session.diagnose", lambda *a, **k: diag)
    with explored(lacking) as address, looked_at(address) as page:
        page.get_by_text("fit: converged").wait_for()
        before = errors_shown(page)
        page.get_by_role("button", name="Diagnose: what is missing?").click()
        page.get_by_text("Found: commands within").wait_for()
        page.get_by_text("command dead band: removes").first.click()
        page.get_by_text("thruster + command dead band").wait_for()
        add_what_was_found_and_save(page, "thruster + command dead band", before, r"0\.0")
    assert 'effects = ["command_deadband"]' in (lacking / "explored" / "fit.toml").read_text()
    command_line.run("check", lacking / "explored")


@pytest.mark.slow  # a diagnosis with all candidates
def test_the_whole_loop_load_diagnose_tick_save(demo):
    """See the error, diagnose, add, the error falls, save, and `check` accepts it."""
    with served(demo) as (address, process), looked_at(address) as page:
        page.get_by_text("fit: converged").wait_for()
        before = errors_shown(page)
        assert len(before) == 3
        page.get_by_role("button", name="Diagnose: what is missing?").click()
        found = page.get_by_role("button", name="Add what was found")
        found.wait_for(timeout=900_000)  # a first diagnosis compiles for minutes
        assert page.get_by_text("commands within").count()
        page.get_by_text("reverse thrust asymmetry: removes").first.click()  # a tick
        page.get_by_text("thruster + reverse thrust asymmetry").wait_for()
        both = "thruster + command dead band + reverse thrust asymmetry"
        add_what_was_found_and_save(page, both, before, r"0\.00")
        process.kill()  # in the middle: what was saved is there, and whole
    saved = demo / "explored"
    names = ["diagnosis.html", "errors.png", "fit.json", "fit.toml", "report.html", "script.py"]
    assert sorted(path.name for path in saved.iterdir()) == names
    assert (
        'effects = ["command_deadband", "reverse_thrust_asymmetry"]'
        in (saved / "fit.toml").read_text()
    )
    command_line.run("check", saved)


@pytest.mark.thorough
def test_by_keyboard_alone_in_a_narrow_window(lacking):
    with explored(lacking) as address, looked_at(address, width=900) as page:
        page.get_by_text("fit: converged").wait_for()
        for width in (900, 780, 390):
            page.set_viewport_size({"width": width, "height": 720})
            page.wait_for_function(f"() => document.documentElement.scrollWidth <= {width}")
        page.get_by_role("button", name="Diagnose: what is missing?").focus()
        reached = set()
        for _ in range(60):
            page.keyboard.press("Tab")
            reached.add(page.evaluate(FOCUSED))
        assert {"Fit", "Save", "Copy as Python", "Learned law"} <= reached
        assert any("noUi-handle" in str(name) for name in reached)
        while page.evaluate(FOCUSED) != "Clocks":
            page.keyboard.press("Tab")
        page.keyboard.press("Enter")
        page.get_by_text("Clocks that disagree").wait_for()
        for _ in range(60):
            page.keyboard.press("Tab")
            reached.add(page.evaluate(FOCUSED))
        assert "checkbox" in reached
        handle = page.locator(".noUi-handle").first
        value = page.evaluate(FIRST_SLIDER)
        handle.focus()
        for _ in range(5):
            page.keyboard.press("ArrowRight")
        assert page.evaluate(FIRST_SLIDER) > value
        page.get_by_text("sliders were moved since the fit").wait_for()
        page.get_by_role("button", name="Undo").focus()
        page.keyboard.press("Enter")
        page.get_by_text("sliders were moved since the fit").wait_for(state="detached")
        page.wait_for_function(  # the words come in an answer of their own
            f"value => Math.abs(({FIRST_SLIDER})() - value) < 1e-6 * value", arg=value
        )


@pytest.mark.thorough
def test_all_plots_are_in_sight(demo):
    with served(demo) as (address, _), looked_at(address) as page:
        page.get_by_role("button", name="Zoom in").first.wait_for()
        page.wait_for_function("() => Bokeh.documents[0].is_idle")
        boxes = [canvas.bounding_box() for canvas in page.locator("canvas").all()]
        assert max(box["y"] + box["height"] for box in boxes if box) <= 720


@pytest.mark.thorough
def test_a_stretch_is_left_out_and_channels_shifted_and_names_are_text(lacking):
    with explored(lacking) as address, looked_at(address) as page:
        page.get_by_text("fit: converged").wait_for()
        box = page.locator("canvas").nth(1).bounding_box()
        page.locator("[title='Select a stretch']").first.click()
        page.mouse.move(box["x"] + 200, box["y"] + 30)
        page.mouse.down()
        page.mouse.move(box["x"] + 300, box["y"] + 30, steps=4)
        page.mouse.up()
        page.wait_for_function(f"() => ({LIT})() > 20")  # the same samples in the scatter
        page.get_by_text("A stretch alone", exact=True).click()
        start, stop = (page.locator(".bk-Spinner input").nth(k) for k in (0, 1))
        assert 0 < float(start.input_value()) < float(stop.input_value()) < 12
        note = page.get_by_placeholder("such as weed")
        note.fill("<b onclick=alert()>weed</b> $$x$$")
        note.press("Tab")
        page.get_by_role("button", name="Leave it out").click()
        page.get_by_text("<b onclick=alert()>weed</b> $$x$$").wait_for()
        page.get_by_text("Clocks", exact=True).click()
        page.get_by_label("thrust", exact=True).check()
        later = page.get_by_label("Later by [s]")
        later.fill("0.05")
        later.press("Tab")
        page.get_by_role("button", name="Shift").click()
        page.get_by_text("thrust comes +0.05 s later").wait_for()
        page.get_by_text("fit: converged").wait_for()
        page.get_by_role("button", name="Copy as Python").click()
        page.get_by_text('shifted(0.05, "thrust").leave_out(').wait_for()
        page.get_by_text("A stretch alone", exact=True).click()
        page.get_by_role("button", name="Take in").click()
        page.get_by_text("Left out: ").wait_for(state="detached")


LIT = """() => [...Bokeh.documents[0]._all_models.values()]
  .filter(model => model.type == "ColumnDataSource")
  .reduce((most, source) => Math.max(most, source.selected.indices.length), 0)
"""


CELLS = """import example_names, diffthrust as dft
bench = dft.explore(example_names.fit())
bench
"""


@pytest.mark.thorough
def test_the_cell_of_a_real_notebook_shows_the_page_and_follows(tmp_path, monkeypatch):
    tests = Path(__file__).resolve().parents[1]
    monkeypatch.setenv("PYTHONPATH", f"{tests}{os.pathsep}{tests.parent}")
    cell = nbformat.v4.new_code_cell(CELLS)
    client = NotebookClient(nbformat.v4.new_notebook(cells=[cell]), kernel_name="python3")
    with client.setup_kernel():
        client.execute_cell(cell, 0)
        shown = tmp_path / "notebook.html"  # a page of another origin, as a notebook's is
        shown.write_text(cell.outputs[-1]["data"]["text/html"])
        with chromium.looked_at(shown.as_uri(), r"file://|(http|ws)://127\.0\.0\.1:") as page:
            frame = page.frame_locator("iframe")
            frame.get_by_text("fit: converged").wait_for()
            frame.locator(".noUi-handle").first.focus()
            page.keyboard.press("ArrowRight")
            frame.get_by_text("sliders were moved since the fit").wait_for()


def test_without_its_token_there_is_no_page_and_no_connection():
    with explored(example_names.fit()) as address:
        bare, _, token = address.partition("?")
        port = int(bare.rstrip("/").rpartition(":")[2])
        assert status_of(port, f"/?{token}") == 200
        for query in ("/", "/?bokeh-session-id=guessed", f"/?{token[:-3]}abc"):
            assert status_of(port, query) == 403
        for origin in ("http://evil.example", f"http://localhost:{port}", "null"):
            assert status_of(port, "/ws", **UPGRADE, Origin=origin) == 403
        with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as connection:
            connection.request("GET", "/ws", headers={**UPGRADE, "Origin": bare[:-1]})
            assert connection.getresponse().status == 101
            # closed at once, with a frame that says so or without: it gave no token
            assert connection.sock.recv(1) in (b"\x88", b"")


def test_no_part_of_an_answer_waits_until_the_one_before_is_acknowledged():
    """A slider was drawn after 74 ms, of which 35 were the kernel's, and is after 40."""
    bench = dft.explore(example_names.fit(), browser=False, wait=False)
    with looked_at(bench.address) as page:
        page.get_by_text("fit: converged").wait_for()
        page.wait_for_function("() => Bokeh.documents[0].is_idle")
        (session,) = bench._server._server.get_sessions()
        (connection,) = session._subscribed_connections
        to_browser = connection._socket.ws_connection.stream.socket
        assert to_browser.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    bench.close()
    bench.wait()


UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


def status_of(port: int, query: str, **headers: str) -> int:
    """The status with which a request is answered."""
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as connection:
        connection.request("GET", query, headers=headers)
        with connection.getresponse() as answer:
            return answer.status
