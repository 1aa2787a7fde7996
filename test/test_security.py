# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What docs/security.md promises: no code from data, no shell, names by a pattern, all escaped."""

import ast
import dataclasses
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

import tactile_ros
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.recording_files import load_recording, save_recording
from tactile_ros.evaluation.truth import held_labels
from tactile_ros.types import Layout, Recording, admit_name
from tactile_ros.types.frame import MOST_CHARACTERS

PACKAGE = Path(tactile_ros.__file__).parent
ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted(
    path
    for folder in (PACKAGE, ROOT / 'benchmarks', ROOT / 'launch', ROOT / 'bootstrap')
    for path in folder.rglob('*.py')
)
SCRIPT = '<script>alert(1)</script>'
# what turns data into code or hands it to a shell
FORBIDDEN = {
    'eval', 'exec', 'compile', '__import__', 'os.system', 'os.popen', 'yaml.load',
    'yaml.full_load', 'yaml.unsafe_load', 'yaml.load_all', 'pickle.load', 'pickle.loads',
    'subprocess.getoutput', 'subprocess.getstatusoutput', 'marshal.loads', 'shelve.open',
    'asyncio.create_subprocess_shell',
}  # fmt: skip
DYNAMIC = {'pickle', 'marshal', 'shelve', 'dill', 'cloudpickle', 'joblib'}
LOCAL = ('127.0.0.1', 'localhost', '::1')


def dotted(node: ast.expr) -> str:
    """Name of a function; of what it is called on, as far as that is names."""
    if isinstance(node, ast.Attribute):
        return f'{dotted(node.value)}.{node.attr}'
    return node.id if isinstance(node, ast.Name) else ''


@cache
def nodes(path: Path) -> list[ast.Import | ast.ImportFrom | ast.Call]:
    """Imports and calls of a file."""
    kinds = ast.Import, ast.ImportFrom, ast.Call
    return [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, kinds)]


def offences(path: Path) -> list[str]:
    """What a file does that it must not."""
    found = []
    for call in nodes(path):
        if not isinstance(call, ast.Call):
            names = [getattr(call, 'module', None) or alias.name for alias in call.names]
            dynamic = [name for name in names if name.split('.')[0] in DYNAMIC]
            found += [f'{path}:{call.lineno} imports {name}' for name in dynamic]
            continue
        name = dotted(call.func)
        if name in FORBIDDEN:
            found.append(f'{path}:{call.lineno} calls {name}')
        for keyword in call.keywords:
            value = keyword.value.value if isinstance(keyword.value, ast.Constant) else None
            if keyword.arg == 'shell' and value is not False:
                found.append(f'{path}:{call.lineno} starts a shell')
            if keyword.arg == 'allow_pickle' and value is not False:
                found.append(f'{path}:{call.lineno} allows pickles')
        if name.endswith(('.bind', 'HTTPServer', 'create_server')):
            place = ast.dump(call.args[0]) if call.args else ''
            if not any(repr(local) in place for local in LOCAL):
                found.append(f'{path}:{call.lineno} listens beyond this machine')
    return found


def test_nothing_turns_data_into_code_or_starts_a_shell(tmp_path: Path) -> None:
    assert [found for path in SOURCES for found in offences(path)] == []
    for number, line in enumerate((
        'import os\nos.system("ls")', 'subprocess.run("ls", shell=True)', 'eval("1")',
        'yaml.load(text)', 'np.load(path, allow_pickle=True)', 's.bind(("0.0.0.0", 80))',
        's.bind(("", 80))', 'subprocess.run("ls", shell=flag)', 'import pickle',
        'from joblib import load',
    )):  # fmt: skip
        path = tmp_path / f'bad_{number}.py'
        path.write_text(line)
        assert offences(path), line
    path = tmp_path / 'good.py'
    path.write_text('s.bind(("127.0.0.1", 80))\nsubprocess.run(["ls"], shell=False)')
    assert offences(path) == []


@pytest.mark.parametrize(
    'name', ['', 'thumb/tip', 'Würfel 3', 'u_AC', 'rad/s^2', 'A7-#12', '指', 'a' * MOST_CHARACTERS]
)
def test_names_that_people_use_are_names(name: str) -> None:
    assert admit_name('label', name) == name


@pytest.mark.parametrize(
    'name',
    [SCRIPT, 'a"b', "a'b", 'a&b', 'a;b', '$(ls)', '`ls`', 'a\nb', 'a\x00b', 'a\u202eb', 'a\\b',
     'a' * (MOST_CHARACTERS + 1)],
)  # fmt: skip
@pytest.mark.parametrize('field', ['frame_id', 'serial', 'sensor', 'unit', 'channels', 'label'])
def test_other_names_are_refused_everywhere(field: str, name: str) -> None:
    plain, none = Layout(np.zeros((1, 3)), ('x',), 'T'), np.zeros(1, np.int64)
    value = (name,) if field == 'channels' else name
    use = partial(dataclasses.replace, plain, **{field: value})
    if field == 'label':
        use = partial(held_labels, [name], none, none, ())
    with pytest.raises((ValueError, RecordingError), match='letters, digits, spaces'):
        use()


@pytest.mark.parametrize('field', ['frame_id', 'serial', 'sensor'])
def test_a_file_with_such_a_name_is_refused(field: str, tmp_path: Path) -> None:
    layout = Layout(np.zeros((1, 3)), ('x',), 'T')
    object.__setattr__(layout, field, SCRIPT)
    path = tmp_path / 'hostile.npz'
    save_recording(Recording.from_arrays(layout, np.zeros((2, 1, 1))), path)
    with pytest.raises(RecordingError, match=f'{field} of Layout must be at most'):
        load_recording(path)


def test_what_is_written_goes_through_it() -> None:
    """Bags are written as they come; everything else is whole or not there."""
    direct = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob('*.py')
        for node in nodes(path)
        if isinstance(node, ast.Call)
        if dotted(node.func).endswith(
            ('.write_text', '.write_bytes', 'np.savez', 'np.savez_compressed')
        )
    }
    assert direct <= {'calibration.py', 'evaluation/recording_files.py', 'evaluation/bag.py'}
