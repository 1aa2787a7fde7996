# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Force, contact and slip of one finger, and its drive as a witness of them.

A soft position drive is a force sensor of its own: what its command leads its joints by, times the
gain of the position loop, is the torque that it presses with. A sensor that contradicts it for
`PATIENCE` is named, and the grip stops where it is.
"""

from __future__ import annotations

from math import inf, isfinite, nan, sqrt
from typing import TYPE_CHECKING

from tactile_ros.control.force_pi import bounded
from tactile_ros.control.slip_margin import SlipMargin

if TYPE_CHECKING:
    from tactile_ros.control.config import GripConfig
    from tactile_ros.control.force_pi import ForcePi
    from tactile_ros.control.grasp_sequence import FingerInput

ZERO_TIME = 0.2  # s of forces that tell a zero
ZERO_SIGMAS, ZERO_SHARE, ZERO_LEAST = 3.0, 0.05, 0.03  # of noise, of what is asked; N
SETTLING = 0.25  # s from the start of a motion until the friction of a drive shows
FOLLOWING = 0.5  # s, time constant in which friction of a moving drive is learned
LEAN, LEAN_LEAST = 0.3, 0.35  # of what is asked, N: more than friction, less than a grip
GOES_ON, STANDS = 0.5, 2e-3  # of the way of a command; closure
PATIENCE = 0.12  # s for which a witness must contradict
FROZEN, FROZEN_MOVED = 0.15, 0.15  # s of the same bits while a drive should change by this share
LATEST = 1.5  # times to react after which a force must have changed
TOO_MUCH = 1.15  # of the target: a drive that presses more where its sensor reads less
AGREES = 0.5  # of a reading that a drive must press with to speak for it
FILTERED, SLOWEST_FILTER = 0.03, 0.1  # noise after the filter, of the target; s
ON_SIGMAS, ON_RAW, ON_SHARE, OFF = 5.0, 3.0, 0.3, 1 / 3  # levels of contact
LEAST_NOISE = 0.5  # of `force_noise`: slips are separated from the noise of a loop too
LOADED, LOADED_SIGMAS = 0.2, 5.0  # of what is asked, of noise: a load that has come
RANGE = 3.0  # largest targets beyond which a reading is none


class Finger:
    """One finger: force behind a filter as slow as its noise asks for, targets and slip."""

    given: FingerInput  # newest

    def __init__(self, config: GripConfig, law: ForcePi, name: str = '', side: int = 0) -> None:
        self._config, self.name = config, name
        self.law = law  # that moves it
        self.side = side  # +1, -1, or 0 where it opposes none
        self.slip = SlipMargin(config)
        self._patience = max(FROZEN, LATEST * law.reaction)
        self.zero = self._zero_time = 0.0  # force at rest (N), and for how long it was learned (s)
        self.used = True  # it takes part
        self.asked = 0.0  # force without raises (N)
        self.forget()

    def forget(self) -> None:
        """Nothing is held, and nothing is known of the next object."""
        self.normal, self.sigma = nan, self._config.force_noise  # filtered force and noise (N)
        self.touching = False  # one whose force is not known keeps its last answer
        self.steady = inf  # s since that changed
        self.on = 0.0  # level of contact (N)
        self.why = 'never came'  # its force cannot be used; empty: it can
        self.waited = 0.0  # for a new force (s)
        self.unspent = False  # it has given a force that was not regulated yet
        self.target = 0.0  # force now (N)
        self.carried = nan  # least load since the grip had settled (N)
        self.regulated = 0.0  # error that its drive regulates (N)
        self._mean = self._friction = nan
        self._moving = self._leaning = self._pressing = self._still = self._unwatched = 0.0
        self._bits = self._command = nan
        self._at = (nan, nan)
        self.slip.reset()

    @property
    def good(self) -> bool:
        """Judge whether its force may be used."""
        return not self.why

    @property
    def pressing(self) -> bool:
        """Judge whether it touches, and its force is known."""
        return self.touching and not self.why

    @property
    def new(self) -> bool:
        """Judge whether its usable force is new."""
        return self.given.new and not self.why

    @property
    def error(self) -> float:
        """Target less force (N)."""
        return self.target - self.normal

    @property
    def loaded(self) -> bool:
        """Judge whether its load has grown since the grip had settled, or is not known."""
        most = LOADED * self.asked + LOADED_SIGMAS * self.noise
        return not self.slip.load - self.carried <= most

    @property
    def noise(self) -> float:
        """Noise of a force (N): as stated, or that of the config."""
        stated = self.given.sigma
        return stated if stated > 0.0 else self._config.force_noise  # also of NaN

    def judge(self) -> None:
        """Say why the newest force cannot be used."""
        force, age = self.given.normal, self.given.age
        self.why = ''
        if not 0.0 <= age <= self._config.stale_age:
            self.why = f'is stale ({age:.3f} s)' if age < inf else 'never came'
        elif not self.given.valid:
            self.why = 'says that it is not valid'
        elif not isfinite(force):
            self.why = 'gives a force that is not a number'
        elif abs(force) > RANGE * self._config.force_high:
            self.why = f'reads {force:.3g} N, which no finger can'

    def invalidate(self) -> None:
        """Forces have gone unseen: what compares them with the last begins anew."""
        self.unspent, self.normal = False, nan
        self.slip.invalidate()

    def rest(self, dt: float) -> None:
        """Learn the zero of a finger that does not move, a time dt (s) after the last step."""
        self.waited += dt
        if self.new:
            self._learn_zero(min(self.waited, self._config.stale_age))
            self.waited = 0.0
        elif not self.good:
            self.zero = self._zero_time = 0.0

    def _learn_zero(self, dt: float) -> None:
        """Take in a force at rest, a time dt (s) after the last."""
        self._zero_time = min(self._zero_time + dt, 2.0 * ZERO_TIME)
        share = max(dt / self._zero_time, dt / ZERO_TIME)
        self.zero += min(share, 1.0) * (self.given.normal - self.zero)

    def has_zero(self) -> bool:
        """Judge that its zero is known; one that is not goes on being learned."""
        known = self._zero_time >= ZERO_TIME
        if not known:
            self._learn_zero(self._config.slowest_period)
        return known

    def biased(self, asked: float, pressed: float) -> bool:
        """Judge that its zero is none, for an asked force, and that its drive (N) denies it."""
        most = max(ZERO_SIGMAS * self.noise, ZERO_SHARE * asked, ZERO_LEAST)
        return abs(self.zero) > most and not self.supported(pressed)

    def supported(self, pressed: float) -> bool:
        """Judge that a drive which presses (N) holds what its finger reads at rest."""
        return isfinite(pressed) and pressed > AGREES * abs(self.zero)

    def sense(self, dt: float) -> None:
        """Take in the newest force, a time dt (s) after the last step."""
        self.waited += dt
        touched = self.touching
        if self.new:
            self._take(self.waited)
            self.waited = 0.0
        elif not self.good:
            self.slip.invalidate()
        self.steady = self.steady + dt if self.touching == touched else 0.0

    def _take(self, dt: float) -> None:
        """Take in a new force, a time dt (s) after its last."""
        normal, noise, asked = self.given.normal, self.noise, self.asked
        slow = (noise / (FILTERED * max(asked, 0.1))) ** 2 - 1.0
        share = dt / (dt + bounded(0.5 * dt * slow, 0.0, SLOWEST_FILTER))
        last = self.normal
        self.normal = last + share * (normal - last) if isfinite(last) else normal
        self.sigma = noise * sqrt(share / (2.0 - share))
        self.on = max(ON_SIGMAS * self.sigma, min(ON_RAW * noise, ON_SHARE * asked))
        self.touching = self.normal > (OFF * self.on if self.touching else self.on)
        self.unspent = True
        if self.touching:
            least = max(noise, LEAST_NOISE * self._config.force_noise)
            given = self.given
            self.slip.step(self.normal, given.tangential, given.slip, least, dt, share)
        else:
            self.slip.invalidate()

    def contradiction(self, pressed: float, closure: float, dt: float) -> str:
        """Contradiction of its force by a drive that presses (N) at a closure; empty: none."""
        push = pressed - self.law.trailing * self.law.plant.own
        self._unwatched += dt  # a soft drive tells its force with new joint states alone
        told = isfinite(push) or not self.law.plant.is_soft
        dt, self._unwatched = (self._unwatched, 0.0) if told else (0.0, self._unwatched)
        return self._denied(push, dt) if self.touching else self._leans(push, closure, dt)

    def _leans(self, pressed: float, joints: float, dt: float) -> str:
        """Contradiction of a finger that moves and feels nothing; empty: none.

        One whose joints go on with the command (both closures) leans on nothing, however late its
        commands came.
        """
        if not isfinite(pressed):
            return ''
        command, asked = self.law.command, self.asked
        self._moving += dt
        if self._moving < SETTLING or not isfinite(self._friction):
            self._friction = max(pressed, 0.0)
        excess = pressed - self._friction
        if excess <= max(LEAN * asked, LEAN_LEAST):
            self._friction = max(self._friction + min(dt / FOLLOWING, 1.0) * excess, 0.0)
            self._leaning, self._at = 0.0, (command, joints)
            return ''
        self._leaning += dt
        stands = joints - self._at[1] <= GOES_ON * (command - self._at[0]) + STANDS
        if self._leaning < PATIENCE or not (stands or excess > max(asked, 2.0 * LEAN_LEAST)):
            return ''
        return f'reads {self.normal:.2f} N while its drive leans on something with {excess:.2f} N'

    def _denied(self, pressed: float, dt: float) -> str:
        """Contradiction of a finger that presses; empty: none.

        Only a new force that is the same to the last bit is frozen; others are late.
        """
        normal, target, plant = self.given.normal, self.target, self.law.plant
        if normal != self._bits:
            self._bits, self._command, self._still = normal, self.law.command, 0.0
        self._still += dt
        unit = plant.own if plant.is_soft else plant.stiffness_high
        moved = abs(self.law.command - self._command) * unit
        if self.new and self._still > self._patience and moved > FROZEN_MOVED * target:
            return f'reads {normal:.2f} N to the last bit while its drive moves'
        own = pressed - (self._friction if isfinite(self._friction) else 0.0)
        low = own > TOO_MUCH * target and normal < own / (2.0 * plant.spread)
        if isfinite(own):
            self._pressing = self._pressing + dt if low else 0.0
        if self._pressing < PATIENCE:
            return ''
        return f'reads {normal:.2f} N while its drive presses {own:.2f} N'

    def average(self, time: float, dt: float) -> float:
        """Mean of its force (N) over a time (s)."""
        last = self._mean if isfinite(self._mean) else self.normal
        self._mean = last + min(dt / time, 1.0) * (self.normal - last)
        return self._mean
