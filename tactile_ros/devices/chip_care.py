"""Care of chips on I2C buses: what failed, when to try again, and how they are set up anew."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from tactile_ros.devices.chip import Chip, CommandRefused
from tactile_ros.devices.mlx90393 import EXIT_WAIT_S, RESET_WAIT_S, Status
from tactile_ros.errors import DeviceError, NotAcknowledged

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.devices.transport import I2cBus

T = TypeVar('T')

FIRST_RETRY_S = 0.02
LONGEST_RETRY_S = 0.2


@dataclass
class ArrayCounts:
    """What the driver has seen.

    Attributes
    ----------
    resets : int
        Times that a running chip said it had been reset (its supply broke down).
    reconfigured : int
        Times that a chip was set up again.
    nacks : int
        Transfers that nothing answered.
    not_ready : int
        Reads that came before their measurement was ready.
    refused : int
        Commands that a chip refused, and registers that did not keep what was written.
    stalls : int
        Measurements that did not become ready in time.
    bus_errors : int
        Failures of a whole bus.
    dropped : int
        Frames in which no chip could be read.
    """

    resets: int = 0
    reconfigured: int = 0
    nacks: int = 0
    not_ready: int = 0
    refused: int = 0
    stalls: int = 0
    bus_errors: int = 0
    dropped: int = 0


class ChipCare:
    """Keeps chips running: exchanges that may fail, and chips that come back.

    Parameters
    ----------
    chips : sequence of Chip
        Of all buses.
    burst : bool
        Whether chips are started in burst mode when they are set up.
    wait_ns : int
        Time from the start of a measurement to its reading (ns).
    monotonic_ns, sleep : callable
        Time (ns), and what lets it pass (s).

    Attributes
    ----------
    counts : ArrayCounts
        What was seen.
    failure : str
        The last one, in a sentence.
    """

    def __init__(
        self,
        chips: Sequence[Chip],
        burst: bool,
        wait_ns: int,
        monotonic_ns: Callable[[], int],
        sleep: Callable[[float], None],
    ) -> None:
        """See the class."""
        self.counts = ArrayCounts()
        self.failure = ''
        self._chips = chips
        self._burst = burst
        self._wait_ns = wait_ns
        self._monotonic_ns = monotonic_ns
        self._sleep = sleep

    def begin(self) -> None:
        """Set all chips up, as after opening."""
        for chip in self._chips:
            chip.lost, chip.losses, chip.pause_s = True, 0, 0.0
            chip.retry_ns = self._monotonic_ns()
            chip.switches.forget()
        self.bring_back()

    def end(self) -> None:
        """Stop all chips that still answer."""
        for chip in self._chips:
            if not chip.lost and self._burst:
                self.attempt(chip, chip.exit)
            chip.lost = True

    def attempt(self, chip: Chip, action: Callable[[], T]) -> T | None:
        """Do something with a chip; None where it fails, which is counted and remembered."""
        try:
            return action()
        except NotAcknowledged as err:
            self.failure = str(err)
            self.counts.nacks += 1
            chip.switches.forget()
            # the answer that was lost may have told of a reset
            self.lose(chip)
        except CommandRefused as err:
            self.failure = str(err)
            self.counts.refused += 1
            self.lose(chip)
        except DeviceError as err:
            self.failure = str(err)
            self._lose_bus(chip.bus)
        return None

    def lose(self, chip: Chip, at_once: bool = True) -> None:
        """Note that a chip has to be set up again: at once, and after growing pauses then."""
        chip.losses += 1
        pause = min(max(2 * chip.pause_s, FIRST_RETRY_S), LONGEST_RETRY_S)
        if at_once and chip.losses == 1:
            pause = 0.0
        chip.lost, chip.pause_s = True, pause
        chip.retry_ns = self._monotonic_ns() + round(pause * 1e9)

    def _lose_bus(self, bus: I2cBus) -> None:
        """Note that all chips of a bus have to be set up again."""
        self.counts.bus_errors += 1
        for chip in self._chips:
            if chip.bus is bus:
                chip.switches.forget()
                self.lose(chip, at_once=False)

    def refused(self, chip: Chip, status: int) -> bool:
        """Whether a chip that should start does not; it is set up again then."""
        if self.was_reset(chip, status):
            return True
        if status & Status.ERROR:
            self.failure = f'chip {chip.place} refuses to measure (status {status:#04x})'
            self.counts.refused += 1
            self.lose(chip)
        return bool(status & Status.ERROR)

    def was_reset(self, chip: Chip, status: int) -> bool:
        """Whether a chip lost its settings; it gets them back before the next frame."""
        if status & Status.RESET:
            self.failure = f'chip {chip.place} was reset: its supply broke down'
            self.counts.resets += 1
            self.lose(chip)
        return bool(status & Status.RESET)

    def stalled(self, chip: Chip) -> None:
        """Note that a measurement did not become ready in time."""
        self.failure = f'chip {chip.place} does not finish measuring'
        self.counts.stalls += 1
        self.lose(chip)

    def bring_back(self) -> None:
        """Set up the lost chips whose time has come, all together."""
        now_ns = self._monotonic_ns()
        lost = [chip for chip in self._chips if chip.lost and chip.retry_ns <= now_ns]
        if not lost:
            return
        lost = self._each(lost, _open_bus)
        lost = self._each(lost, Chip.exit, EXIT_WAIT_S)
        lost = self._each(lost, Chip.reset, RESET_WAIT_S)
        self._each(lost, self._set_up)

    def _each(
        self, chips: list[Chip], action: Callable[[Chip], object], wait_s: float = 0.0
    ) -> list[Chip]:
        """Do something with every chip, then wait; the chips with which it went well."""
        begun_ns = self._monotonic_ns()
        done = []
        for chip in chips:
            # a bus that failed for one chip is not tried for the next
            if chip.retry_ns > begun_ns:
                continue
            if self.attempt(chip, lambda chip=chip: (action(chip),)) is not None:  # type: ignore[misc]
                done.append(chip)
        if done:
            self._sleep(wait_s)
        return done

    def _set_up(self, chip: Chip) -> None:
        """Configure a chip that was just reset, start it in burst mode, and take it back."""
        again = chip.configured
        chip.configure()
        if self._burst:
            chip.start_burst()
        self.counts.reconfigured += again
        chip.lost = False
        chip.ready_ns = self._monotonic_ns() + self._wait_ns


def _open_bus(chip: Chip) -> None:
    """Open the bus of a chip, where it is not."""
    chip.bus.open()
