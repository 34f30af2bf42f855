"""A servo's numbers from a log of its commands and angles, while it moves a known load.

One joint is simulated with the equations of `servo.Servo`. Least squares fits its unknowns:

    (inertia + rotor) dv/dt = servo(q_d(t - delay) + zero, q, v) - gravity_torque sin(q - hanging)
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from drake_gait.errors import SettingsError
from drake_gait.gait import FloatArray
from drake_gait.hardware.servo_log import Load, ServoLog
from drake_gait.servo import CREEP, Servo
from drake_gait.study.keys import SERVO

_COARSE, _FINE = 0.002, 0.0005
"""Steps of the simulation [s]: to look around with, and to fit with.

With steps of 1 ms the stiffness is found 0.6 % too high, with 0.5 ms less than a tenth of that.
"""
_LEAST_EXPLAINED = 0.8  # of the variance of the angle
_QUANTILE = 1.96  # of the normal distribution, for 95 %

_UNKNOWN = ("stiffness", "damping", "coulomb_friction", "delay")
"""Fields of Servo that are fitted; the joint's zero and its angle at the beginning come on top."""
_LOWER = (0.1, 1e-4, 0.0, 0.0, -0.3, -math.pi)
_UPPER = (500.0, 20.0, 2.0, 0.1, 0.3, math.pi)
_CHANGES = (1e-2, 1e-3, 5e-4, 2e-4, 1e-4, 1e-4)
"""By how much each unknown is changed for its derivative; friction is not smooth in less."""
_SCALES = (10.0, 0.1, 0.02, 0.01, 0.01, 0.01)
_STARTS = [
    (stiffness, 0.2, 0.02, delay) for stiffness in (8.0, 30.0) for delay in (0.0, 0.02, 0.05)
]


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """An unknown with its interval."""

    value: float
    """Its most probable value, in SI units."""
    lower: float
    """Lower end of the interval that has it with 95 %."""
    upper: float
    """Upper end."""


@dataclass(frozen=True, kw_only=True)
class Identification:
    """A servo as a log shows it."""

    estimates: dict[str, Estimate]
    """Stiffness, damping, coulomb_friction and delay, as fields of Servo."""
    no_load_speed: float
    """What was given [rad/s]."""
    zero: float
    """Angle that was measured minus the one that was meant by a command [rad]."""
    rms: float
    """Root mean square of what the model does not explain [rad]."""

    def servo(self) -> Servo:
        """Return the servo, to be simulated with."""
        values = {name: one.value for name, one in self.estimates.items()}
        return Servo(no_load_speed=self.no_load_speed, **values)

    def section(self) -> str:
        """Return the section of a study's file, with the intervals as remarks."""
        keys = {field: (key, unit) for key, (field, unit) in SERVO.items()}
        lines = ["[servo]"]
        for name, one in self.estimates.items():
            key, unit = keys[name]
            value, lower, upper = (x / unit.si for x in (one.value, one.lower, one.upper))
            lines.append(f"{key} = {value:.4g}  # 95 %: {lower:.4g} to {upper:.4g}")
        lines.append(f"{keys['no_load_speed'][0]} = {self.no_load_speed:g}  # as given")
        return "\n".join(lines)


def identify(log: ServoLog, load: Load, name: str = "the log") -> Identification:
    """Fit a servo to a log.

    Args:
        log: Commands and angles.
        load: What is known.
        name: Name of the log, for messages.

    Raises:
        SettingsError: the servo does not follow its commands, or the log leaves an unknown open.
    """
    first = float(log.angles[0])
    lower, upper = np.array(_LOWER), np.array(_UPPER)
    lower[-1], upper[-1] = first - 0.1, first + 0.1

    def residuals(unknowns: FloatArray, step: float) -> FloatArray:
        return simulated(log, load, unknowns, step) - log.angles

    def jacobian(unknowns: FloatArray, step: float) -> FloatArray:
        own = residuals(unknowns, step)
        columns = []
        for place, change in enumerate(_CHANGES):
            changed = unknowns.copy()
            changed[place] += change
            columns.append((residuals(changed, step) - own) / change)
        return np.array(columns).T

    def fit(start: FloatArray, step: float) -> OptimizeResult:
        return least_squares(
            residuals,
            start,
            jac=jacobian,
            bounds=(lower, upper),
            x_scale=_SCALES,
            args=(step,),
            max_nfev=40,
            ftol=1e-6,
            xtol=1e-6,
        )

    starts = sorted(
        (np.array([*start, 0.0, first]) for start in _STARTS),
        key=lambda start: float(np.sum(residuals(start, _COARSE) ** 2)),
    )
    # Friction makes hollows beside each other: the second best start finds another one.
    near = min((fit(start, _COARSE) for start in starts[:2]), key=lambda found: float(found.cost))
    best = fit(np.clip(near.x, lower, upper), _FINE)
    unknowns, left = best.x, best.fun
    explained = 1.0 - float(np.var(left) / np.var(log.angles))
    if not explained > _LEAST_EXPLAINED:
        raise SettingsError(
            f"{name}: no servo moves so; the best one explains {100.0 * max(explained, 0.0):.0f} % "
            "of its motion. Look at signs and units of command_deg and angle_deg, and at the load"
        )
    half = _half_widths(jacobian(unknowns, _FINE), left)
    _check_determined(name, unknowns, half)
    estimates = {
        field: Estimate(
            value=float(value),
            lower=float(max(value - width, 0.0)),
            upper=float(value + width),
        )
        for field, value, width in zip(_UNKNOWN, unknowns, half, strict=False)
    }
    return Identification(
        estimates=estimates,
        no_load_speed=load.no_load_speed,
        zero=float(unknowns[len(_UNKNOWN)]),
        rms=float(np.sqrt(np.mean(left**2))),
    )


def _half_widths(jacobian: FloatArray, left: FloatArray) -> FloatArray:
    """Return half the widths of the intervals of 95 %, shape (unknowns,).

    The covariance is that of linear least squares. Residuals that follow each other count for less:
    as those of a first-order autoregression, (1 - r) / (1 + r) of their number.
    """
    count, unknowns = jacobian.shape
    power = float(left @ left)
    variance = power / (count - unknowns)
    correlation = float(left[1:] @ left[:-1]) / max(power, 1e-300)
    correlation = min(max(correlation, 0.0), 0.99)
    try:
        covariance = np.linalg.inv(jacobian.T @ jacobian)
    except np.linalg.LinAlgError:
        return np.full(unknowns, np.inf)
    inflated = variance * (1.0 + correlation) / (1.0 - correlation) * np.diag(covariance)
    found: FloatArray = _QUANTILE * np.sqrt(np.where(inflated >= 0.0, inflated, np.inf))
    return found


def _check_determined(name: str, unknowns: FloatArray, half: FloatArray) -> None:
    """Refuse a fit whose stiffness or damping could as well be nothing, or twice as much."""
    for place, cure in ((0, "a heavier load, or faster sines"), (1, "steps, and faster sines")):
        if not half[place] < unknowns[place]:
            raise SettingsError(
                f"{name} does not determine the {_UNKNOWN[place]}: {unknowns[place]:.3g} "
                f"± {half[place]:.2g}; record {cure}"
            )


def simulated(
    log: ServoLog, load: Load, unknowns: FloatArray, longest: float = _FINE
) -> FloatArray:
    """Return the angles of a servo at the times of a log [rad], shape (n,).

    Args:
        log: Times and commands.
        load: What is known.
        unknowns: Stiffness, damping, friction, delay, zero, and the angle at the beginning.
        longest: Longest step of the simulation [s].
    """
    stiffness, damping, friction, delay, zero, angle = unknowns.tolist()
    spans = np.diff(log.times)
    counts = np.ceil(spans / longest - 1e-9).astype(int)
    lengths: FloatArray = np.repeat(spans / counts, counts)
    ends = log.times[0] + np.cumsum(lengths)
    targets = np.interp(ends - 0.5 * lengths - delay, log.times, log.commands) + zero
    inertia = load.inertia + load.rotor_inertia
    gravity, hanging, stall = load.gravity_torque, load.hanging, load.stall_torque
    back_emf = stall / load.no_load_speed
    speed, path = 0.0, []
    for target, step in zip(targets.tolist(), lengths.tolist(), strict=True):
        # The middle of the step counts, its spring and dampers with the speed that comes of it.
        outside = -gravity * math.sin(angle + 0.5 * step * speed - hanging) - back_emf * speed
        spring = stiffness * (target - angle - 0.5 * step * speed)
        asked = spring - damping * speed
        if -stall < asked < stall:
            mass = inertia + 0.5 * step * (damping + back_emf) + 0.25 * step * step * stiffness
            free = speed + step * (asked + outside) / mass
        else:
            mass = inertia + 0.5 * step * back_emf
            free = speed + step * (math.copysign(stall, asked) + outside) / mass
        most = step * friction / mass
        if abs(free) < CREEP + most:
            after = free / (1.0 + most / CREEP)
        else:
            after = free - math.copysign(most, free)
        angle += 0.5 * step * (speed + after)
        speed = after
        path.append(angle)
    rows = np.cumsum(counts) - 1
    found: FloatArray = np.concatenate([unknowns[-1:], np.array(path)[rows]])
    return found
