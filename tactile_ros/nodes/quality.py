"""Quality of service of the topics: reliable and deep for data, latched for what describes it."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

LATCHED_TOPICS = ('layout', 'baseline', 'calibration')


# A profile is made anew for each use: rclpy writes what a parameter overrides into it.


def data() -> QoSProfile:
    """Frames and contacts: reliable, the last 1000."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=1000, reliability=ReliabilityPolicy.RELIABLE
    )


def latched(depth: int = 1) -> QoSProfile:
    """What describes the data: late subscribers get the last ones too."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def baselines() -> QoSProfile:
    """A recorder must get every baseline, also of tares that follow one another closely."""
    return latched(depth=100)


def overridable() -> QoSOverridingOptions:
    """Let `qos_overrides.<topic>.publisher.reliability` and its like change a profile."""
    return QoSOverridingOptions.with_default_policies()
