"""Recordings out of bags and files: frames, what was said live about them, and what was true."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.archive import load_recording
from tactile_ros.evaluation.bag_recording import load_bag
from tactile_ros.evaluation.csv_file import read_csv
from tactile_ros.evaluation.loaded import Loaded, LoadedRecording
from tactile_ros.evaluation.truth_topics import DEFAULT_TRUTH

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from tactile_ros.types import Layout


def load(
    path: str | os.PathLike[str],
    layout: Layout | None = None,
    truth_topics: Sequence[str] = DEFAULT_TRUTH,
) -> Loaded:
    """Load a bag (folder, .mcap, .db3), an .npz or a .csv.

    Parameters
    ----------
    path : path-like
        What to read.
    layout : Layout or None
        For .csv, and for bags without a layout.
    truth_topics : sequence of str
        Topics that tell the truth, relative to the sensor's namespace or absolute:
        TactileContacts, WrenchStamped, PoseStamped, PoseWithCovarianceStamped, String.

    Returns
    -------
    Loaded
        One recording per sensor.

    Raises
    ------
    RecordingError
        If there is nothing of ours at `path`.
    """
    file = Path(path)
    if not file.exists():
        msg = f'{file} does not exist'
        raise RecordingError(msg)
    if file.suffix == '.npz':
        return Loaded((LoadedRecording(file.stem, load_recording(file)),))
    if file.suffix == '.csv':
        if layout is None:
            msg = f'{file} does not tell the layout of its sensor; name the sensor'
            raise RecordingError(msg)
        return Loaded((LoadedRecording(file.stem, read_csv(file, layout)),))
    return load_bag(file, layout, truth_topics)
