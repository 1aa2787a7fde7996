"""What was read: recordings with what was said live about them, and every problem on the way."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import TaxelStatus

if TYPE_CHECKING:
    from tactile_ros.types import ContactStates, Frame, Integers, Recording


@dataclass(frozen=True)
class LiveContacts:
    """What a live run said about frames of a recording.

    Attributes
    ----------
    rows : ndarray, shape (n,)
        Row of the recording that each message is about.
    states : ContactStates
        Of n messages.
    log_ns : ndarray, shape (n,)
        When each message was heard (ns).
    unmatched : int
        Messages about frames that the bag does not hold.
    """

    rows: Integers
    states: ContactStates
    log_ns: Integers
    unmatched: int

    def as_taken(self, recording: Recording) -> Recording:
        """The recording as the live run took it: frames that failed there count as lost."""
        error = np.uint8(TaxelStatus.ERROR)
        failed = self.rows[(self.states.taxel_status & error).all(axis=1)]
        if not len(failed):
            return recording
        shape = (len(recording), recording.layout.shape[0])
        status = np.zeros(shape, np.uint8) if recording.status is None else recording.status.copy()
        status[failed] |= error
        return replace(recording, status=status)


@dataclass(frozen=True)
class ClassChange:
    """A class that was enrolled or forgotten during a live run.

    Attributes
    ----------
    label, digest : str
        Its name; SHA-256 of the calibration since.
    after_ns : int
        Stamp of the last frame before it (ns).
    presses : tuple of tuple of int
        Stamps of the first and last frame of each press (ns); empty: it was forgotten.
    replace : bool
        What was known under the name was forgotten first.
    """

    label: str
    digest: str
    after_ns: int
    presses: tuple[tuple[int, int], ...] = ()
    replace: bool = False


@dataclass(frozen=True)
class LoadedRecording:
    """One sensor of a bag, or a file.

    Attributes
    ----------
    name : str
        Namespace in the bag, or name of the file.
    recording : Recording
        Frames and truth.
    contacts : LiveContacts or None
        What the live run said.
    baselines : tuple of Frame
        Baselines of the live run; `sequence` is the first frame that each holds for.
    calibrations : tuple of str
        SHA-256 of the calibrations of the live run, in their order.
    changes : tuple of ClassChange
        Classes that came and went in the live run, in their order.
    label_names : tuple of str
        Names of truth labels that came as text.
    problems : tuple of str
        What could not be read or matched, as sentences.
    """

    name: str
    recording: Recording
    contacts: LiveContacts | None = None
    baselines: tuple[Frame, ...] = ()
    calibrations: tuple[str, ...] = ()
    changes: tuple[ClassChange, ...] = ()
    label_names: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()


@dataclass(frozen=True)
class Loaded:
    """Everything that was read at one path; `problems` concern the whole of it."""

    recordings: tuple[LoadedRecording, ...]
    problems: tuple[str, ...] = ()

    @property
    def sentences(self) -> list[str]:
        """All problems, those of each recording under its name."""
        inner = [f'{r.name}: {text}' for r in self.recordings for text in r.problems]
        return [*self.problems, *inner]
