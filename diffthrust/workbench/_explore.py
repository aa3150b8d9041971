"""`explore`: the workbench in the browser, from a script, a notebook or the command line."""

from __future__ import annotations

import sys
import webbrowser
from collections.abc import Sequence
from html import escape
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from diffthrust._support.extras import extra
from diffthrust.diagnosis._result import Diagnosis
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.specs._scripts import trusted_folders
from diffthrust.specs._spec import Spec
from diffthrust.workbench._session import Session
from diffthrust.workbench._source import opened

if TYPE_CHECKING:
    from diffthrust.workbench._server import PageServer

_FRAME = 900
"""Display: height of the page in a notebook [px]."""


class Workbench:
    """A workbench that is open.

    Args:
        session: what it shows.
        server: its page.

    Example:
        >>> bench = dft.explore(fit, browser=False, wait=False)
        >>> bench.address.startswith("http://127.0.0.1:")
        True
        >>> bench.close()
        >>> bench.wait()  # until it has ended
    """

    def __init__(self, session: Session, server: PageServer) -> None:
        self.session: Session = session
        self._server = server

    @property
    def address(self) -> str:
        """Where the page is, on this machine alone; the token in it is its key."""
        return self._server.address

    def wait(self) -> None:
        """Wait until the page was closed for an hour."""
        while not self._server.ended.wait(0.5):  # short enough for Ctrl-C on every system
            pass

    def close(self) -> None:
        """End it."""
        self._server.close()

    def __repr__(self) -> str:
        return f"Workbench({self.session.source.name})"

    def _repr_html_(self) -> str:
        address = escape(self.address)
        return f'<iframe src="{address}" width="100%" height="{_FRAME}"></iframe>'


def explore(
    what: str | PathLike[str] | Spec | Fit | Diagnosis | Model,
    logs: Log | Sequence[Log] = (),
    *,
    holdout: Log | Sequence[Log] = (),
    trust: Path | str | Sequence[Path | str] = (),
    browser: bool | None = None,
    wait: bool | None = None,
    port: int = 0,
) -> Workbench:
    """Open the workbench: look at logs, drag, add what is missing, and watch the error fall.

    A page in the browser, on this machine alone. It needs the extra ``workbench``.

    Args:
        what: a spec file, a log, a folder of either, or what ``save`` has written; or a fit, a
            diagnosis, a spec or a model.
        logs: training logs, for a model, or for a fit that does not keep its own.
        holdout: unseen logs, likewise.
        trust: folders whose scripts a spec may run; here its own is not trusted by itself.
        browser: open the browser; not in a notebook, which shows the page itself.
        wait: come back when the page was closed for an hour; in a notebook at once.
        port: to listen on; 0 for any that is free.

    Returns:
        The `Workbench`.

    Raises:
        InputError: it cannot be opened, names a script that is not trusted, or Bokeh is missing.

    Example:
        >>> bench = dft.explore("fit.toml", browser=False, wait=False)
        >>> bench.close()
    """
    with extra("workbench", "The workbench"):
        from diffthrust.workbench._page import Page
        from diffthrust.workbench._server import PageServer

    session = Session(opened(what, logs, holdout, trusted_folders(trust)))
    comparison = session.task.compare()
    notebook = "ipykernel" in sys.modules
    _ = session.addable  # before the page asks for it
    pages: list[Page] = []
    server = PageServer(
        lambda document: pages.append(Page(document, session, comparison)),
        lambda: [page.close() for page in pages],
        port=port,
    )
    bench = Workbench(session, server)
    if browser or (browser is None and not notebook):
        webbrowser.open(bench.address)
    if wait or (wait is None and not notebook):
        bench.wait()
    return bench
