"""Classes learned and forgotten in a live run are learned and forgotten again in its replay."""

from __future__ import annotations

import json
import queue
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from reference import enrolled_skin
from tactile_ros.evaluation.recording_files import LiveContacts, LoadedRecording, read_changes
from tactile_ros.evaluation.replay import replay
from tactile_ros.nodes.contact_loop import ContactLoop
from tactile_ros.nodes.enrolment_server import ClassChange, Enrolment, EnrolRequest, EnrolResult
from tactile_ros.types import STATE_FIELDS, ContactState, ContactStates, Frame, Recording

if TYPE_CHECKING:
    from pathlib import Path

SPEC = enrolled_skin.SPEC
PATIENCE_S = 20.0


class Run:
    """A live run without ROS: frames, states, what was announced."""

    def __init__(self, path: Path) -> None:
        enrolled_skin.five_heads().save(path)
        self.first = SPEC.load(path)
        self.path = path
        self.presses = enrolled_skin.new_head()
        self.frames: list[Frame] = []
        self.states: list[ContactState] = []
        self.baselines: list[Frame] = []
        self.told: list[str] = []
        self.stage = ContactLoop(SPEC.load(path), 10, True, self.baselines.append)
        self.classes = Enrolment(
            self.stage, str(path), SPEC.load, self.first.digest, self._announce
        )
        self._announce()

    def _announce(self, change: ClassChange | None = None) -> None:
        told = {} if change is None else change.announcement()
        self.told.append(json.dumps({'sha256': self.stage.pipeline.digest, **told}))

    def press(self, number: int) -> None:
        for row in enrolled_skin.press_of(self.presses, number):
            self.frames.append(enrolled_skin.frame_of(len(self.frames), row))
            self.states.append(self.stage.process(self.frames[-1]))

    def learn(self, label: str, numbers: tuple[int, ...], replace: bool = False) -> EnrolResult:
        ended: queue.Queue[EnrolResult] = queue.Queue()
        self.classes.begin(
            EnrolRequest(label, len(numbers), PATIENCE_S, replace), lambda *_: None, ended.put
        )
        for number in numbers:
            self.press(number)
        return ended.get(timeout=PATIENCE_S)

    def loaded(self) -> LoadedRecording:
        rows = np.arange(len(self.frames))
        recording = Recording.from_arrays(
            self.presses.layout, [f.values for f in self.frames],
            stamp_ns=[f.stamp_ns for f in self.frames], sequence=rows,
        )  # fmt: skip
        columns = {
            name: np.array([getattr(state, name) for state in self.states])
            for name, (shape, _, _) in STATE_FIELDS.items() if shape[:1] != ('k',)
        }  # fmt: skip
        states = ContactStates.assemble(len(rows), 20, columns)
        return LoadedRecording(
            'run', recording, LiveContacts(rows, states, rows, 0), tuple(self.baselines),
            tuple(dict.fromkeys(json.loads(text)['sha256'] for text in self.told)),
            read_changes(self.told),
        )  # fmt: skip


@pytest.fixture(scope='module')
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    made = Run(tmp_path_factory.mktemp('run') / 'skin.npz')
    made.press(0)
    assert made.learn('mug', (1, 2)).success
    made.press(3)
    assert made.classes.forget('mug')[0]
    made.press(4)
    assert made.learn('cup', (5,)).success
    made.press(6)
    return made


def named(states: ContactStates) -> list[int]:
    return states.label[states.label >= 0].tolist()


def test_a_replay_learns_and_forgets_where_the_live_run_did(run: Run) -> None:
    loaded = run.loaded()
    # with the calibration that it began with, and with the one that it left
    for pipeline in (run.first, SPEC.load(run.path)):
        before = pipeline.digest
        replayed = replay(loaded, pipeline)
        assert replayed.problems == ()
        for name in ('label', 'label_probability', 'in_contact', 'status'):
            assert replayed.agreement is not None
            assert replayed.agreement.differences[name] == 0, name
        assert 5 in named(replayed.states)
        assert pipeline.digest == before
    changed = [(change.label, len(change.presses)) for change in loaded.changes]
    assert changed == [('mug', 2), ('mug', 0), ('cup', 1)]


def test_without_the_changes_it_is_another_run(run: Run) -> None:
    replayed = replay(replace(run.loaded(), changes=()), run.first)
    assert 5 not in named(replayed.states)
    assert 'several calibrations' in replayed.problems[0]


def test_presses_that_were_not_recorded_are_told(run: Run) -> None:
    loaded = run.loaded()
    late = loaded.recording.select(slice(300, None))
    live = loaded.contacts
    assert live is not None
    rows = np.arange(len(late))
    states = ContactStates.assemble(len(rows), 20, {})
    part = replace(loaded, recording=late, contacts=LiveContacts(rows, states, rows, 0))
    said = replay(part, run.first).problems
    assert any("'mug' could not be learned" in sentence for sentence in said)


@pytest.mark.parametrize(
    'text',
    ['', '[]', '{}', '{"enrolled": 3}', '{"enrolled": "mug"}', 'nan', '{"enrolled": "mug", '
     '"sha256": "x", "presses": [1]}', '[' * 10_000],
)  # fmt: skip
def test_announcements_that_make_no_sense_tell_no_change(text: str) -> None:
    assert read_changes([text]) == ()


def test_a_file_that_changed_since_is_not_overwritten(run: Run, tmp_path: Path) -> None:
    other = Run(tmp_path / 'skin.npz')
    SPEC.load(run.path).save(other.path)
    content = other.path.read_bytes()
    learned = other.learn('mug', (1,))
    assert not learned.success
    assert 'changed since it was read' in learned.message
    assert other.path.read_bytes() == content


def test_adding_and_replacing_presses(tmp_path: Path) -> None:
    run = Run(tmp_path / 'skin.npz')
    assert run.learn('mug', (1,)).success
    added = run.learn('mug', (2, 3))
    assert (added.success, added.index) == (True, 5)
    count = SPEC.load(run.path).estimation.recogniser_.enrolled_.label  # type: ignore[attr-defined]
    assert len(count) == 3
    assert run.learn('mug', (4,), replace=True).success
    count = SPEC.load(run.path).estimation.recogniser_.enrolled_.label  # type: ignore[attr-defined]
    assert len(count) == 1
    taken = run.learn('0', (5,))
    assert "label of enrol must be new; '0' is known from the fit" in taken.message
