"""Loops over rows, compiled where numba is installed; vectorised twins serve where it is not.

A compiled function is built once, in a fit or while a calibration is read, and kept on disk where
that is possible. It rounds as written: no fused or reordered sums, so that a row has the same
bits alone and among others.
"""

from __future__ import annotations

import importlib
import importlib.util
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

Function = TypeVar('Function', bound='Callable[..., object]')

AVAILABLE = importlib.util.find_spec('numba') is not None


def available() -> bool:
    """Whether loops are compiled; asked at every call, never kept."""
    return AVAILABLE


def compiled(function: Function) -> Function:
    """Compile a function of arrays and numbers; itself where numba is not installed.

    Parameters
    ----------
    function : callable
        Plain loops over arrays; it may call others that this compiled.

    Returns
    -------
    callable
        Of the same arguments; compiled when it is first called.

    Examples
    --------
    >>> compiled(lambda x: x + 1)(1)
    2
    """
    if not available():
        return function
    return Lazy(function)  # type: ignore[return-value]


class Lazy:
    """A function that is compiled when it is first called, or needed by another one."""

    def __init__(self, function: Callable[..., object]) -> None:
        self.function = function
        self.built: Callable[..., object] | None = None

    def __call__(self, *arguments: object) -> object:
        """Call it, compiled."""
        call = self.built or self.build()
        return call(*arguments)

    def build(self) -> Callable[..., object]:
        """Compile it, and first what it calls."""
        names = self.function.__globals__  # type: ignore[attr-defined]
        for name in self.function.__code__.co_names:  # type: ignore[attr-defined]
            if isinstance(names.get(name), Lazy):
                names[name] = names[name].build()
        numba = importlib.import_module('numba')
        try:
            self.built = numba.njit(cache=True, error_model='numpy')(self.function)
        except RuntimeError:  # no folder to keep it in
            self.built = numba.njit(error_model='numpy')(self.function)
        assert self.built is not None
        return self.built
