"""The trained networks of [1], Pronet-L: features of windows, to be compared with prototypes.

`training/pronet.py` made them and says how; each file tells the command and the places that it
learned from. They know the skin that they were trained on, and no other.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from tactile_ros.estimators.embedding import Embedding

TRAINED = ('shapes', 'postures')
FRAMES, CHANNELS = 10, 60  # of a window


def can_run() -> bool:
    """Whether onnxruntime is installed."""
    return find_spec('onnxruntime') is not None


def pronet(what: str) -> Embedding:
    """Network for 'shapes' of heads or 'postures' of a bar.

    Raises
    ------
    ValueError
        If it is neither.
    """
    if what not in TRAINED:
        msg = f'what of pronet must be one of {", ".join(TRAINED)}; received {what!r}'
        raise ValueError(msg)
    return Embedding(Path(__file__).with_name(f'pronet_{what}.onnx'))
