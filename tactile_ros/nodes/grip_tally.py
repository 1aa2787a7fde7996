"""What a grip has done since it is active, for diagnostics."""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus

from tactile_ros.control import GripPhase
from tactile_ros.nodes.lifecycle import pairs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.control import GripConfig
    from tactile_ros.nodes.grip_decision import Decision


class GripTally:
    """Steps and commands counted, and what the last step said.

    Attributes
    ----------
    steps, commands, limited : int
        Steps, those that sent something, and those in which it was changed.
    """

    def __init__(self) -> None:
        self.steps = self.commands = self.limited = 0
        self._previous = 0
        self._refusal, self._phase, self._disagreement = '', GripPhase.IDLE, nan

    def note(self, decision: Decision) -> None:
        """Take in a step."""
        self.steps += 1
        self.commands += decision.command is not None
        self.limited += decision.limited
        self._refusal, self._phase = decision.refusal, decision.made.phase
        self._disagreement = decision.made.disagreement

    def status(
        self, hand: str, config: GripConfig, enabled: bool, busy: bool, unheard: Sequence[str]
    ) -> DiagnosticStatus:
        """Phase, rate, refusals, once a second."""
        steps, self._previous = self.steps - self._previous, self.steps
        level, sentence = self._said(steps, config, enabled, unheard)
        status = DiagnosticStatus(level=level, name='grip', message=sentence)
        status.hardware_id = hand
        status.values = pairs(
            {
                'phase': self._phase.name,
                'enabled': enabled,
                'steps': self.steps,
                'commands': self.commands,
                'limited': self.limited,
                'rate (Hz)': steps,
                'nominal rate (Hz)': config.rate_hz,
                'grasp under way': busy,
                'refusal': self._refusal or 'none',
                'disagreement of sides': self._disagreement,
                'never heard': ', '.join(unheard) or 'none',
            }
        )
        return status

    def _said(
        self, steps: int, config: GripConfig, enabled: bool, unheard: Sequence[str]
    ) -> tuple[bytes, str]:
        """Level and sentence: what is worst."""
        level, sentence = DiagnosticStatus.OK, f'{self._phase.name}, {steps} steps a second'
        if self._refusal:
            level = DiagnosticStatus.WARN if enabled else DiagnosticStatus.OK
            sentence = self._refusal
        if unheard:
            level, sentence = DiagnosticStatus.WARN, f'nothing came of {", ".join(unheard)}'
        if self._disagreement > config.balance_high:  # false of NaN
            level = DiagnosticStatus.WARN
            sentence += f'; the two sides disagree by {self._disagreement:.0%}'
        if self._phase == GripPhase.FAULT:
            level = DiagnosticStatus.ERROR
        return level, sentence
