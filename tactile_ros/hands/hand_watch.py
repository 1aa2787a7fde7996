"""Whether joint states still tell of the hand that is commanded: frozen, or moved by others.

A driver that hangs may go on stamping its last posture; one that was switched off and on again
comes back in another. Neither is silent.
"""

from __future__ import annotations

from math import inf, isnan, nan
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import Array


class HandWatch:
    """Compare joint states with commands.

    Parameters
    ----------
    joints : sequence of str, length j
        Names, for sentences.
    slack : ndarray, shape (j,)
        Motion that tells nothing.
    patience_s : float
        A hand has moved so long after a command (s), or never will.

    Notes
    -----
    Frozen are joints that are all the same to the last bit while a command went further than the
    slack: encoders of a hand that is blocked flicker, and of many joints one gives way.
    """

    def __init__(self, joints: Sequence[str], slack: Array, patience_s: float) -> None:
        self._joints, self._slack, self._patience_s = list(joints), slack, patience_s
        self._still = np.full(len(self._joints), nan)
        self.forget()

    def forget(self) -> None:
        """Nothing was sent to this hand."""
        self._sent = self._before = self._apart = np.full(len(self._joints), nan)
        self._led_s = inf

    def hear(self, measured: Array) -> None:
        """Take in joint positions (j,)."""
        if not np.array_equal(self._still, measured):
            self._still, self._before, self._led_s = measured.copy(), self._sent, inf

    def send(self, command: Array, now_s: float) -> None:
        """Take in a command (j,) that is sent at a time (s)."""
        if isnan(self._before[0]):
            self._before = command
        self._sent = command
        self._apart = np.abs(command - self._still)
        if self._led_s == inf and (np.abs(command - self._before) > self._slack).any():
            self._led_s = now_s

    def frozen(self, now_s: float) -> str:
        """Whether joint states stand still while commands move, in a sentence; empty: no."""
        since_s = now_s - self._led_s
        if not since_s > self._patience_s:
            return ''
        return f'joint states are frozen ({since_s:.3f} s) while commands move'

    def strayed(self) -> str:
        """Whether the hand was moved by others since the last command; empty: no.

        On its way to the last command, or held back from it as before, it was not.
        """
        apart = np.abs(self._sent - self._still)
        further = apart - self._apart - self._slack
        astray = np.flatnonzero(further > 0)  # none of NaN
        if not astray.size:
            return ''
        worst = astray[0]
        return (
            f'{self._joints[worst]} came back {apart[worst]:.3f} from its last command: it was '
            'moved by others'
        )
