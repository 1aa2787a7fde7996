"""Frames, states and grip to Foxglove: a live server, a file, or both.

Foxglove and its free sibling Lichtblick connect to the server; nothing is drawn here.
"""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import MissingPackageError, TactileError
from tactile_ros.types import Closing
from tactile_ros.view import drawing
from tactile_ros.view.scalars import grip_scalars, json_schema, state_scalars
from tactile_ros.view.scene import scene_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from foxglove.websocket import WebSocketServer

    from tactile_ros.types import Array, ContactState, Frame, Layout
    from tactile_ros.view.scalars import GripMessage

HOST = '127.0.0.1'  # this machine alone
FADE = 0.999  # of the full colour, from one frame to the next
LEAST = 1e-12  # change that has the full colour at least (unit of the layout)


class Seen:
    """The untouched readings and the largest change of one sensor, as they were seen."""

    def __init__(self) -> None:
        self._rest: Array | None = None
        self._most = LEAST

    def scale(self, frame: Frame, state: ContactState) -> tuple[Array, float]:
        """Untouched readings (t, c), and the change that has the full colour."""
        values = frame.values
        if self._rest is None:
            self._rest = np.array(values)
        elif state.in_contact == 0:
            self._rest = np.where(np.isfinite(values), values, self._rest)
        change = np.linalg.norm(values - self._rest, axis=1)
        largest = float(np.nan_to_num(change).max(initial=0.0))
        self._most = max(FADE * self._most, largest, LEAST)
        return self._rest, self._most


class Viewer(Closing):
    """Show what one or more sensors say.

    Parameters
    ----------
    port : int or None
        Of the server; 0: any free one; None: no server.
    file : Path or None
        MCAP file that Foxglove opens later.

    Raises
    ------
    MissingPackageError
        If foxglove-sdk is not installed.
    TactileError
        If the port is taken or the file exists.
    """

    def __init__(self, port: int | None, file: Path | None = None) -> None:
        try:
            import foxglove
            from foxglove import channels
        except ImportError as error:
            msg = 'tactile view needs foxglove-sdk: pip install foxglove-sdk'
            raise MissingPackageError(msg) from error
        self._foxglove, self._kinds = foxglove, channels
        self._held = ExitStack()
        self._context = foxglove.Context()
        self._channels: dict[str, Callable[..., None]] = {}
        self._seen: dict[str, Seen] = {}
        try:
            if file is not None:
                self._held.enter_context(foxglove.open_mcap(str(file), context=self._context))
            self._server = None if port is None else self._serve(port)
        except (OSError, RuntimeError) as error:
            self._held.close()
            msg = f'nothing can be shown at port {port} or in {file}: {error}'
            raise TactileError(msg) from error

    def _serve(self, port: int) -> WebSocketServer:
        server = self._foxglove.start_server(
            name='tactile_ros', host=HOST, port=port, context=self._context
        )
        self._held.callback(server.stop)
        return server

    def close(self) -> None:
        """Close the server and the file."""
        self._held.close()

    @property
    def address(self) -> str:
        """Where viewers connect; empty without a server."""
        return '' if self._server is None else f'ws://{HOST}:{self._server.port}'

    def show(self, name: str, layout: Layout, frame: Frame, state: ContactState) -> None:
        """Show one frame of the sensor `name` ('' where there is but one)."""
        seen = self._seen.setdefault(name, Seen())
        rest, most = seen.scale(frame, state)
        stamp = frame.stamp_ns or 0
        cloud = drawing.cloud(layout, frame.values - rest, most, stamp)
        update = drawing.update(scene_of(layout, frame, rest, state, most), layout.frame_id, stamp)
        self._log('PointCloud', f'{name}/taxels', cloud, stamp)
        self._log('SceneUpdate', f'{name}/scene', update, stamp)
        self._log('', f'{name}/state', state_scalars(state), stamp)

    def grip(self, name: str, grip: GripMessage, stamp_ns: int) -> None:
        """Show the state of a grip."""
        self._log('', f'{name}/grip', grip_scalars(grip), stamp_ns)

    def _log(self, kind: str, topic: str, message: object, stamp_ns: int) -> None:
        """One message on its channel, which is made when it is first needed."""
        topic = topic if topic.startswith('/') else f'/{topic}'
        if topic not in self._channels:
            self._channels[topic] = self._channel(kind, topic, message)
        self._channels[topic](message, log_time=stamp_ns or None)

    def _channel(self, kind: str, topic: str, message: object) -> Callable[..., None]:
        """Where to log messages of one of Foxglove's kinds, or json."""
        if kind:
            made = getattr(self._kinds, f'{kind}Channel')(topic, context=self._context)
        else:
            schema = json_schema(message if isinstance(message, dict) else {})
            made = self._foxglove.Channel(topic, schema=schema, context=self._context)
        log: Callable[..., None] = made.log
        return log
