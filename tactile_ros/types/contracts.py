"""Contracts: what a device, an estimator and a hand are, and what is closed after use."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import TracebackType

    from tactile_ros.types.arrays import Array, Integers
    from tactile_ros.types.frames import Frame, Layout
    from tactile_ros.types.grip import GripCommand, JointLimits


Held = TypeVar('Held', bound='Closing')


class Closing:
    """A context manager that closes."""

    def close(self) -> None:
        """Let go of everything."""
        raise NotImplementedError

    def __enter__(self: Held) -> Held:
        """Hold it; open already."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close."""
        self.close()


class Device(Protocol):
    """A sensor that can be read, real or simulated; a context manager."""

    @property
    def layout(self) -> Layout:
        """Where the taxels are."""
        ...

    def read(self, timeout: float) -> Frame:
        """Wait at most `timeout` (s) for the next frame; DeviceTimeout when none came."""
        ...

    def __enter__(self) -> Device:
        """Open."""
        ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close."""
        ...


class Twin(Protocol):
    """A simulated sensor: what answers the bytes of a real one; a context manager."""

    @property
    def faults(self) -> tuple[str, ...]:
        """Names of the faults that it can suffer."""
        ...

    @property
    def injected(self) -> Mapping[str, int]:
        """How often each fault has happened."""
        ...

    def inject(self, fault: str, count: int = 1) -> None:
        """Let the next `count` frames or transfers suffer a fault; ValueError if unknown."""
        ...

    def relieve(self) -> None:
        """Withdraw the faults that wait."""
        ...

    def device(self, clock_ns: Callable[[], int]) -> Device:
        """The real driver on this twin's bytes, stamped by `clock_ns`; not yet entered."""
        ...

    def __enter__(self) -> Twin:
        """Begin to answer."""
        ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End, and free ports and threads."""
        ...


class Estimator(Protocol):
    """A published method: fitted arrays in attributes that end in `_`."""

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> Estimator:
        """Learn.

        Parameters
        ----------
        x : ndarray, shape (s, d)
            Features; rows that are not finite are left out, here and in y.
        y : ndarray, shape (s, k)
            Targets.
        groups : ndarray of int, shape (s,), or None
            What a split keeps together, where something is chosen; None: every row stands alone.

        Returns
        -------
        Estimator
            Itself; the same for every order of the rows.

        Raises
        ------
        ValueError
            If shapes differ or no finite row is left.
        """
        ...

    def predict(self, x: Array) -> Array:
        """Answer.

        Parameters
        ----------
        x : ndarray, shape (s, d)
            Features.

        Returns
        -------
        ndarray, shape (s, k)
            Targets (unit of the y of the fit); NaN in rows that are not finite.

        Raises
        ------
        NotCalibratedError
            Before a fit.
        ValueError
            If the number of features differs from the fit.
        """
        ...


class CommandTopic(Protocol):
    """A topic on which a hand's driver takes commands."""

    @property
    def name(self) -> str:
        """Of the topic."""
        ...

    @property
    def kind(self) -> str:
        """Type of the message, such as 'sensor_msgs/msg/JointState'."""
        ...

    def fill(self, message: object, command: GripCommand) -> None:
        """Write a command into a fresh message of this kind."""
        ...


class Hand(Protocol):
    """How a hand's driver is commanded, without a word of ROS."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all joints, in the order of the command."""
        ...

    @property
    def limits(self) -> JointLimits:
        """How far, fast and hard the joints may go."""
        ...

    @property
    def topics(self) -> tuple[CommandTopic, ...]:
        """Where commands go, in the order in which they are published."""
        ...
