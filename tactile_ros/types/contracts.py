"""Contracts: what a device and an estimator are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import TracebackType

    from tactile_ros.types.arrays import Array, Integers
    from tactile_ros.types.frames import Frame, Layout


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
        """Learn from features (s, d) and targets (s, k)."""
        ...

    def predict(self, x: Array) -> Array:
        """Targets (s, k) for features (s, d)."""
        ...
