# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Live page in the browser: taxels, contacts, forces and faults of one or more sensors.

A server of the standard library on this machine alone; the page takes server-sent events. It shows
the newest frame at most 60 times a second, whatever the rate of the sensor is.
"""

from __future__ import annotations

import base64
import json
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np

from tactile_ros.errors import TactileError
from tactile_ros.messages import Message
from tactile_ros.physics.magnetics import in_sensor_axes
from tactile_ros.types import Array, Closing, ContactState, Frame, FrameStatus, Layout, TaxelStatus
from tactile_ros.view.viewer import HOST, Seen, grip_scalars, sigma_of

Json = dict[str, object]

FOLDER = Path(__file__).with_name('page')
FILES = {
    '/': ('index.html', 'text/html; charset=utf-8'),
    '/view.js': ('view.js', 'text/javascript; charset=utf-8'),
    '/view.css': ('view.css', 'text/css; charset=utf-8'),
}
TEXT = 'text/plain; charset=utf-8'
HEADERS = {
    'Content-Security-Policy': "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'",
    'X-Content-Type-Options': 'nosniff',
    'Referrer-Policy': 'no-referrer',
    'Cache-Control': 'no-store',
}
PERIOD_S = 1 / 60  # between two pictures
ALIVE_S = 1.0  # between two signs of life to a page that gets no frames
MOST_PAGES = 16
RATE_S = 1.0  # time constant of the shown rate
MOST_REQUEST = 1000  # bytes of a request's body
FRAME_WORDS = {
    FrameStatus.NOT_CALIBRATED: 'not calibrated',
    FrameStatus.NO_BASELINE: 'no baseline: tare it untouched',
    FrameStatus.BAD_TAXELS: 'bad taxels',
    FrameStatus.SATURATED: 'saturated',
    FrameStatus.STRAY_FIELD: 'stray field',
    FrameStatus.OUT_OF_RANGE: 'outside of what the calibration has seen',
    FrameStatus.ABSTAINED: 'no contact explains the readings',
    FrameStatus.STALE: 'stale readings',
}
TAXEL_WORDS = {bit: bit.name.lower() for bit in TaxelStatus if bit.name}


@dataclass
class Shown:
    """Newest frame of one sensor with what is needed to draw it."""

    layout: Layout
    frame: Frame
    state: ContactState
    seen: Seen = field(default_factory=Seen)
    rest: Array = field(default_factory=lambda: np.zeros((0, 0)))
    most: float = 1.0
    frames: int = 0
    rate: float = 0.0
    arrived: float = 0.0

    def update(self, frame: Frame, state: ContactState, now: float) -> None:
        """Take a newer frame; `now` is a monotonic time (s)."""
        gap = now - self.arrived
        if self.frames and gap > 0:
            share = min(1.0, gap / RATE_S) if self.frames > 1 else 1.0
            self.rate += (1 / gap - self.rate) * share
        self.frame, self.state, self.arrived = frame, state, now
        self.rest, self.most = self.seen.scale(frame, state)
        self.frames += 1


def fault_words(state: ContactState, frame: Frame) -> list[str]:
    """Faults of a frame and how many taxels suffer each, in words."""
    words = [word for bit, word in FRAME_WORDS.items() if int(state.status) & bit]
    status = np.asarray(state.taxel_status)
    if frame.status is not None and len(status) == len(frame.status):
        status = status | frame.status
    counts = {word: int(np.count_nonzero(status & bit)) for bit, word in TAXEL_WORDS.items()}
    return words + [
        f'{count} taxel{"s" * (count > 1)} {word}' for word, count in counts.items() if count
    ]


def layout_json(layout: Layout) -> Json:
    """Places and channels of a sensor, which the page needs once."""
    return {
        'positions': np.round(layout.positions, 7).tolist(), 'channels': list(layout.channels),
        'unit': layout.unit, 'sensor': layout.sensor,
    }  # fmt: skip


def frame_json(shown: Shown) -> Json:
    """Numbers of one frame as the page draws them (SI); null where they are not estimated."""
    state, layout = shown.state, shown.layout
    change = shown.frame.values - shown.rest
    change = in_sensor_axes(change, layout.rotations) if change.shape[1] == 3 else change
    status = state.taxel_status
    return {
        't': (shown.frame.stamp_ns or 0) * 1e-9,
        'change': base64.b64encode(change.astype('<f4').tobytes()).decode(),
        'most': shown.most,
        'bad': np.flatnonzero(np.isnan(change).any(axis=1) | (status != 0)).tolist(),
        'force': _numbers(state.force),
        'sigma': _numbers(sigma_of(state.force_cov)),
        'contacts': _contacts(state),
        'ellipse': _ellipse(state.position_cov[:2, :2]),
        'in_contact': int(state.in_contact), 'slip': int(state.slip),
        'label': int(state.label), 'cell': int(state.cell),
        'probability': _numbers(np.atleast_1d(state.label_probability))[0],
        'yaw': _numbers(np.atleast_1d(state.yaw))[0],
        'valid': bool(state.valid), 'faults': fault_words(state, shown.frame),
        'rate': round(shown.rate, 1), 'lost': shown.frame.dropped, 'frames': shown.frames,
    }  # fmt: skip


def _numbers(values: Array) -> list[float | None]:
    """Numbers with six digits, None for those that are not finite."""
    return [float(f'{x:.6g}') if np.isfinite(x) else None for x in values.tolist()]


def _contacts(state: ContactState) -> list[list[float | None]]:
    """Place and force of every patch, or of the one contact: x, y, fx, fy, fz."""
    patches = [(one.position, one.force) for one in state.contacts]
    found = patches or [(state.position, state.force)]
    return [
        _numbers(np.concatenate([place[:2], force]))
        for place, force in found
        if np.isfinite(place[:2]).all()
    ]


def _ellipse(cov: Array) -> list[float] | None:
    """Two-sigma half axes (m) and turn (rad) of a place's covariance (2, 2)."""
    if not np.isfinite(cov).all():
        return None
    variances, axes = np.linalg.eigh(cov)
    half = 2 * np.sqrt(np.maximum(variances, 0.0))
    return [float(half[1]), float(half[0]), float(np.arctan2(axes[1, 1], axes[0, 1]))]


class PageServer(Closing):
    """Serve the page and what it shows on a port of this machine; 0: any free one.

    With `control` pages may ask for a tare, which calls `tare` (name of a sensor -> one sentence)
    once it is set. Raises TactileError, which names the option of the port, if it is taken.
    """

    def __init__(self, port: int, *, control: bool = False, option: str = '--port') -> None:
        self.control = control
        self.tare: Callable[[str], str] | None = None
        self._shown: dict[str, Shown] = {}
        self._grips: dict[str, Json] = {}
        self._guide: Json | None = None
        self._news = threading.Condition()
        self._version, self._layouts = 0, 0
        self._encoded = (-1, b'')
        self.pages = 0  # that look
        self.closed = False
        try:
            self._server = Server((HOST, port), Handler)
        except (OSError, OverflowError) as error:
            why = getattr(error, 'strerror', error)
            msg = f'port {port} cannot be served: {why}; {option} 0 takes any free one'
            raise TactileError(msg) from error
        self._server.page = self
        self.port: int = self._server.server_address[1]
        self.address = f'http://{HOST}:{self.port}/'
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the server and tell the pages."""
        with self._news:
            self.closed = True
            self._news.notify_all()
        self._server.shutdown()
        self._server.server_close()

    def show(self, name: str, layout: Layout, frame: Frame, state: ContactState) -> None:
        """Show one frame of the sensor `name` ('' where there is but one)."""
        with self._news:
            shown = self._shown.get(name)
            if shown is None or shown.layout is not layout:
                shown = self._shown[name] = Shown(layout, frame, state)
                self._layouts += 1
            shown.update(frame, state, time.monotonic())
            self._version += 1
            self._news.notify_all()

    def grip(self, name: str, grip: Message, stamp_ns: int) -> None:
        """Show the state of a grip."""
        with self._news:
            self._grips[name] = {'t': stamp_ns * 1e-9, **grip_scalars(grip)}
            self._version += 1
            self._news.notify_all()

    def guide(self, stated: Json | None) -> None:
        """Show targets, the next one, and what to do."""
        with self._news:
            self._guide = stated
            self._version += 1
            self._news.notify_all()

    def wait_for_page(self, timeout: float | None = None) -> bool:
        """Wait until a page looks; False after `timeout` (s)."""
        with self._news:
            return self._news.wait_for(lambda: self.pages > 0 or self.closed, timeout)

    def has(self, name: str) -> bool:
        """A sensor of that name is shown."""
        return name in self._shown

    def newest(self) -> tuple[int, bytes]:
        """Number and event of what is newest, encoded once for all pages."""
        with self._news:
            if self._encoded[0] != self._version:
                sensors = {name: frame_json(shown) for name, shown in self._shown.items()}
                data = {'sensors': sensors, 'grips': self._grips, 'guide': self._guide}
                self._encoded = (self._version, event('frames', data))
            return self._encoded

    def _places(self) -> tuple[int, bytes]:
        """Number and event of the sensors that there are."""
        with self._news:
            sensors = {name: layout_json(s.layout) for name, s in self._shown.items()}
            return self._layouts, event('layouts', {'sensors': sensors, 'control': self.control})

    def stream(self, write: Callable[[bytes], object]) -> None:
        """Write events to one page until it goes or the server closes.

        Raises OSError where the page has gone.
        """
        with self._news:
            self.pages += 1
            self._news.notify_all()
        try:
            layouts = version = -1
            while not self.closed:
                begun = time.monotonic()
                if layouts != self._layouts:
                    layouts, places = self._places()
                    write(places)
                if version != self._version:
                    version, frames = self.newest()
                    write(frames)
                else:
                    write(b': alive\n\n')
                time.sleep(max(0.0, begun + PERIOD_S - time.monotonic()))
                with self._news:
                    if version == self._version and not self.closed:
                        self._news.wait(ALIVE_S)
            write(event('end', {}))
        finally:
            with self._news:
                self.pages -= 1


class Server(ThreadingHTTPServer):
    """Server of one page's requests."""

    daemon_threads, block_on_close = True, False
    page: PageServer


class Handler(BaseHTTPRequestHandler):
    """Answers of the server: page, its files, events, a tare."""

    server: Server
    protocol_version = 'HTTP/1.1'
    timeout = 10  # s, of a page that neither asks nor takes

    def log_message(self, *_: object) -> None:
        """Say nothing."""

    def do_GET(self) -> None:
        """Page, its files, what is newest as JSON, or the stream of events."""
        page, path = self.server.page, urlsplit(self.path).path
        if self._refused():
            return
        if path in FILES:
            name, kind = FILES[path]
            self._answer(kind, (FOLDER / name).read_bytes())
        elif path == '/state.json':
            self._answer('application/json', page.newest()[1].split(b'data: ', 1)[1].strip())
        elif path == '/events' and page.pages < MOST_PAGES:
            self.close_connection = True
            self._begin(HTTPStatus.OK, 'text/event-stream')
            with suppress(OSError):  # the page was closed
                page.stream(self.wfile.write)
        else:
            self._answer(TEXT, b'not found\n', HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:
        """Tare of one sensor, where pages may do more than look."""
        page = self.server.page
        if self._refused():
            return
        length = self.headers.get('Content-Length', '')
        small = length.isdigit() and int(length) <= MOST_REQUEST
        asked = self.rfile.read(int(length)).decode(errors='replace') if small else ''
        names = parse_qs(asked, keep_blank_values=True).get('name', [])
        if urlsplit(self.path).path != '/tare' or not page.control:
            self._answer(TEXT, b'--control allows it\n', HTTPStatus.FORBIDDEN)
        elif len(names) != 1 or not page.has(names[0]):
            self._answer(TEXT, b'no such sensor\n', HTTPStatus.BAD_REQUEST)
        else:
            answer = page.tare(names[0]) if page.tare else 'a recording cannot be tared'
            self._answer(TEXT, answer.encode())

    def _refused(self) -> bool:
        """Requests under another name are refused, or any site could ask through DNS."""
        names = [f'{name}:{self.server.page.port}' for name in (HOST, 'localhost')]
        origins = (None, *(f'http://{name}' for name in names))
        if self.headers.get('Host', '') in names and self.headers.get('Origin') in origins:
            return False
        self._answer(TEXT, b'only from this machine\n', HTTPStatus.FORBIDDEN)
        return True

    def _begin(self, status: HTTPStatus, kind: str, length: int | None = None) -> None:
        self.send_response(status)
        own = {'Content-Type': kind}
        own |= {} if length is None else {'Content-Length': str(length)}
        for name, value in {**HEADERS, **own}.items():
            self.send_header(name, value)
        self.end_headers()

    def _answer(self, kind: str, body: bytes, status: HTTPStatus = HTTPStatus.OK) -> None:
        self._begin(status, kind, len(body))
        self.wfile.write(body)


def event(kind: str, data: Mapping[str, object]) -> bytes:
    """One server-sent event."""
    return f'event: {kind}\ndata: {json.dumps(data, separators=(",", ":"))}\n\n'.encode()
