"""How far a finger is from slipping, and how much force keeps the object there.

Coulomb's cone: an object stays while ft <= mu fn. The coefficient is learned where it shows: at a
slip ft / fn is mu itself, and while nothing slips mu is at least the largest ft / fn that held. A
slip shows as vibration of the tangential force beyond its noise at rest, as a fall of the
tangential force that the normal force does not explain, or as the sensor's own word. Any of them
may be false: what one slip taught fades, and the more often it slips the slower.
"""

from __future__ import annotations

from math import hypot, isfinite, nan
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_ros.control.grip_config import GripConfig

SIGMAS = 10.0  # below so many sigma a force tells no ratio
FALL_SIGMAS = 8.0
MEMORY = 0.05  # s, of vibration and of the peak that a fall is measured from
SHARE = 0.3  # of a slip's ratio in the coefficient, at least
DOUBT = 0.5  # standard deviation of the assumed coefficient, as a share of it
MOST_DOUBLINGS = 10
STEEPEST = 100.0  # ratio of forces: no skin holds more


def faded(dt: float, relax_time: float, slips: int) -> float:
    """Share of a raise that fades in a step dt (s); each slip after the first halves it."""
    doublings = min(max(slips - 1, 0), MOST_DOUBLINGS)
    return min(dt / (relax_time * 2.0**doublings), 1.0)


class SlipMargin:
    """Friction, margin, load and slip of one finger.

    Parameters
    ----------
    config : GripConfig
        Noise, assumed friction, and what counts as vibration.

    Attributes
    ----------
    friction, friction_std : float
        Estimated coefficient, never below `friction_floor`, and its standard deviation by the
        noise of the forces; NaN until the finger has slipped with forces above ten sigma.
    margin : float
        (mu fn - ft) / (mu fn), with the assumed friction where none is known; NaN where the normal
        force is below ten sigma, or a force is not known.
    load : float
        Tangential load (N); NaN where it is not known.
    slipping : bool
        Whether it slips now.

    Notes
    -----
    Vibration is the root mean square of second differences over sqrt(6), which is the standard
    deviation of white noise and passes over slow changes of load. Numbers, not arrays: a step of
    four fingers has 50 us.

    Examples
    --------
    >>> from tactile_ros.control.grip_config import GripConfig
    >>> slip = SlipMargin(GripConfig())
    >>> for says in (0, 0, 1):
    ...     slip.step(2.0, 1.0, says, 0.01)
    >>> round(slip.friction, 3), abs(round(slip.margin, 3))
    (0.5, 0.0)
    """

    def __init__(self, config: GripConfig) -> None:
        self._noise = config.force_noise
        self._least, self._relax_time = config.friction_floor, config.relax_time
        self._assumed = config.friction_low
        self._floor = SIGMAS * config.force_noise
        self._limit = 6.0 * (config.vibration * config.force_noise) ** 2
        self.reset()

    def reset(self) -> None:
        """Forget the object: another may have another friction."""
        self.friction = self.friction_std = self.margin = self.load = nan
        self.slipping = False
        self._held = self._faith = 0.0
        self._slips = 0
        self.blind()

    def blind(self) -> None:
        """Forget the last forces, after which others have gone unseen; friction stays."""
        self._newest = self._older = self._peak = self._press = nan
        self._square = 0.0
        self.margin = self.load = nan
        self.slipping = False

    def step(self, normal: float, tangential: float, said: int, dt: float) -> None:
        """Take in the newest forces.

        Parameters
        ----------
        normal, tangential : float
            Along the normal, and the size across it (N); what is not finite is not known.
        said : int
            What the sensor says of slip: 1, 0, -1 unknown.
        dt : float
            Since the last step (s), above 0.
        """
        if not (isfinite(normal) and isfinite(tangential)):
            self.blind()
            self.slipping = said == 1
            return
        floor = self._floor
        share = dt / MEMORY if dt < MEMORY else 1.0
        felt = self._vibrates(tangential, share) | self._falls(normal, tangential, share)
        self.load = tangential
        shown = felt and said != 0 and normal > floor and tangential > floor
        before, self.slipping = self.slipping, said == 1 or shown
        if self.slipping and not before:
            self._slips += 1
        if self._faith > 0.0:
            self._faith -= self._faith * faded(dt, self._relax_time, self._slips)
        self.margin = nan
        if normal > floor:
            ratio = min(tangential / normal, STEEPEST)
            if tangential > floor:
                self._learn(normal, ratio)
            self.margin = 1.0 - ratio / self.believed

    @property
    def believed(self) -> float:
        """Coefficient to act on: the estimate, which fades to what is assumed or has held."""
        likely = self._held if self._held > self._assumed else self._assumed
        if self.friction != self.friction:  # true of NaN, at a third of isnan's price
            return likely
        return self.friction + (1.0 - self._faith) * max(likely - self.friction, 0.0)

    def needed(self, spare: float) -> float:
        """Normal force (N) that leaves a slip margin of `spare`, below 1; NaN: load unknown."""
        return self.load / (self.believed * (1.0 - spare))

    def _learn(self, normal: float, ratio: float) -> None:
        """Move the coefficient to the ratio of a slip; a ratio that holds is a lower bound.

        A slip weighs as in a Kalman filter: by its noise and by that of the estimate.
        """
        if not self.slipping:
            self._held = max(self._held, ratio)
            self.friction = max(self.friction, ratio)  # NaN stays
            return
        known = isfinite(self.friction)
        before = self.friction if known else self._assumed
        spread = (self.friction_std if known else DOUBT * self._assumed) ** 2
        noise = (self._noise * hypot(1.0, ratio) / normal) ** 2
        share = max(spread / (spread + noise), SHARE)
        self.friction = max(before + share * (ratio - before), self._least)
        self.friction_std = share**0.5 * noise**0.5
        self._held, self._faith = 0.0, 1.0

    def _vibrates(self, tangential: float, share: float) -> bool:
        """Whether second differences exceed those of noise."""
        bend = tangential - 2 * self._newest + self._older
        self._older, self._newest = self._newest, tangential
        self._square += share * ((bend * bend if isfinite(bend) else 0.0) - self._square)
        return self._square > self._limit

    def _falls(self, normal: float, tangential: float, share: float) -> bool:
        """Whether the tangential force fell below its last peak though the normal force did not.

        A load that grows hides a fall from any mean: the peak rises at once and fades slowly.
        """
        drop, eased = self._peak - tangential, self._press - normal
        if drop > 0.0:
            self._peak -= share * drop
        else:  # also after blindness
            self._peak = tangential
        if drop > FALL_SIGMAS * self._noise and eased < 0.5 * drop:
            self._peak, self._press = tangential, normal
            return True
        self._press = self._press + share * (normal - self._press) if isfinite(drop) else normal
        return False
