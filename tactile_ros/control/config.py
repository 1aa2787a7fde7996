# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Parameters of a grip, written once; what a robot changes is in `config/grip.yaml`.

Closure is how far a drive has moved along its closing direction: 0 open, 1 closed. Thresholds,
gains and rates that are not here follow from these and from the drives of the hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import isfinite, nan

from tactile_ros.types.config_fields import admit, number, text_of, whole

SAFE_ACTIONS = ('hold', 'open')
HALF_HOLD, COMPUTING = 0.5, 1.0  # slowest periods that sampling adds to the dead time
RESPONSE = 1.3  # time constant of the closed loop in dead times; more is calmer


@dataclass(frozen=True)
class GripConfig:
    """Gains and limits of the grip-force law and of what watches over it.

    The defaults are those of an Allegro Hand at 100 Hz; `qb_softhand` gives a qb SoftHand's.
    ValueError if a value is out of its range or two contradict each other.
    """

    rate_hz: float = number(100.0, 'commands per second', 'Hz', 1, 1000)
    input_rate_hz: float = number(100.0, 'contacts per second of a finger', 'Hz', 1, 5000)
    dead_time: float = number(0.02, 'from a command until the force begins to move', 's', 0, 1)
    lag: float = number(0.05, 'time constant of a drive that follows its target', 's', 1e-3, 2)
    stiffness_low: float = number(
        5.0, 'softest object and hand together, where the hand states no gains', 'N per closure',
        0.1, 1e5,
    )  # fmt: skip
    stiffness_high: float = number(
        300.0, 'stiffest object and hand together, where the hand states no gains',
        'N per closure', 0.1, 1e5,
    )  # fmt: skip
    force_noise: float = number(
        0.02, 'noise of a measured force whose covariance is not stated', 'N', 1e-6, 10
    )
    closing_rate: float = number(0.25, 'fastest approach before contact', '1/s', 1e-4, 20)
    force_high: float = number(10.0, 'largest target of a finger', 'N', 1e-3, 1000)
    friction_low: float = number(
        0.6, 'least friction of the objects, assumed until a slip shows it', '1', 0.01, 5
    )
    relax_time: float = number(
        10.0, 'in which a raise for one slip fades; each further slip doubles it', 's', 0.1, 1e4
    )
    stale_after: float = number(
        0.1, 'age at which an input is stale; never fewer than three of its periods', 's', 0, 10
    )
    fewest_fingers: int = whole(1, 'fingers whose force must be known to go on', 1, 64)
    fault_time: float = number(1.0, 'fault that ends a grasp, or gives the hand up', 's', 0, 60)
    safe_action: str = text_of('hold', 'what is done without a usable input', SAFE_ACTIONS)

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        admit(self)
        if not self.stiffness_low < self.stiffness_high:
            msg = (
                'stiffness_low of GripConfig must be below stiffness_high; received '
                f'{self.stiffness_low} and {self.stiffness_high}'
            )
            raise ValueError(msg)

    @cached_property
    def slowest_period(self) -> float:
        """Period (s) of commands or of contacts, whichever come less often."""
        return 1.0 / min(self.input_rate_hz, self.rate_hz)

    @cached_property
    def stale_age(self) -> float:
        """Age (s) beyond which an input is stale: `stale_after`, or three periods if longer."""
        return max(self.stale_after, 3.0 * self.slowest_period)

    @cached_property
    def delay(self) -> float:
        """Dead time of the loop with that of sampling (s)."""
        return self.dead_time + (HALF_HOLD + COMPUTING) * self.slowest_period

    @cached_property
    def loop_time(self) -> float:
        """Time constant of the closed loop, and its dead time (s)."""
        return (1.0 + RESPONSE) * self.delay


@dataclass(frozen=True)
class Drive:
    """Drive of one or more fingers, as far as the law has to know it."""

    stiffness_low: float  # of drive and object together, as the command meets them (N per closure)
    stiffness_high: float
    own: float = nan  # of the drive alone, on a rigid object (N per closure); NaN: not known
    spread: float = 1.0  # factor by which `own` may be wrong either way; 1: exact
    fastest: float = 1.0  # change of the command that its joints can follow (1/s)

    @cached_property
    def is_soft(self) -> bool:
        """Judge whether its own stiffness is known, so that its joints tell a force."""
        return isfinite(self.own)


def qb_softhand() -> GripConfig:
    """Defaults for a qb SoftHand: 25 Hz, about 0.1 s until it moves, one synergy."""
    return GripConfig(
        rate_hz=25.0, dead_time=0.1, lag=0.1, closing_rate=0.15, stiffness_high=120.0
    )
