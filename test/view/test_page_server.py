# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Live page: what its server says, whom it refuses, and what a browser draws."""

import base64
import json
import re
import shutil
import subprocess
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.errors import TactileError
from tactile_ros.types import ContactState, Frame, FrameStatus, Layout, TaxelStatus
from tactile_ros.view import page_server
from tactile_ros.view.page_server import HOST, Handler, PageServer

LAYOUT = Layout(
    np.array([[0.0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0.01, 0.01, 0]]), ('Bx', 'By', 'Bz'), 'T',
    sensor='reskin_board',
)  # fmt: skip
BROWSER = shutil.which('chromium') or shutil.which('chromium-browser')


def frame(number: int) -> Frame:
    values = np.zeros((4, 3))
    values[2] = 1e-4 * number * np.array([1.0, 0.5, -2.0])
    return Frame(1_000_000_000 + 10_000_000 * number, number, values, dropped=3)


def state(contact: int = 1) -> ContactState:
    known = {
        'force': np.array([[0.1, -0.2, 1.5]]),
        'force_cov': np.diag([1e-4, 1e-4, 4e-4])[None],
        'position': np.array([[0.004, 0.006, np.nan]]),
        'position_cov': np.diag([1e-6, 4e-6, np.nan])[None],
        'in_contact': np.array([contact], np.int8),
        'label': np.array([1]), 'label_probability': np.array([0.9]),
        'status': np.array([int(FrameStatus.STRAY_FIELD | FrameStatus.BAD_TAXELS)]),
        'taxel_status': np.array([[0, TaxelStatus.STUCK, TaxelStatus.STUCK, 0]], np.uint8),
    }  # fmt: skip
    return ContactState.assemble(4, known)


@pytest.fixture
def page() -> Iterator[PageServer]:
    with PageServer(0, control=True) as server:
        server.show('thumb', LAYOUT, frame(0), state(0))
        server.show('thumb', LAYOUT, frame(5), state())
        yield server


def ask(page: PageServer, path: str, body: bytes | None = None, **headers: str) -> tuple[int, str]:
    """Status and text of an answer."""
    request = urllib.request.Request(page.address + path, body, headers)
    try:
        with urllib.request.urlopen(request, timeout=120) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def test_page_server_states_the_newest_frame(page: PageServer) -> None:
    status, text = ask(page, 'state.json')
    told = json.loads(text)['sensors']['thumb']
    change = np.frombuffer(base64.b64decode(told['change']), '<f4').reshape(4, 3)
    assert status == 200
    assert np.allclose(change, frame(5).values)
    assert told['force'] == [0.1, -0.2, 1.5]
    assert told['sigma'] == [0.01, 0.01, 0.02]
    assert told['contacts'] == [[0.004, 0.006, 0.1, -0.2, 1.5]]
    assert np.allclose(told['ellipse'][:2], [4e-3, 2e-3])
    assert told['bad'] == [1, 2]
    assert (told['frames'], told['lost'], told['label']) == (2, 3, 1)
    assert told['faults'] == ['bad taxels', 'stray field', '2 taxels stuck']


def test_page_server_streams_layouts_and_then_frames(page: PageServer) -> None:
    heard: list[bytes] = []

    def write(data: bytes) -> None:
        heard.append(data)
        if len(heard) == 2:
            page.show('index', LAYOUT, frame(0), state(0))
        if heard[-1].count(b'"index"'):
            raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        page.stream(write)
    assert heard[0].startswith(b'event: layouts\n')
    assert heard[1].startswith(b'event: frames\n')
    assert page.pages == 0


def test_page_server_waits_for_a_page_and_ends_it(page: PageServer) -> None:
    assert not page.wait_for_page(0.01)
    heard: list[bytes] = []
    thread = threading.Thread(target=page.stream, args=(heard.append,))
    thread.start()
    assert page.wait_for_page(120)
    page.close()
    thread.join(120)
    assert heard[-1].startswith(b'event: end')


def test_page_server_answers_this_machine_alone(page: PageServer) -> None:
    assert page.address.startswith(f'http://{HOST}:')
    assert ask(page, '')[0] == 200
    assert ask(page, '', Host='evil.example')[0] == 403
    assert ask(page, '', Origin='http://evil.example')[0] == 403


def test_page_server_tares_where_it_may(page: PageServer) -> None:
    assert ask(page, 'tare', b'name=thumb') == (200, 'a recording cannot be tared')
    page.tare = 'tared {}'.format
    assert ask(page, 'tare', b'name=thumb') == (200, 'tared thumb')
    assert ask(page, 'tare', b'name=none')[0] == 400
    page.control = False
    assert ask(page, 'tare', b'name=thumb')[0] == 403
    assert ask(page, '../page_server.py')[0] == 404
    with pytest.raises(TactileError, match=rf'port {page.port} cannot be served: .*--port 0'):
        PageServer(page.port)
    with pytest.raises(TactileError, match='--page 0 takes any free one'):
        PageServer(page.port, option='--page')


@pytest.mark.skipif(BROWSER is None, reason='chromium is not installed')
def test_page_draws_a_sensor_in_a_browser(
    page: PageServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn, answer = threading.Event(), Handler.do_GET

    def answer_slowly(self: Handler) -> None:
        """Keep the browser loading a picture until it has heard two events and drawn."""
        if self.path == '/slow.png':
            page.wait_for_page(60)
            for number in range(6, 20):
                page.show('thumb', LAYOUT, frame(number), state())
                drawn.wait(0.1)
        answer(self)

    folder = shutil.copytree(page_server.FOLDER, tmp_path / 'page')
    with (folder / 'index.html').open('a') as index:
        index.write('<img src="slow.png" alt="">')
    monkeypatch.setattr(page_server, 'FOLDER', folder)
    monkeypatch.setattr(Handler, 'do_GET', answer_slowly)
    words = [
        str(BROWSER), '--headless', '--no-sandbox', '--disable-gpu', '--no-first-run',
        '--disable-background-networking', '--disable-component-update', '--disable-sync',
        f'--user-data-dir={tmp_path}', '--dump-dom', page.address,
    ]  # fmt: skip
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=True)
    text = re.sub(r'<[^>]+>', ' ', done.stdout)
    for said in ('thumb (reskin_board)', 'contact', 'class 1 (90 %)', '2 taxels stuck'):
        assert said in text
