"""Loops over rows, compiled by numba; without numba the same source runs, slowly.

Machine code is kept on disk where that is possible. It rounds as written: no fused or reordered
sums, so that a row has the same bits alone and among others.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, cast

try:
    import numba
except ImportError:
    numba = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from collections.abc import Callable

Function = TypeVar('Function', bound='Callable[..., object]')
AVAILABLE = numba is not None
DIGESTS: dict[int, str] = {}  # of the sources of compiled functions, by identity


def available() -> bool:
    """Whether loops are compiled."""
    return AVAILABLE


def compiled(function: Function) -> Function:
    """Compile a function of arrays and numbers when it is first called.

    Parameters
    ----------
    function : callable
        Plain loops over arrays; it may call functions that were compiled before.

    Returns
    -------
    callable
        Of the same arguments; the function itself where numba is not installed.

    Examples
    --------
    >>> compiled(lambda x: x + 1)(1)
    2
    """
    if numba is None:
        return function
    # numba looks for changes in the function's own file alone, and keeps what it compiled by this
    # name: the files and numbers of others that it uses belong to it
    code, names = function.__code__, function.__globals__  # type: ignore[attr-defined]
    used = {name: names[name] for name in code.co_names if name in names}
    numbers = [f'{key} {value!r}' for key, value in used.items() if isinstance(value, int | float)]
    called = [DIGESTS[id(value)] for value in used.values() if id(value) in DIGESTS]
    digest = hashlib.sha256(' '.join([*numbers, *called]).encode()).hexdigest()[:8]
    function.__qualname__ += f'_{digest}'
    try:
        built = numba.njit(cache=True, error_model='numpy')(function)
    except RuntimeError:  # no folder to keep it in
        built = numba.njit(error_model='numpy')(function)
    source = Path(code.co_filename)
    content = source.read_bytes() if source.is_file() else b''
    DIGESTS[id(built)] = digest + hashlib.sha256(content).hexdigest()
    return cast('Function', built)
