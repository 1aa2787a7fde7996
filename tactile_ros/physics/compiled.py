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


def compiled_with_models(shapes: str) -> Callable[[Function], Function]:
    """Compile a function of two models and of arrays when it is first called.

    Models are passed by their address, so that one compilation serves all of them.

    Parameters
    ----------
    shapes : str
        Dimensions of the arrays behind the models, a digit each. A model takes three vectors
        and writes a vector and two matrices; the function gives a number.
    """

    def wrap(function: Function) -> Function:
        return function if numba is None else _WithModels(function, shapes)  # type: ignore[return-value]

    return wrap


class _WithModels:
    """A function of models that is compiled when it is first called."""

    def __init__(self, function: Callable[..., object], shapes: str) -> None:
        self.function, self.shapes = function, shapes
        self.built: Callable[..., object] | None = None

    def __call__(self, *arguments: object) -> object:
        """Call it, compiled."""
        if self.built is None:
            kinds = numba.types
            vector, matrix = kinds.float64[::1], kinds.float64[:, ::1]
            model = kinds.FunctionType(kinds.void(vector, vector, vector, vector, matrix, matrix))
            arrays = (None, vector, matrix, kinds.float64[:, :, ::1])
            signature = kinds.float64(model, model, *(arrays[int(n)] for n in self.shapes))  # type: ignore[arg-type]
            try:
                made = numba.njit(signature, cache=True, error_model='numpy')(self.function)
            except RuntimeError:  # no folder to keep it in
                made = numba.njit(signature, error_model='numpy')(self.function)
            self.built = made
        return self.built(*arguments)
