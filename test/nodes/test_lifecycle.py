# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What all nodes share: callbacks and diagnostics that fail end nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from tactile_ros.nodes import lifecycle
from tactile_ros.nodes.lifecycle import ManagedNode, diagnostic

if TYPE_CHECKING:
    from conftest import Ros


class Fragile(ManagedNode):
    """Fails where it is told to."""

    def __init__(self) -> None:
        super().__init__('fragile')
        self.fails_at = ''
        self.did: list[str] = []
        for name in ('configure', 'activate', 'cleanup'):
            setattr(self, name, lambda name=name: self._do(name))

    def _do(self, name: str) -> None:
        self.did.append(name)
        if self.fails_at == name:
            msg = f'{name} failed'
            raise RuntimeError(msg)

    def diagnose(self) -> DiagnosticStatus:
        self._do('diagnose')
        return DiagnosticStatus(name='well')


def test_spin_tells_a_callback_that_fails_and_goes_on(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    ros.init()
    done: list[str] = []

    def broken() -> None:
        done.append('broken')
        msg = 'this callback fails'
        raise RuntimeError(msg)

    ros.listener.create_timer(0.01, broken)
    ros.listener.create_timer(0.01, lambda: done.append('well'))
    lifecycle.spin(ros.executor, lambda: done.count('well') > 3 and done.count('broken') > 1)
    assert 'this callback fails' in capfd.readouterr().err


def test_what_fails_to_configure_is_cleaned_up_and_tried_again(ros: Ros) -> None:
    ros.init()
    node = ros.add(Fragile())
    node.fails_at = 'configure'
    assert node.trigger_configure() == lifecycle.FAILURE
    assert node.did == ['configure', 'cleanup']
    node.fails_at = 'activate'
    assert node.trigger_configure() == lifecycle.SUCCESS
    assert node.trigger_activate() == lifecycle.FAILURE
    node.fails_at = ''
    assert node.trigger_activate() == lifecycle.SUCCESS


def test_diagnostics_that_fail_are_diagnostics_too(
    ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lifecycle, 'DIAGNOSTICS_PERIOD_S', 0.02)
    ros.init()
    node = ros.add(Fragile())
    heard: list[DiagnosticArray] = ros.hear(DiagnosticArray, '/diagnostics')
    node.fails_at = 'diagnose'
    node.trigger_configure()
    node.trigger_activate()
    assert ros.until(lambda: heard)
    status = heard[0].status[0]
    assert (status.name, status.level) == ('fragile: diagnostics', DiagnosticStatus.ERROR)
    assert status.message == 'RuntimeError: diagnose failed'
    node.fails_at = ''
    assert ros.until(lambda: heard[-1].status[0].name == 'fragile: well')


def test_values_are_texts_of_few_digits() -> None:
    status = diagnostic('part', 'well', {'a': 1 / 3, 'b': [1, 2], 'c': True})
    assert [pair.value for pair in status.values] == ['0.333333', '[1, 2]', 'True']
