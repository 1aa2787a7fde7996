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
    from collections.abc import Sequence

    from tactile_ros.control.config import GripConfig

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
    >>> from tactile_ros.control.config import GripConfig
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


LATE = 1.5  # periods without a new force: one may be missed or cross with a step


class Fingers:
    """Contact of f fingers on a drives.

    Parameters
    ----------
    config : GripConfig
        Thresholds of contact and slip.
    drives : sequence of int
        Which drive moves each finger.

    Attributes
    ----------
    touching : list of bool
        Fingers that touch; one whose force is not known keeps its last answer.
    slips : list of SlipMargin
        Of the fingers.
    on : list of list of int
        For each drive its touching fingers whose force is known.
    feeling : list of bool
        For each drive whether the force of any of its fingers is known.
    late : bool
        A finger whose force is known has given no new one for longer than its period.
    complete : bool
        Every finger on the object has given a force that is not spent.
    """

    def __init__(self, config: GripConfig, drives: Sequence[int]) -> None:
        self._drives = list(drives)
        self._levels = (config.contact_on, config.contact_off)
        self._patience = LATE * config.slowest_period
        self.slips = [SlipMargin(config) for _ in self._drives]
        self.reset()

    def reset(self) -> None:
        """Nothing is held, and nothing is known of the next object."""
        count = max(self._drives) + 1
        self.touching = [False] * len(self._drives)
        self.on: list[list[int]] = [[] for _ in range(count)]
        self.feeling = [False] * count
        self._waited = [0.0] * len(self._drives)
        self.late, self.complete = False, True
        self.spend()
        for slip in self.slips:
            slip.reset()

    def blind(self) -> None:
        """Forces have gone unseen: what compares them with the last begins anew."""
        self.spend()
        for slip in self.slips:
            slip.blind()

    def spend(self) -> None:
        """The forces have been regulated: only others count from now on."""
        self._unspent = [False] * len(self._drives)

    def feel(
        self,
        normal: Sequence[float],
        across: Sequence[float],
        says: Sequence[int],
        good: Sequence[bool],
        new: Sequence[bool],
        dt: float,
    ) -> list[int]:
        """Take in the forces of one step.

        Parameters
        ----------
        normal, across : sequence of float
            Forces of the fingers along the normal and across it (N).
        says : sequence of int
            What sensors say of slip: 1, 0, -1.
        good : sequence of bool
            Fingers whose force is known.
        new : sequence of bool
            Fingers whose force came since the last step.
        dt : float
            Since the last step (s).

        Returns
        -------
        list of int
            Drives on which a finger touches now and none did before.
        """
        before = self.on
        self.on = [[] for _ in before]
        self.feeling = [False] * len(before)
        self.late, self.complete = False, True
        for i, drive in enumerate(self._drives):
            waited = self._waited[i] + dt
            self._waited[i] = 0.0 if new[i] else waited
            if not good[i]:
                self.slips[i].blind()
                continue
            self.feeling[drive] = True
            if new[i]:
                self._unspent[i] = True
                self._touch(i, normal[i], across[i], says[i], waited)
            elif waited > self._patience:
                self.late = True
            if self.touching[i]:
                self.on[drive].append(i)
                self.complete = self.complete and self._unspent[i]
        pairs = zip(self.on, before, strict=True)
        return [i for i, (now, past) in enumerate(pairs) if now and not past]

    def _touch(self, i: int, normal: float, across: float, says: int, dt: float) -> None:
        """Take in a new force of one finger, a time dt (s) after its last."""
        self.touching[i] = normal > self._levels[self.touching[i]]
        if self.touching[i]:
            self.slips[i].step(normal, across, says, dt)
        else:
            self.slips[i].blind()


def mean_of(values: list[float], chosen: list[int]) -> float:
    """Mean of some values; mostly it is one."""
    if len(chosen) == 1:
        return values[chosen[0]]
    return sum([values[i] for i in chosen]) / len(chosen)
