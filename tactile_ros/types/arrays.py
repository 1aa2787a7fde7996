"""Names of array types, and the one check of a shape."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Singles = npt.NDArray[np.float32]  # in large tables alone
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]


def as_shape(name: str, value: npt.ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return `value` as float64 of `shape`, where -1 stands for any length.

    Parameters
    ----------
    name : str
        What the value is, for the sentence of the error.
    value : array_like
        Numbers.
    shape : tuple of int
        Wanted shape; -1 accepts any length.

    Returns
    -------
    ndarray, shape `shape`
        C-contiguous float64, a copy only where needed.

    Raises
    ------
    ValueError
        If the shape differs, or a value is no number.
    """
    try:
        array = np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        msg = f'{name} must be numbers; received {str(value)[:80]}'
        raise ValueError(msg) from error
    fits = array.ndim == len(shape) and all(
        want in (-1, got) for want, got in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = str(shape).replace('-1', 'any')
        msg = f'{name} must have shape {wanted}; received {np.shape(value)}'
        raise ValueError(msg)
    return array
