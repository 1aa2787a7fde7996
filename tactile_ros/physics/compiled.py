"""Loops over rows, compiled where numba is installed; vectorised twins serve where it is not.

A compiled function is built once, in a fit or while a calibration is read, and kept on disk where
that is possible, until its file changes or one that it calls into. It rounds as written: no fused
or reordered sums, so that a row has the same bits alone and among others.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, TypeVar, cast

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
        if self.built is not None:
            return self.built
        names = self.function.__globals__  # type: ignore[attr-defined]
        # numba looks at the function's own file alone, and keeps what it compiled by this name
        self.function.__qualname__ += f'_{digest(called_by(self.function))}'
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


def called_by(function: Callable[..., object]) -> list[FunctionType]:
    """Functions that this compiled and that a function calls, itself first, each once."""
    found = [cast('FunctionType', function)]
    for one in found:
        for name in one.__code__.co_names:
            called = one.__globals__.get(name)
            # those that are built already are numba's
            inner = (
                called.function if isinstance(called, Lazy) else getattr(called, 'py_func', None)
            )
            if isinstance(inner, FunctionType) and inner not in found:
                found.append(inner)
    return found


def digest(functions: list[FunctionType]) -> str:
    """Of the files that functions lie in, less the first one's, and of the numbers they use."""
    own = functions[0].__code__.co_filename
    files = {one.__code__.co_filename for one in functions} - {own}
    numbers = {
        f'{name} {value!r}'
        for one in functions
        for name in one.__code__.co_names
        if isinstance(value := one.__globals__.get(name), int | float)
    }
    content = [Path(path).read_bytes() for path in sorted(files) if Path(path).is_file()]
    content += [number.encode() for number in sorted(numbers)]
    return hashlib.sha256(b'|'.join(content)).hexdigest()[:8]
