"""Bokeh's server, for one page on this machine alone.

It listens on 127.0.0.1. Its address holds a token, signed with a key that this process has drawn:
no other page of the browser and no other user of the machine knows it, and without it there is no
page and no connection. Connections are accepted from this very address alone.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import socket
import threading
from collections.abc import Callable
from contextlib import suppress

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.core.validation import silence
from bokeh.core.validation.warnings import EMPTY_LAYOUT
from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.server.server import Server
from bokeh.settings import settings
from bokeh.util.token import generate_session_id

from diffthrust._support.errors import InputError

_HOST = "127.0.0.1"
"""Not "localhost", which may be another address: connections to it were refused (bokeh#6023)."""
_HOUR = 3_600_000
"""A page that was closed so long [ms] is not coming back: it was saved, or is not wanted."""


class PageServer:
    """A server with one page, in a thread of its own, in which it is filled and left.

    It ends ``patience`` milliseconds after the page was closed. Port 0 is any that is free.
    """

    address: str  # of the page, with its token

    def __init__(
        self,
        fill: Callable[[Document], object],
        leave: Callable[[], object] = lambda: None,
        *,
        port: int = 0,
        patience: int = _HOUR,
    ) -> None:
        self._fill, self._leave, self._patience = fill, leave, patience
        self._ready, self.ended = threading.Event(), threading.Event()
        _check_free(port)
        threading.Thread(target=self._run, args=(port,), daemon=True).start()
        self._ready.wait()

    def _run(self, port: int) -> None:
        settings.log_level = "error"  # of the browser's console
        # a page that is closed while something is fitted is no reason for a warning a second
        logging.getLogger("bokeh.server").setLevel(logging.ERROR)
        silence(EMPTY_LAYOUT)  # a list that is empty for now is no mistake
        loop = asyncio.new_event_loop()
        asyncio.set_event_loop(loop)
        key = secrets.token_bytes(32)
        self._server = Server(
            {"/": Application(FunctionHandler(self._filled))},
            address=_HOST,
            port=port,
            # replaced below by the port that was found
            allow_websocket_origin=[f"{_HOST}:{port}"],
            secret_key=key,
            sign_sessions=True,
            generate_session_ids=False,
            use_index=False,
            unused_session_lifetime_milliseconds=self._patience,
            check_unused_sessions_milliseconds=min(17_000, self._patience),
            http_server_kwargs={"max_body_size": 1_000_000},
        )
        listening = self._server.port
        self._server._tornado._websocket_origins = {f"{_HOST}:{listening}"}
        token = generate_session_id(key, signed=True)
        self.address = f"http://{_HOST}:{listening}/?bokeh-session-id={token}"
        self._server.start()
        self._server.io_loop.add_callback(self._ready.set)
        self._server.io_loop.start()
        self._leave()
        loop.run_until_complete(self._server._http.close_all_connections())
        loop.close()
        self.ended.set()

    def _filled(self, document: Document) -> None:
        document.on_session_destroyed(lambda _: self.close())
        document.on_event(DocumentReady, lambda _: self._send_at_once())
        self._fill(document)

    def _send_at_once(self) -> None:
        """Let no part of an answer wait until the browser has acknowledged the one before.

        An answer goes out in a dozen small parts, and the second was held back for some 35 of the
        74 ms that a slider took to be drawn. The names are not public (Bokeh 3.9.2): without them a
        page is as slow as it was.
        """
        with suppress(AttributeError):
            for session in self._server.get_sessions():
                for connection in session._subscribed_connections:
                    connection._socket.set_nodelay(True)

    def close(self) -> None:
        """End the server; its address leads nowhere afterwards."""
        if not self.ended.is_set():
            self._server.io_loop.add_callback(self._stop)

    def _stop(self) -> None:
        self._server.stop()
        self._server.io_loop.stop()


def _check_free(port: int) -> None:
    """Raise `InputError` where one cannot listen: Bokeh would leave a socket open."""
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((_HOST, port))
        except OSError as error:
            raise InputError(
                f"port {port}: the workbench cannot listen there ({error.strerror}).",
                "Name another port, or none for any that is free.",
            ) from None
