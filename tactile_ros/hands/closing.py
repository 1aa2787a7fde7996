"""From closures to joints: along the synergy, or so that the pad moves along its own normal."""

from __future__ import annotations

from math import exp
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.hands.finger import Finger
    from tactile_ros.hands.urdf import Chain
    from tactile_ros.types import Array

DAMPING = 5e-3  # m per rad: near a singular posture the motion fades instead of racing
EASE_S = 0.5  # time constant in which a finger that began beside its path joins it


class Synergy:
    """Joints on the path of the finger; the first target is where the joints are.

    Parameters
    ----------
    finger : Finger
        Whose joints move.
    """

    def __init__(self, finger: Finger) -> None:
        self.finger = finger
        self._beside = np.zeros(len(finger.joints))

    def start(self, position: Array) -> float:
        """Begin at measured joints (n,); the closure that is nearest."""
        closure = self.finger.closure_of(position)
        self._beside = position - self.finger.posture(closure)
        return closure

    def joints(self, closure: float, dt: float) -> Array:
        """Joint targets (n,) of a closure, a time dt (s) after the last."""
        self._beside = self._beside * exp(-dt / EASE_S)
        return self.finger.posture(closure) + self._beside


class PadNormal(Synergy):
    """Beyond the pre-grasp posture the pad moves along its normal, as far as the synergy would.

    Parameters
    ----------
    finger : Finger
        Whose joints move.
    chain : Chain
        Of its pad, z out of the skin.
    lower, upper : ndarray, shape (n,)
        Limits of its joints.

    Notes
    -----
    Damped least squares: dq = J^T (J J^T + d^2 I)^-1 n, with n the pad's normal in the base, made
    as long as the synergy, so that speeds and gains of the closure keep their meaning. Where
    it would open what the synergy closes, the synergy is followed. The singular values of J
    carry the solution: no matrix is inverted.
    """

    def __init__(self, finger: Finger, chain: Chain, lower: Array, upper: Array) -> None:
        super().__init__(finger)
        self._chain = chain
        self._lower, self._upper = lower, upper
        self._turned = np.zeros(len(finger.joints))  # what the normal has led beside the synergy
        self._closure = 0.0

    def start(self, position: Array) -> float:
        """Begin at measured joints (n,); the closure that is nearest."""
        self._closure = super().start(position)
        self._turned = np.zeros_like(position)
        return self._closure

    def direction(self, position: Array) -> Array:
        """Motion of the joints (n,) per closure at joint positions (n,)."""
        pose, jacobian = self._chain.pose_and_jacobian(position)
        u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
        step: Array = vt.T @ (s / (s**2 + DAMPING**2) * (u.T @ pose[:3, 2]))
        length, synergy = float(np.linalg.norm(step)), self.finger.slope
        if not length > 0 or step @ synergy <= 0:
            return synergy
        return step * (np.linalg.norm(synergy) / length)

    def joints(self, closure: float, dt: float) -> Array:
        """Joint targets (n,) of a closure, a time dt (s) after the last."""
        corner = self.finger.corner
        on_path = super().joints(closure, dt)
        moved = max(closure, corner) - max(self._closure, corner)
        self._closure = closure
        turned = self._turned + moved * (
            self.direction(on_path + self._turned) - self.finger.slope
        )
        if closure <= corner:
            turned = self._turned * exp(-dt / EASE_S)
        position = np.clip(on_path + turned, self._lower, self._upper)
        self._turned = position - on_path
        return position
