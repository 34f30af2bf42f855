"""Walks that are computed in no time, or slept, for benchmarks of what is around them.

They drift with the ground and by noise, and go further the further x0 is; so a search has to learn.
"""

import time
from dataclasses import replace

import numpy as np

from drake_gait.execution.base import Timed
from drake_gait.problem import Trial
from drake_gait.study.settings import StudySettings
from drake_gait.walk import Measures, Outcome, Walk

_SWAY, _NOISE, _FALLS = 0.6, 0.03, 0.15
"""Drift on a ground for each unit of x0, and noise, in limits; share of walks that fall."""


class StandIn:
    """Walks a study's trials without a robot.

    Args:
        settings: The study.
        seconds: What a walk takes; it is slept, so that 256 cost no processor.
    """

    def __init__(self, settings: StudySettings, seconds: float = 0.0) -> None:
        self.settings, self.seconds = settings, seconds

    def __call__(self, trial: Trial) -> Walk:
        """Walk a trial."""
        time.sleep(self.seconds)
        settings = self.settings
        x = settings.space.encode(trial.candidate)
        slipperiness = (trial.settings.friction - 1.0) / max(settings.confirmation.friction, 1e-9)
        rng = np.random.default_rng([abs(int(1e9 * one)) for one in (*x, slipperiness)])
        limit = next(one for one in settings.constraints.given if one.quantity.name == "lateral")
        drift = 0.5 + x[1] + _SWAY * x[0] * slipperiness + _NOISE * rng.standard_normal()
        if rng.random() < _FALLS:
            return replace(_LEVEL, outcome=Outcome.FELL, frames=120, forward=0.1, com_height=0.2)
        forward = 0.2 + 0.05 * x[0] - 0.004 * float((x[2:8] ** 2).sum())
        return replace(
            _LEVEL, forward=forward, lateral=float(limit.upper * drift), yaw=0.01 * float(x[2])
        )

    def timed(self, trial: Trial) -> Timed:
        """Walk a trial, and say how long it took [s]."""
        start = time.perf_counter()
        return self(trial), time.perf_counter() - start


_MEASURES = Measures(
    energy=30.0,
    positive_energy=20.0,
    cost_of_transport=5.0,
    peak_torque=1.0,
    peak_speed=5.0,
    saturated_fraction=0.0,
    slip=(0.004, 0.004),
    clearance=(0.004, 0.004),
    duty_factor=(0.6, 0.6),
    peak_ground_reaction=20.0,
    toe_range=(0.1, 0.1, 0.1, 0.1),
    torso_tilt=0.1,
)
_LEVEL = Walk(
    outcome=Outcome.WALKED,
    frames=240,
    forward=0.2,
    lateral=0.0,
    yaw=0.0,
    com_height=0.2445,
    yaw_swing=0.1,
    measures=_MEASURES,
)
