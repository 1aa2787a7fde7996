"""How far a command is: a bar on a terminal, a line for each step elsewhere."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from tactile_ros.types import Closing

if TYPE_CHECKING:
    from rich.progress import Progress as Bar


class Progress(Closing):
    """Progress of a number of steps, on standard error; a context manager.

    Parameters
    ----------
    steps : int
        Nothing is shown for a single one.
    """

    def __init__(self, steps: int) -> None:
        self.steps, self.made = steps, 0
        self._bar = _bar(steps) if steps > 1 and sys.stderr.isatty() else None

    def step(self, what: str, failure: str = '') -> None:
        """One more step is made; of a failed one why."""
        self.made += 1
        text = f'{what} failed: {failure}' if failure else what
        if self._bar is not None:
            if failure:
                self._bar.console.print(text, markup=False)
            self._bar.advance(self._bar.task_ids[0])
        elif self.steps > 1:
            print(f'[{self.made}/{self.steps}] {text}', file=sys.stderr, flush=True)

    def close(self) -> None:
        """End the bar."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


def _bar(steps: int) -> Bar | None:
    """A running bar, where rich is installed."""
    try:
        from rich.console import Console
        from rich.progress import Progress as Bar
    except ImportError:
        return None
    bar = Bar(console=Console(stderr=True))
    bar.add_task('recordings', total=steps)
    bar.start()
    return bar
