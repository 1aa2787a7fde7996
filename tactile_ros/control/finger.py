# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Law of one drive, contact of one finger, and witnesses of its force.

A soft position drive is a force sensor of its own: what its command leads its joints by, times the
gain of the position loop, is the torque that it presses with. A sensor that contradicts it for
`PATIENCE` is named, and the grip stops where it is.
"""

from __future__ import annotations

from collections import deque
from math import exp, inf, isfinite, nan, sqrt
from typing import TYPE_CHECKING

from tactile_ros.control.slip_margin import SlipMargin

if TYPE_CHECKING:
    from tactile_ros.control.config import Drive, GripConfig

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
CLOSED, PRESSED = 1.25, 3.0  # closure at which an approach ends, and largest command beyond
FARTHEST = 4.0  # closures that a hand may be opened beyond its open posture
FILTERED, SLOWEST_FILTER = 0.03, 0.1  # noise after the filter, of the target; s
ON_SIGMAS, ON_RAW, ON_SHARE, OFF = 5.0, 3.0, 0.3, 1 / 3  # levels of contact
LEAST_NOISE = 0.5  # of `force_noise`: slips are told from the noise of a loop too
SAME = 1e-9  # closure within which a command was admitted as it was
STIFFER = 4.0  # times its own gain that a drive may turn out to have
FADE, MOVED = 30.0, 2e-4  # closure that a point of the stiffness lasts, in its noise
KNOWN = 0.5  # error of a stiffness that is known, of its value


class Witness:
    """Contradictions of the force that one finger reads.

    Parameters
    ----------
    drive : Drive
        That moves the finger.
    reaction : float
        Time in which a force answers a command (s).
    """

    def __init__(self, drive: Drive, reaction: float) -> None:
        self._drive, self._patience = drive, max(FROZEN, LATEST * reaction)
        self.friction = nan
        self.forget_zero()
        self.restart()

    def forget_zero(self) -> None:
        """The finger may touch something, or was not heard."""
        self.zero, self.zero_time = 0.0, 0.0

    def restart(self) -> None:
        """Another grasp."""
        self.friction, self._moving = nan, 0.0
        self._leaning = self._pressing = self._still = 0.0
        self._bits = self._command = nan
        self._at = (nan, nan)

    def rest(self, normal: float, dt: float) -> None:
        """Take in a force (N) of a finger that does not move."""
        self.zero_time = min(self.zero_time + dt, 2.0 * ZERO_TIME)
        share = max(dt / self.zero_time, dt / ZERO_TIME)
        self.zero += min(share, 1.0) * (normal - self.zero)

    def biased(self, sigma: float, asked: float) -> bool:
        """Judge that the zero is none, for a noise and an asked force (N)."""
        most = max(ZERO_SIGMAS * sigma, ZERO_SHARE * asked, ZERO_LEAST)
        return abs(self.zero) > most

    def supports(self, pressed: float) -> bool:
        """Judge that a drive which presses (N) holds what its finger reads at rest."""
        return isfinite(pressed) and pressed > AGREES * abs(self.zero)

    def approach(
        self,
        normal: float,
        pressed: float,
        asked: float,
        moved: tuple[float, float],
        dt: float,
    ) -> str:
        """Contradiction of a finger that moves and feels nothing; empty: none.

        `moved` has the closures of its command and of its joints: one that goes on as commanded
        leans on nothing, however late its commands came.
        """
        if not isfinite(pressed):
            return ''
        self._moving += dt
        if self._moving < SETTLING or not isfinite(self.friction):
            self.friction = max(pressed, 0.0)
        excess = pressed - self.friction
        if excess <= max(LEAN * asked, LEAN_LEAST):
            self.friction = max(self.friction + min(dt / FOLLOWING, 1.0) * excess, 0.0)
            self._leaning, self._at = 0.0, moved
            return ''
        self._leaning += dt
        way, gone = (now - before for now, before in zip(moved, self._at, strict=True))
        stands = gone <= GOES_ON * way + STANDS
        if self._leaning < PATIENCE or not (stands or excess > max(asked, 2.0 * LEAN_LEAST)):
            return ''
        return f'reads {normal:.2f} N while its drive leans on something with {excess:.2f} N'

    def press(
        self, normal: float, new: bool, pressed: float, target: float, command: float, dt: float
    ) -> str:
        """Contradiction of a finger that presses, at a command of its drive; empty: none.

        Only a `new` force that is the same to the last bit is frozen; others are late.
        """
        if normal != self._bits:
            self._bits, self._command, self._still = normal, command, 0.0
        told = isfinite(pressed) or not self._drive.is_soft
        self._still += dt if told else 0.0
        unit = self._drive.own if self._drive.is_soft else self._drive.stiffness_high
        moved = abs(command - self._command) * unit
        if new and self._still > self._patience and moved > FROZEN_MOVED * target:
            return f'reads {normal:.2f} N to the last bit while its drive moves'
        own = pressed - (self.friction if isfinite(self.friction) else 0.0)
        low = own > TOO_MUCH * target and normal < own / (2.0 * self._drive.spread)
        self._pressing = self._pressing + dt if low else 0.0  # false of NaN
        if self._pressing < PATIENCE:
            return ''
        return f'reads {normal:.2f} N while its drive presses {own:.2f} N'


def bounded(value: float, low: float, high: float) -> float:
    """Nearest number inside bounds, which cost less than min and max."""
    return low if value < low else high if value > high else value


class Stiffness:
    """Gain of a plant: least squares of force over closure with a prior.

    Old points fade with the way that the drive has gone and not with time, so that a long hold
    neither forgets nor winds up the estimate, and a stiffening object is followed.
    """

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self.reset()

    def reset(self) -> None:
        """Forget the object: as stiff as can be, and anything down to the softest."""
        low, high = self._drive.stiffness_low, self._drive.stiffness_high
        self._prior, self._spread = 0.5 * (low + high), 0.5 * (high - low)
        self.value, self.cautious = self._prior, high
        self._count = self._x = self._f = self._xx = self._xf = 0.0
        self._last = self._origin = nan

    def step(self, closure: float, force: float, sigma: float) -> None:
        """Take in a force (N) at a closure; one within noise of the last is passed over."""
        moved = abs(closure - self._last)
        if moved < MOVED:
            return
        if self._count == 0.0:
            self._origin, moved = closure, 0.0
        self._last = closure
        keep, x = exp(-moved / (FADE * MOVED)), closure - self._origin
        self._count = keep * self._count + 1.0
        self._x, self._f = keep * self._x + x, keep * self._f + force
        self._xx, self._xf = keep * self._xx + x * x, keep * self._xf + x * force
        spread = max(self._xx - self._x * self._x / self._count, 0.0)
        along = self._xf - self._x * self._f / self._count
        error = sigma**2 + (self.value * MOVED) ** 2
        precision = 1.0 / self._spread**2 + spread / error
        value = (self._prior / self._spread**2 + along / error) / precision
        high = self._drive.stiffness_high
        most = STIFFER * high if self._drive.is_soft else high  # gains of a drive may be others
        self.value = bounded(value, self._drive.stiffness_low, most)
        std = sqrt(1.0 / precision)
        self.cautious = min(self.value + std, most) if std < KNOWN * self.value else high


class DriveLaw:
    """Command of one drive: moved at a speed, or regulated on force.

    Attributes
    ----------
    command, contact : float
        Last closure, and that at which it met the object; NaN: none yet.
    free : float
        Closure where dead time and lag have taken the drive by now if nothing is in its way.
    limited : bool
        Whether the last step was clamped or rate limited.
    stop : str
        Limit of the hand that lets the drive close no further now; empty: none.

    Examples
    --------
    >>> from tactile_ros.control.config import Drive, GripConfig
    >>> law = DriveLaw(GripConfig(), Drive(5.0, 300.0))
    >>> law.seat(0.4)
    >>> law.regulate(1.0, 1.0, 0.01), law.regulate(2.0, 1.0, 0.01) > 0.4
    (0.4, True)
    """

    def __init__(self, config: GripConfig, drive: Drive) -> None:
        self.config, self.drive = config, drive
        self.stiffness = Stiffness(drive)
        self._integral_time = min(config.lag, 4.0 * config.loop_time)
        self.reaction = config.delay + config.lag
        self.command = self.contact = self.free = nan
        self._waiting: deque[tuple[float, float]] = deque()
        self._time, self._target = 0.0, nan
        self.rest()

    def rest(self) -> None:
        """Regulate anew from the last command."""
        self._integral = self._gain = self._wanted = self._from = nan
        self._goal = self._follows = nan
        self.touched = 0.0
        self.limited, self.stop = False, ''

    def seat(self, closure: float, contact: float = nan) -> None:
        """Begin at rest at a closure: the next command starts there, whatever the error is."""
        self.command = bounded(closure, -FARTHEST, PRESSED)
        self.contact, self.free, self._target = contact, self.command, self.command
        self._waiting.clear()
        self.rest()

    def meet(self, closure: float) -> None:
        """End the approach where it is now: as measured, or by the model where that is further."""
        back = min(closure if closure > self.free else self.free, self.command)
        self._integral = self._wanted = nan
        self._from = self.contact = back

    def move(self, speed: float, dt: float) -> float:
        """Command after moving at a speed (1/s), positive closes; force is not looked at."""
        self._integral = self._wanted = nan
        self.touched = 0.0
        high = CLOSED if speed > 0.0 and not isfinite(self.contact) else PRESSED
        return self._admit(self.command + speed * dt, dt, max(high, self.command))

    @property
    def trailing(self) -> float:
        """Closure by which a drive that is free is behind its command, after the dead time."""
        return self._target - self.free

    def follow(self, dt: float) -> float:
        """Command on the way to what the last force asked for, and not beyond."""
        return self._admit(self._wanted if isfinite(self._wanted) else self.command, dt)

    def stay(self) -> None:
        """Leave the command where it is."""
        self._wanted, self.limited = nan, False

    def regulate(self, target: float, force: float, dt: float, unseen: float = 0.0) -> float:
        """Command that brings a force to a target (N); `unseen` (s) brought no new force.

        Where the drive's own gain is known, a target that moves goes to the command at once, and
        to the error as the plant follows.
        """
        if not isfinite(self._integral):
            self._goal = self._follows = target
        share = 1.0 - exp(-(dt + unseen) / self.reaction)
        self._follows += (share if self.drive.is_soft else 1.0) * (target - self._follows)
        most = self.config.force_high
        error = bounded(self._follows - force, -most, most)
        gain = self.config.lag / (self.stiffness.cautious * self.config.loop_time)
        if not isfinite(self._integral):
            start = self._from if isfinite(self._from) else self.command
            self._integral, self._from = start - gain * error, nan
        else:  # the gain changes without a bump
            self._integral += (self._gain - gain) * error
            if self.drive.is_soft:
                self._integral += (target - self._goal) / self.stiffness.cautious
        self._gain, self._goal = gain, target
        if not (self.stop and error > 0.0):
            self._integral += gain / self._integral_time * error * (dt + unseen)
        self._wanted = self._integral + gain * error
        made = self._admit(self._wanted, dt)
        if made != self._wanted:
            self._integral += min(dt / self._integral_time, 1.0) * (made - self._wanted)
        return made

    def yield_to(self, closure: float, dt: float) -> None:
        """Go on from a closure that was sent instead of the command, without winding up."""
        if isfinite(self._integral):
            self._integral += min(dt / self._integral_time, 1.0) * (closure - self.command)
        self.command, self.limited = closure, True

    def let_time_pass(self, dt: float) -> None:
        """Move the model of the free drive by a time dt (s)."""
        self._waiting.append((self._time + self.config.dead_time, self.command))
        end = self._time + dt
        while self._time < end:
            due = self._waiting[0][0] if self._waiting else inf
            until = min(max(due, self._time), end)
            share = 1.0 - exp((self._time - until) / self.config.lag)
            self.free += (self._target - self.free) * share
            self._time = until
            if due <= until:
                self._target = self._waiting.popleft()[1]

    def _admit(self, wanted: float, dt: float, high: float = PRESSED) -> float:
        """Nearest command inside limits and rate."""
        step = self.drive.fastest * dt
        near = bounded(wanted, self.command - step, self.command + step)
        made = bounded(near, min(0.0, self.command), high)
        self.limited = made != wanted
        self.command = made
        return made


class Finger:
    """Contact of one finger: its force behind a filter as slow as its noise asks for, and slip.

    Attributes
    ----------
    normal, sigma : float
        Filtered force along the normal, and its noise (N).
    touching : bool
        Whether it touches; one whose force is not known keeps its last answer.
    why : str
        Why its force cannot be used; empty: it can.
    unspent : bool
        It has given a force that was not regulated yet.
    """

    def __init__(self, config: GripConfig, drive: Drive) -> None:
        self._config = config
        self.slip, self.witness = SlipMargin(config), Witness(drive, config.delay + config.lag)
        self.forget()

    def forget(self) -> None:
        """Nothing is held, and nothing is known of the next object."""
        self.normal, self.sigma, self.error = nan, self._config.force_noise, nan
        self.touching, self.unspent = False, False
        self.why, self.waited = 'was never heard', 0.0
        self.on = 0.0
        self.slip.reset()
        self.witness.restart()

    @property
    def good(self) -> bool:
        """Judge whether its force may be used."""
        return not self.why

    def blind(self) -> None:
        """Forces have gone unseen: what compares them with the last begins anew."""
        self.unspent, self.normal = False, nan
        self.slip.blind()

    def take(
        self, normal: float, across: float, said: int, noise: float, asked: float, dt: float
    ) -> None:
        """Take in a new force (N), a time dt (s) after its last; `asked` (N) of the finger."""
        noise = noise if noise > 0.0 else self._config.force_noise  # also of NaN
        slow = (noise / (FILTERED * max(asked, 0.1))) ** 2 - 1.0
        share = dt / (dt + bounded(0.5 * dt * slow, 0.0, SLOWEST_FILTER))
        self.normal = normal if self.normal != self.normal else (
            self.normal + share * (normal - self.normal)
        )  # fmt: skip
        self.sigma = noise * sqrt(share / (2.0 - share))
        self.on = max(ON_SIGMAS * self.sigma, min(ON_RAW * noise, ON_SHARE * asked))
        self.touching = self.normal > (OFF * self.on if self.touching else self.on)
        self.unspent = True
        if self.touching:
            least = max(noise, LEAST_NOISE * self._config.force_noise)
            self.slip.step(self.normal, across, said, least, dt, share)
        else:
            self.slip.blind()
