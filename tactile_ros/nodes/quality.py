"""Quality of service of the topics: reliable and deep for data, latched for what describes it."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

DATA = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=1000, reliability=ReliabilityPolicy.RELIABLE
)
LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# a recorder must get every baseline, also of tares that follow one another closely
BASELINES = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
LATCHED_TOPICS = ('layout', 'baseline', 'calibration')


def overridable() -> QoSOverridingOptions:
    """Let `qos_overrides.<topic>.publisher.reliability` and its like change a profile."""
    return QoSOverridingOptions.with_default_policies()
