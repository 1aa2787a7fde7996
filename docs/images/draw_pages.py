# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Pictures of pages by Chromium: python docs/images/draw_pages.py, after `make demo`."""

from __future__ import annotations

import base64
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ADDRESS = 'http://127.0.0.1:8799/'
REPORT = ROOT / 'out/demo/reskin_board/report.html'
# width, height (pixels), page; its words, seconds after them, words when it is drawn; command
PICTURES = {
    'demo.png': (1240, 2500, REPORT.as_uri(), 'place', 0.5, 'place', ''),
    'images/view_page.png': (
        500, 680, ADDRESS, r'\b(untouched|contact)\n(?!.*calibrating)', 10.0, r'\bcontact\n',
        'view --sensor gradiometer --no-open --port 8799',
    ),
    'images/guided_page.png': (
        700, 617, ADDRESS, '7 of 16', 0.0, '7 of 16: hold',
        'calibrate --live --sensor reskin_board --presses 16 --page 8799 -o {folder}/c.npz',
    ),
}  # fmt: skip


class Browser:
    """Chromium that takes commands of the DevTools protocol through a pipe."""

    def __init__(self, folder: str) -> None:
        (here, self._out), (self._in, there) = os.pipe(), os.pipe()
        words = (
            'exec chromium --headless --no-sandbox --disable-gpu --no-first-run --hide-scrollbars '
            f'--user-data-dir={folder} --remote-debugging-pipe 3<&{here} 4>&{there}'
        )
        self._process = subprocess.Popen(
            ['bash', '-c', words], pass_fds=(here, there), stderr=subprocess.DEVNULL
        )
        self._number, self._session = 0, {}

    def open(self, address: str, width: int, height: int) -> None:
        """Open a page of a size."""
        target = self.ask('Target.createTarget', url='about:blank')
        one = self.ask('Target.attachToTarget', targetId=target['targetId'], flatten=True)
        self._session = {'sessionId': one['sessionId']}
        self.ask('Emulation.setDeviceMetricsOverride', width=width, height=height,
                 deviceScaleFactor=1, mobile=False)  # fmt: skip
        self.ask('Page.navigate', url=address)

    def ask(self, method: str, **params: object) -> dict:
        """Result of a command."""
        self._number += 1
        command = {'id': self._number, 'method': method, 'params': params, **self._session}
        os.write(self._out, json.dumps(command).encode() + b'\0')
        while True:
            said = b''
            while not said.endswith(b'\0'):
                said += os.read(self._in, 1)
            answer = json.loads(said[:-1])
            if answer.get('id') == self._number:
                return answer['result']

    def wait_for(self, words: str) -> None:
        """Wait until the page has words (a pattern)."""
        text = ''
        while not re.search(words, text, re.DOTALL):
            time.sleep(0.1)
            found = self.ask('Runtime.evaluate', expression='document.body.innerText')
            text = found['result'].get('value', '')

    def close(self) -> None:
        """End it."""
        self._session = {}
        self.ask('Browser.close')
        self._process.wait()


def draw(name: str) -> None:
    """Write one picture."""
    width, height, page, first, seconds, last, words = PICTURES[name]
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, '-m', 'tactile_ros', *words.format(folder=folder).split()]
        running = subprocess.Popen(command, cwd=ROOT) if words else None
        browser = Browser(f'{folder}/browser')
        try:
            time.sleep(5.0 if running else 0.0)
            browser.open(page, width, height)
            browser.wait_for(first)
            time.sleep(seconds)
            browser.wait_for(last)
            time.sleep(0.3)
            shot = browser.ask('Page.captureScreenshot')
            (ROOT / 'docs' / name).write_bytes(base64.b64decode(shot['data']))
        finally:
            browser.close()
            if running:
                running.terminate()
                running.wait()


if __name__ == '__main__':
    for picture in sys.argv[1:] or PICTURES:
        draw(picture)
