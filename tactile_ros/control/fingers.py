"""What the fingers of a hand feel: contact with hysteresis, slip and friction, drive by drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactile_ros.control.slip_margin import SlipMargin

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.control.grip_config import GripConfig

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
