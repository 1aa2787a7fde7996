# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Loops over rows, compiled by numba; without numba the same source runs, slowly.

Machine code is kept on disk where that is possible. It rounds as written: no fused or reordered
sums, so that a row has the same bits alone and among others. An index beyond an array is an
IndexError, as in the source: the arrays of a file may be of any shape.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

try:
    import numba
    from numba.core import cgutils
    from numba.extending import intrinsic
except ImportError:
    numba = None  # type: ignore[assignment]

Internal = Any  # of numba, which has no types
Function = TypeVar('Function', bound='Callable[..., object]')
AVAILABLE = numba is not None
ADDRESSES: dict[int, tuple[int, object]] = {}  # of compiled models, by identity
DIGESTS: dict[int, str] = {}  # of the sources of compiled functions, by identity


def inlined(function: Function) -> Function:
    """Compile a function as part of the compiled ones that call it: arguments cost nothing."""
    return compiled(function, forced=True)


def compiled(function: Function, forced: bool = False) -> Function:
    """Compile a function of arrays and numbers, plain loops, when it is first called.

    It may call functions that were compiled before; without numba it is returned itself. With
    `forced` its code becomes part of every compiled function that calls it.

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
    digest = hashlib.sha256(' '.join(['bounds', *numbers, *called]).encode()).hexdigest()[:8]
    function.__qualname__ += f'_{digest}'
    options: dict[str, Any] = {'error_model': 'numpy', 'forceinline': forced, 'boundscheck': True}
    try:
        built = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # no folder to keep it in
        built = numba.njit(**options)(function)
    source = Path(code.co_filename)
    content = source.read_bytes() if source.is_file() else b''
    DIGESTS[id(built)] = digest + hashlib.sha256(content).hexdigest()
    return cast('Function', built)


def model_address(model: Function) -> Function:
    """Make a compiled model callable by `call_model`: an address, or itself without numba."""
    if numba is None:
        return model
    if id(model) not in ADDRESSES:
        vector, matrix = numba.float64[::1], numba.float64[:, ::1]
        kinds = (vector, vector, vector, vector, matrix, matrix)
        model.compile(kinds)  # type: ignore[attr-defined]
        built = model.overloads[kinds]  # type: ignore[attr-defined]
        found = built.library.get_pointer_to_function(built.fndesc.llvm_func_name)
        ADDRESSES[id(model)] = found, model
    return ADDRESSES[id(model)][0]  # type: ignore[return-value]


def _call_directly(model: Callable[..., None], *arguments: object) -> None:
    """Call a model that is not compiled."""
    model(*arguments)


def _call_by_address(
    typing: Internal, model: Internal, x: Internal, p: Internal, data: Internal, out: Internal,
    by_state: Internal, by_parameter: Internal,
) -> Internal:  # fmt: skip
    """Typing and code of a call of a model at an address."""

    def generate(
        context: Internal, builder: Internal, signature: Internal, values: Internal
    ) -> Internal:
        kinds, convention = signature.args[1:], context.call_conv
        function = convention.get_function_type(numba.types.none, kinds).as_pointer()
        pointer = builder.inttoptr(values[0], function)
        status, _ = convention.call_function(builder, pointer, numba.types.none, kinds, values[1:])
        with cgutils.if_unlikely(builder, status.is_error):  # type: ignore[no-untyped-call]
            convention.return_status_propagate(builder, status)
        return context.get_dummy_value()

    return numba.types.none(model, x, p, data, out, by_state, by_parameter), generate


call_model: Callable[..., None] = _call_directly
if numba is not None:
    call_model = intrinsic(_call_by_address)
