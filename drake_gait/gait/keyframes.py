"""Key frames with splines, as owners of a KHR-3HV edit motions."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.gait.family import AnyGait, Variable, setting
from drake_gait.gait.harmonics import Blending
from drake_gait.gait.joints import ANGLE_LIMITS, LEG_JOINTS, FloatArray
from drake_gait.gait.paper import Gait
from drake_gait.ranges import NONE

_LIMITS = dict(zip(LEG_JOINTS, ANGLE_LIMITS[[0, 1, 2, 3, 0]].tolist(), strict=True))
"""Range of each joint of a leg [rad], the paper's Table I."""
_MIRRORED = np.array([-1.0 if "roll" in joint else 1.0 for joint in LEG_JOINTS])
"""Signs of one leg's joints in the other leg."""
_PLAY = 0.45
"""Part of the gap to its neighbour by which a key frame may move: the order stays."""


@dataclass(frozen=True, kw_only=True)
class KeyFrames(Blending):
    """Angles of the left leg's joints in key frames of the cycle, with splines between them.

    The splines are periodic. The right leg does the same half a cycle later, mirrored.
    """

    name: ClassVar[str] = "keyframes"

    phases: tuple[float, ...] = setting((0.0, 0.25, 0.5, 0.75), lower=0.0, upper=1.0)
    """Key frames, as parts of the cycle that rise from 0 to below 1."""

    @cached_property
    def _variables(self) -> tuple[Variable, ...]:
        phases = self.phases
        rises = all(low < high for low, high in pairwise(phases))
        if len(phases) < 3 or not rises or phases[-1] >= 1.0:
            raise SettingsError(
                "phases of the gait family keyframes must be at least 3 that rise from 0 to below "
                f"1, got {list(phases)}"
            )
        angles = [
            Variable(f"{joint}_{number}", lower=_LIMITS[joint][0], upper=_LIMITS[joint][1])
            for joint in LEG_JOINTS
            for number in range(1, len(self.phases) + 1)
        ]
        around = np.array([phases[-1] - 1.0, *phases, phases[0] + 1.0])
        gaps = _PLAY * np.minimum(np.diff(around)[:-1], np.diff(around)[1:])
        moments = [
            Variable(f"phase_{number}", NONE, lower=phase - gap, upper=phase + gap, default=phase)
            for number, (phase, gap) in enumerate(zip(phases, gaps.tolist(), strict=True), 1)
        ]
        return (*angles, *moments)

    @property
    def variables(self) -> Sequence[Variable]:
        """Angles of each joint in every key frame, then the key frames' phases."""
        return self._variables

    def like(self, gait: AnyGait) -> dict[str, float]:
        """Return key frames taken from the left leg of a gait of the paper's family."""
        if not isinstance(gait, Gait):
            return super().like(gait)
        waveforms = gait.waveforms(np.array(self.phases) * gait.family.period)
        return {
            f"{joint}_{number}": value
            for joint, column in zip(LEG_JOINTS, (0, 1, 2, 3, 0), strict=True)
            for number, value in enumerate(waveforms[:, column].tolist(), 1)
        }

    def leg(self, x: FloatArray, phase: FloatArray) -> FloatArray:
        """Return the left leg's angles at phases, shape (k, 5) [rad], inside their ranges.

        Args:
            x: Values of the variables [SI].
            phase: Parts of a cycle, shape (k,).
        """
        from scipy.interpolate import CubicSpline  # Its import is the size of a robot.

        count = len(self.phases)
        angles = np.reshape(x[: 5 * count], (5, count)).T
        knots = np.append(x[5 * count :], x[5 * count] + 1.0)
        spline = CubicSpline(knots, np.vstack([angles, angles[:1]]), bc_type="periodic")
        low, high = np.array([_LIMITS[joint] for joint in LEG_JOINTS]).T
        held: FloatArray = np.clip(spline(phase), low, high)
        return held

    def commands(self, x: FloatArray) -> FloatArray:
        """Return the commands: both legs half a cycle apart, grown and shrunk."""
        phase = self.times(x) / self.period
        of_roll, of_legs = self.factors(x)
        factors = np.column_stack([of_roll, of_legs, of_legs, of_legs, of_roll])
        left = factors * self.leg(x, phase)
        right = factors * _MIRRORED * self.leg(x, phase + 0.5)
        return np.hstack([right, left])
