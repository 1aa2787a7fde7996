"""Files of the checkout as modules."""

from __future__ import annotations

from pathlib import Path

import pytest

from tactile_ros.errors import MissingPackageError
from tactile_ros.evaluation.sources import load_source


def test_a_file_is_imported_once(tmp_path: Path) -> None:
    path = tmp_path / 'world_of_one.py'
    path.write_text('seen = []\n')
    load_source(path, 'a test').seen.append(1)
    assert load_source(path, 'a test').seen == [1]


@pytest.mark.parametrize('text', [None, 'import no_such_package\n'])
def test_what_is_missing_is_named(tmp_path: Path, text: str | None) -> None:
    path = tmp_path / 'world_of_none.py'
    if text is not None:
        path.write_text(text)
    with pytest.raises(MissingPackageError, match=r'bench x needs .*world_of_none\.py'):
        load_source(path, 'bench x')
