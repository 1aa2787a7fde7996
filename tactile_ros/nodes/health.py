"""How a sensor is, from what its reader saw in the last second: the content of /diagnostics."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from tactile_ros.types import TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tactile_ros.nodes.reader import Reading
    from tactile_ros.types import Frame

TAXELS = {
    'saturated taxels': TaxelStatus.SATURATED,
    'wrapped taxels': TaxelStatus.WRAPPED,
    'stuck taxels': TaxelStatus.STUCK,
    'taxels in error': TaxelStatus.ERROR,
    'stale taxels': TaxelStatus.STALE,
}
# always told, also by drivers whose protocol does not have them
EXPECTED = ('dropped', 'crc_errors', 'framing_errors', 'resets', 'reconnects')
# growth of these alone is no trouble
HARMLESS = ('frames', 'not_ready', 'saturated', 'stale', 'repeated', 'missing', 'other_kind')
NOT_MEASURED = 'not measured'
SLOW, JITTERY = 0.8, 0.5


@dataclass(frozen=True)
class Pace:
    """How regularly frames came.

    Attributes
    ----------
    rate_hz : float
        Frames per second of their own stamps; NaN: fewer than two came.
    jitter_s : float
        Standard deviation of the time from frame to frame (s); NaN: fewer than three came.
    """

    rate_hz: float
    jitter_s: float


def pace(stamps_ns: Sequence[int]) -> Pace:
    """Rate and jitter of acquisition times (ns)."""
    gaps = np.diff(np.asarray(stamps_ns, np.int64)) * 1e-9
    gaps = gaps[gaps > 0]
    if not len(gaps):
        return Pace(float('nan'), float('nan'))
    return Pace(1.0 / float(gaps.mean()), float(gaps.std()) if len(gaps) > 1 else float('nan'))


@dataclass
class Health:
    """Judges a sensor once a second.

    Attributes
    ----------
    nominal_hz : float
        Rate of the layout; NaN: unknown.
    name, hardware_id : str
        Of the status.
    """

    nominal_hz: float
    name: str = 'sensor'
    hardware_id: str = ''
    _frames: int = field(default=0, init=False)
    _before: dict[str, int] = field(default_factory=dict, init=False)

    def judge(
        self,
        reading: Reading,
        counters: Mapping[str, int],
        is_open: bool,
        more: Mapping[str, object] | None = None,
    ) -> tuple[bytes, str, dict[str, object]]:
        """Level, sentence and values for what came since the last call.

        Parameters
        ----------
        reading : Reading
            Of the reader; its stamps and marks are taken.
        counters : mapping
            Of the device.
        is_open : bool
            Whether the device could be opened.
        more : mapping or None
            Further values to tell.

        Returns
        -------
        level : bytes
            Of DiagnosticStatus. OK; WARN: frames come, but something needs attention; ERROR: none
            come; STALE: none are read, since nobody listens yet.
        message : str
            Why, in a sentence.
        values : dict
            What is known, by name.
        """
        count, self._frames = reading.frames - self._frames, reading.frames
        found, marks = pace(reading.take_stamps()), reading.take_marks()
        grown = self._grown({**counters, 'overruns': reading.overruns})
        level, message = DiagnosticStatus.OK, f'{count} frames in the last second'
        if reading.waiting and not reading.frames:
            level, message = DiagnosticStatus.STALE, 'not read before all listeners are there'
        elif not count or not is_open:
            level, message = DiagnosticStatus.ERROR, reading.sentence or 'no frame came'
        elif reasons := [*self._slow(found), *_marked(marks), *grown, reading.sentence]:
            told = [reason for reason in reasons if reason]
            level = DiagnosticStatus.WARN if told else level
            message = '; '.join([message, *told])
        values = {
            'connection': _connection(level, is_open),
            'rate (Hz)': found.rate_hz,
            'nominal rate (Hz)': self.nominal_hz,
            'jitter (ms)': 1e3 * found.jitter_s,
            'frames': reading.frames,
            'queue overruns': reading.overruns,
            'failures': reading.failures,
            **dict.fromkeys(EXPECTED, 'not in this protocol'),
            **counters,
            **{name: reading.taxels(bit) for name, bit in TAXELS.items()},
            **temperatures(reading.last),
            **(more or {}),
        }
        return level, message, values

    def _grown(self, counters: Mapping[str, int]) -> list[str]:
        """What was counted since the last call, in words."""
        before, self._before = self._before, dict(counters)
        more = {n: v - before.get(n, 0) for n, v in counters.items() if n not in HARMLESS}
        return [f'{count} {name.replace("_", " ")}' for name, count in more.items() if count > 0]

    def _slow(self, found: Pace) -> list[str]:
        """What is wrong with rate and jitter."""
        if found.rate_hz < SLOW * self.nominal_hz:
            return [f'{found.rate_hz:.3g} Hz instead of {self.nominal_hz:g} Hz']
        if found.jitter_s * self.nominal_hz > JITTERY:
            return [f'frames come irregularly: jitter {1e3 * found.jitter_s:.2g} ms']
        return []


def _marked(marks: TaxelStatus) -> list[str]:
    """Names of the taxel states that came up."""
    return [name for name, bit in TAXELS.items() if marks & bit]


def _connection(level: bytes, is_open: bool) -> str:
    """State of the connection in a word or two."""
    if not is_open:
        return 'not open'
    named = {DiagnosticStatus.ERROR: 'silent', DiagnosticStatus.STALE: 'open, not read yet'}
    return named.get(level, 'streaming')


def temperatures(frame: Frame | None) -> dict[str, object]:
    """Coldest and hottest chip of a frame (degrees Celsius)."""
    warm = None if frame is None else frame.temperature_c
    names = ('lowest temperature (C)', 'highest temperature (C)')
    if warm is None or not np.isfinite(warm).any():
        return dict.fromkeys(names, NOT_MEASURED)
    return dict(zip(names, (float(np.nanmin(warm)), float(np.nanmax(warm))), strict=True))
