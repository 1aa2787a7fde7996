# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Start the processes of a graph: here with this interpreter, or by the launch files.

`launch` comes with ROS 2 alone, so it is imported where it is used.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

from tactile_ros.errors import TactileError
from tactile_ros.nodes.graph import PACKAGE, Graph, Process

if TYPE_CHECKING:
    from launch.actions import DeclareLaunchArgument
    from launch.events.process import ProcessExited
    from launch_ros.actions import Node

    from launch import LaunchContext

T = TypeVar('T')
N = TypeVar('N', int, float)
STOP_S = 20.0  # a recorder writes its index at the end
STARTED_BY = 'TACTILE_STARTED_BY'  # environment variable: process id of who started a node
PR_SET_PDEATHSIG = 1  # linux/prctl.h
MOST_LINES = 2000
TRUE_OR_FALSE = ['true', 'false']
LEVELS = ('debug', 'info', 'warn', 'error', 'fatal')
FILES = ('params_file', 'calibration', 'calibrations')
RESPAWNED = ('sensor_node', 'contact_node', 'stack')
RESPAWN_DELAY_S = 2.0
REFUSALS = (1, 2)  # exit codes of a node that can never run so
LEVEL = ('log_level', 'info', 'how much the nodes say', LEVELS)


class Running:
    """Processes of a graph, by the names that it gives them; a context manager that stops them.

    `environment` changes that of the processes; `hear` takes (executable, line) of all they print.
    """

    def __init__(
        self, graph: Graph, environment: Mapping[str, str] | None = None,
        hear: Callable[[str, str], None] | None = None,
    ) -> None:  # fmt: skip
        self.graph = graph
        self.lines: dict[str, list[str]] = {graph.name_of(p): [] for p in graph.processes}
        own = {'PYTHONUNBUFFERED': '1', STARTED_BY: str(os.getpid())}
        self._environment = {**os.environ, **own, **(environment or {})}
        self._hear = hear
        self.children: dict[str, subprocess.Popen[str]] = {}
        self._threads: dict[str, threading.Thread] = {}
        self._spoken = threading.Condition()

    def __enter__(self) -> Running:
        try:
            for process in self.graph.processes:
                self.start(process)
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, process: Process) -> None:
        """Start one process, anew where it ended; from a thread that stays: its end is theirs."""
        # A group of its own: Ctrl-C reaches this program alone, which stops the others in order.
        child = subprocess.Popen(
            process.command(), env=self._environment, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors='replace',
            start_new_session=True,
        )  # fmt: skip
        name = self.graph.name_of(process)
        self.children[name] = child
        reader = threading.Thread(None, self._listen, name, (name, child), daemon=True)
        self._threads[name] = reader
        reader.start()

    def _listen(self, name: str, child: subprocess.Popen[str]) -> None:
        assert child.stdout is not None
        with child.stdout:
            for line in child.stdout:
                with self._spoken:
                    self.lines[name] = [*self.lines[name][-MOST_LINES:], line.rstrip()]
                    self._spoken.notify_all()
                if self._hear is not None:
                    self._hear(name, line.rstrip())

    def wait_for_line(self, executable: str, text: str, timeout: float) -> str:
        """Line of a process that holds `text`; TactileError if none comes in `timeout` (s)."""

        def found() -> str | None:
            return next((line for line in self.lines[executable] if text in line), None)

        with self._spoken:
            line = self._spoken.wait_for(found, timeout)
        if line is None:
            heard = '; '.join(f'{name} said: {self._last(name)}' for name in self.lines)
            msg = f'{executable} did not say {text!r} within {timeout:g} s; {heard}'
            raise TactileError(msg)
        return line

    def _last(self, name: str) -> str:
        return ' | '.join(self.lines[name][-3:]) or 'nothing'

    def is_alive(self, executable: str) -> bool:
        """A process has not ended yet."""
        return self.children[executable].poll() is None

    def stop(self, executables: Sequence[str] = ()) -> dict[str, int]:
        """Stop processes, the recorder after all others, and return their exit codes."""
        names, codes = list(executables) or list(self.children), {}
        for group in ([n for n in names if n != 'record'], [n for n in names if n == 'record']):
            for name in group:  # not SIGINT: a Python that still starts answers with a traceback
                self.children[name].terminate()
            for name in group:
                child = self.children[name]
                try:
                    codes[name] = child.wait(STOP_S)
                except subprocess.TimeoutExpired:
                    child.kill()
                    codes[name] = child.wait()
                self._threads[name].join(STOP_S)
        return codes


def end_with_parent() -> None:
    """Let the end of this process's parent, also by SIGKILL, end this process; on Linux alone."""
    if sys.platform != 'linux':
        return
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.environ.get(STARTED_BY, str(os.getppid())) != str(os.getppid()):
        sys.exit('what started this node has ended')  # before it could tell


def declared(defaults: object) -> list[DeclareLaunchArgument]:
    """Launch arguments for the choices of a graph, and `log_level`."""
    from launch.actions import DeclareLaunchArgument

    rows = [
        (f.name, getattr(defaults, f.name), f.metadata['help'], f.metadata.get('choices', ()))
        for f in fields(defaults)  # type: ignore[arg-type]
        if f.metadata
    ]
    arguments = []
    for name, default, text, choices in [*rows, LEVEL]:
        value = str(default).lower() if isinstance(default, bool) else str(default)
        limits = list(TRUE_OR_FALSE if isinstance(default, bool) else choices) or None
        arguments.append(
            DeclareLaunchArgument(name, default_value=value, description=text, choices=limits)
        )
    return arguments


def chosen(context: LaunchContext, defaults: T) -> T:
    """Dataclass of what the arguments say, each in the type of its default.

    ValueError for what is no number, or a file that cannot be read.
    """
    values: dict[str, Any] = {}
    for name, default in vars(defaults).items():
        text = context.launch_configurations.get(name)
        if text is None:
            continue
        if isinstance(default, (bool, str)):
            values[name] = text if isinstance(default, str) else text == 'true'
        else:
            values[name] = number_of(name, text, type(default))
        if name in FILES and text and not os.access(text, os.R_OK):
            msg = f'{name} must be a path that can be read; received {text!r}'
            raise ValueError(msg)
    return replace(defaults, **values)  # type: ignore[type-var]


def number_of(name: str, text: str, kind: type[N]) -> N:
    """Number of an argument; ValueError with its name."""
    try:
        return kind(text)
    except ValueError:
        msg = f'{name} must be a {"whole " if kind is int else ""}number; received {text!r}'
        raise ValueError(msg) from None


def node_of(process: Process, log_level: str, respawn: bool = False) -> Node:
    """Action of a process of the graph; nodes of sensors are started again where `respawn`.

    One that refuses its parameters or files ends the launch with code 1, a grip that ends ends it.
    """
    from launch.actions import Shutdown
    from launch_ros.actions import Node

    is_grip = 'grip_node' in process.nodes
    again = respawn and process.executable in RESPAWNED and not is_grip

    def end(event: ProcessExited, context: LaunchContext) -> list[Shutdown]:
        if context.is_shutdown:
            return []
        if event.returncode in REFUSALS:
            msg = f'{process.executable} ended with code {event.returncode}; it said why'
            raise RuntimeError(msg)
        return [Shutdown(reason=f'{process.executable} ended')] if is_grip else []

    files = [process.params_file] if process.params_file else []
    return Node(
        package=PACKAGE, executable=process.executable, namespace=process.namespace,
        parameters=[*files, dict(process.parameters)], output='screen', on_exit=end,
        arguments=['--ros-args', '--log-level', log_level],
        respawn=again, respawn_delay=RESPAWN_DELAY_S,
    )  # fmt: skip
