"""What RViz shows of a state: taxels, the contact and its force."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

if TYPE_CHECKING:
    from std_msgs.msg import Header

    from tactile_ros.types import Array, ContactState, Layout

METRES_PER_NEWTON = 5e-3
TAXEL_SIZE = 2e-3
GREY = ColorRGBA(r=0.6, g=0.6, b=0.6, a=0.8)
ORANGE = ColorRGBA(r=1.0, g=0.5, b=0.0, a=0.9)
BLUE = ColorRGBA(r=0.1, g=0.4, b=1.0, a=0.9)


def _point(xyz: Array) -> Point:
    """Point of three numbers."""
    x, y, z = xyz.tolist()
    return Point(x=x, y=y, z=z)


def _marker(header: Header, name: str, kind: int, color: ColorRGBA) -> Marker:
    """Marker at the sensor's origin, not there yet."""
    marker = Marker(header=header, ns=name, id=0, type=kind, action=Marker.DELETE, color=color)
    marker.pose.orientation.w = 1.0
    return marker


def contact_markers(header: Header, layout: Layout, state: ContactState) -> MarkerArray:
    """Taxels as points, the contact as a ball of two sigma, its force as an arrow.

    Parameters
    ----------
    header : Header
        Of the frame.
    layout : Layout
        Where the taxels are.
    state : ContactState
        What is not estimated is not shown.

    Returns
    -------
    MarkerArray
        Always the same three markers, deleted where there is nothing to show.
    """
    taxels = _marker(header, 'taxels', Marker.POINTS, GREY)
    taxels.action = Marker.ADD
    taxels.scale.x = taxels.scale.y = TAXEL_SIZE
    taxels.points = [_point(xyz) for xyz in layout.positions]
    ball = _marker(header, 'contact', Marker.SPHERE, ORANGE)
    arrow = _marker(header, 'force', Marker.ARROW, BLUE)
    place = np.where(np.isfinite(state.position), state.position, 0.0)
    if np.isfinite(state.position).any() and state.in_contact != 0:
        ball.action = Marker.ADD
        ball.pose.position = _point(place)
        sigma = np.sqrt(np.diagonal(state.position_cov))
        size = 2 * np.where(np.isfinite(sigma), np.maximum(sigma, 5e-4), 1e-3)
        ball.scale.x, ball.scale.y, ball.scale.z = size.tolist()
    force = np.where(np.isfinite(state.force), state.force, 0.0)
    if force.any():
        arrow.action = Marker.ADD
        arrow.points = [_point(place), _point(place + METRES_PER_NEWTON * force)]
        arrow.scale.x, arrow.scale.y = 1e-3, 2e-3
    return MarkerArray(markers=[taxels, ball, arrow])
