"""Gains and limits of a grip, written once; what a robot changes is in `config/grip.yaml`.

Closure is how far a drive has moved along its closing direction: 0 open, 1 closed.
"""

from __future__ import annotations

from dataclasses import dataclass

from tactile_ros.types.config_fields import admit, number, switch, text_of, whole

SAFE_ACTIONS = ('hold', 'open')


@dataclass(frozen=True)
class GripConfig:
    """Gains and limits of the grip-force law and of what watches over it.

    The defaults are those of an Allegro Hand at 100 Hz; `qb_softhand` gives a qb SoftHand's.

    Raises
    ------
    ValueError
        With one sentence, if a value is out of its range or two contradict each other.
    """

    rate_hz: float = number(100.0, 'commands per second', 'Hz', 1, 1000)
    input_rate_hz: float = number(100.0, 'contacts per second of a finger', 'Hz', 1, 5000)
    dead_time: float = number(0.02, 'from a command until the force begins to move', 's', 0, 1)
    lag: float = number(0.05, 'time constant of a drive that follows its target', 's', 1e-3, 2)
    response: float = number(
        1.3, 'time constant of the closed loop in dead times; more is calmer', '1', 0.5, 10
    )
    stiffness_low: float = number(
        5.0, 'softest object and hand together', 'N per closure', 0.1, 1e5
    )
    stiffness_high: float = number(
        300.0, 'stiffest object and hand together', 'N per closure', 0.1, 1e5
    )
    force_noise: float = number(0.02, 'noise of a measured force', 'N', 1e-6, 10)
    closure_noise: float = number(
        2e-4, 'noise of a measured closure; smaller moves tell no stiffness', '1', 1e-9, 0.1
    )
    closure_low: float = number(0.0, 'most open that is commanded', '1', -1, 1)
    closure_high: float = number(1.0, 'most closed that is commanded', '1', 0, 2)
    closure_rate: float = number(1.0, 'fastest change of a command', '1/s', 1e-3, 20)
    closing_rate: float = number(0.25, 'approach before contact', '1/s', 1e-4, 20)
    opening_rate: float = number(0.5, 'release', '1/s', 1e-4, 20)
    contact_on: float = number(0.15, 'force above which a finger touches', 'N', 1e-6, 100)
    contact_off: float = number(0.05, 'force below which it no longer does', 'N', 0, 100)
    touch_force: float = number(0.3, 'force that waits for the other fingers', 'N', 1e-6, 100)
    touch_time: float = number(1.0, 'longest wait for the other fingers', 's', 0, 60)
    load_rate: float = number(20.0, 'growth of the target from touch to load', 'N/s', 1e-3, 1e4)
    force_high: float = number(10.0, 'largest target of a finger', 'N', 1e-3, 1000)
    balance_high: float = number(
        0.2, 'most that balance adds to a finger, of its target', '1', 0, 10
    )
    settled_share: float = number(0.05, 'error that counts as settled, of the target', '1', 0, 1)
    settled_time: float = number(0.1, 'how long it must be that small', 's', 0, 10)
    fewest_fingers: int = whole(1, 'fingers whose force must be known to go on', 1, 64)
    stale_after: float = number(
        0.1, 'age at which an input is stale; never fewer than three of its periods', 's', 0, 10
    )
    closure_required: bool = switch(True, 'a hand whose joint states are silent is a fault')
    safe_action: str = text_of('hold', 'what is done without a usable input', SAFE_ACTIONS)
    safe_rate: float = number(0.1, 'opening as the safe action', '1/s', 1e-4, 1)
    fault_time: float = number(1.0, 'fault that ends a grasp, or gives the hand up', 's', 0, 60)
    grasp_time: float = number(
        60.0, 'longest grasp or opening whose goal names no timeout', 's', 0.1, 3600
    )
    lost_time: float = number(0.2, 'time untouched after which an object is lost', 's', 0, 10)
    friction_low: float = number(
        0.6, 'least friction of the objects, assumed until a slip tells', '1', 0.01, 5
    )
    friction_floor: float = number(0.1, 'smallest friction that is believed', '1', 1e-3, 5)
    margin: float = number(0.5, 'least slip margin; half survives a halved friction', '1', 0, 0.95)
    slip_raise: float = number(2.0, 'factor on the target at a slip', '1', 1, 3)
    raise_rate: float = number(
        100.0, 'growth of a target that slip or load raise', 'N/s', 1e-3, 1e4
    )
    raise_high: float = number(5.0, 'largest raised target, in asked targets', '1', 1, 20)
    relax_time: float = number(
        10.0, 'in which a raise for one slip fades; each further slip doubles it', 's', 0.1, 1e4
    )
    slip_pause: float = number(0.08, 'time from one raise to the next', 's', 0, 5)
    vibration: float = number(
        6.0, 'tangential vibration that is a slip, in its noise at rest', '1', 2, 100
    )

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        admit(self)
        for low, high in (
            ('closure_low', 'closure_high'), ('stiffness_low', 'stiffness_high'),
            ('contact_off', 'contact_on'), ('contact_on', 'touch_force'),
            ('touch_force', 'force_high'),
        ):  # fmt: skip
            if not getattr(self, low) < getattr(self, high):
                msg = (
                    f'{low} of GripConfig must be below {high}; '
                    f'received {getattr(self, low)} and {getattr(self, high)}'
                )
                raise ValueError(msg)

    @property
    def slowest_period(self) -> float:
        """Of commands or of contacts (s), whichever come less often."""
        return 1.0 / min(self.input_rate_hz, self.rate_hz)

    @property
    def stale_age(self) -> float:
        """Age (s) beyond which an input is stale: `stale_after`, or three periods if longer."""
        return max(self.stale_after, 3.0 * self.slowest_period)


def qb_softhand() -> GripConfig:
    """Defaults for a qb SoftHand: 25 Hz, about 0.1 s until it moves, one synergy."""
    return GripConfig(
        rate_hz=25.0, dead_time=0.1, lag=0.1, closing_rate=0.15, stiffness_high=120.0,
        load_rate=8.0, touch_time=1.5,
    )  # fmt: skip
