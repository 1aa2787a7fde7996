# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Compiled loops: the same numbers with and without a compiler, and anew where sources changed."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tactile_ros.physics import compiled


def test_without_a_compiler_a_function_stays_what_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, 'numba', None)
    assert compiled.compiled(abs) is abs


def test_an_index_beyond_an_array_is_refused_as_it_is_without_a_compiler() -> None:
    # arrays of a calibration file may be of any shape: nothing beyond them is read or written
    row = compiled.compiled(lambda x, i: x[i])
    for index in (3, -4, 1 << 40):
        with pytest.raises(IndexError):
            row(np.zeros(3), index)


HEAD = 'from tactile_ros.physics.compiled import compiled\n'
INNER = HEAD + '@compiled\ndef inner(x):\n    return x + {}\n'
OUTER = HEAD + 'from inner_rows import inner\n@compiled\ndef outer(x):\n    return inner(x)\n'


def started_anew(folder: Path, added: int) -> ModuleType:
    """The function `outer` as a new process has it; its callee in another file adds a number."""
    (folder / 'inner_rows.py').write_text(INNER.format(added))
    if not (folder / 'outer_rows.py').exists():
        (folder / 'outer_rows.py').write_text(OUTER)
    importlib.invalidate_caches()
    for name in ('inner_rows', 'outer_rows'):
        sys.modules.pop(name, None)
    return importlib.import_module('outer_rows')


@pytest.mark.skipif(not compiled.AVAILABLE, reason='numba is not installed')
def test_what_is_kept_on_disk_is_of_the_callees_as_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # numba itself looks at the file of `outer` alone
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, 'dont_write_bytecode', True)
    for added in (1, 20):
        module = started_anew(tmp_path, added)
        assert module.outer(1) == 1 + added
    again = started_anew(tmp_path, 20)
    assert again.outer(1) == 21
    assert sum(again.outer.stats.cache_hits.values()) == 1
