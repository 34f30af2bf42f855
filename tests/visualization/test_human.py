import numpy as np
import pytest

from drake_gait.gait import WAVEFORMS
from drake_gait.visualization import human

CYCLE = np.linspace(0.0, 1.0, 401)


def peak(joint: str, begin: float, end: float) -> tuple[float, float]:
    """When within a part of the cycle the mean is largest, and its value [deg]."""
    within = CYCLE[(begin <= CYCLE) & (end >= CYCLE)]
    mean, _ = human.angles(joint, within)
    return float(within[np.argmax(mean)]), float(mean.max())


def test_there_are_angles_of_waveforms_only() -> None:
    assert set(human.JOINTS) < set(WAVEFORMS)


@pytest.mark.parametrize("joint", human.JOINTS)
def test_a_gait_cycle_ends_as_it_begins(joint: str) -> None:
    for of_the_end, of_the_start in zip(
        human.angles(joint, [1.0, 1.3]), human.angles(joint, [0.0, 0.3]), strict=True
    ):
        np.testing.assert_allclose(of_the_end, of_the_start, atol=1e-9)


@pytest.mark.parametrize("joint", human.JOINTS)
def test_people_differ_by_a_few_degrees(joint: str) -> None:
    _, deviation = human.angles(joint, CYCLE)
    assert deviation.min() > 1.5
    assert deviation.max() < 8.0


# J. Perry, Gait Analysis: Normal and Pathological Function, 1992, names these phases and angles.
@pytest.mark.parametrize(
    ("joint", "begin", "end", "angle"),
    [("knee", 0.0, 0.30, 18.0), ("knee", 0.60, 0.87, 60.0), ("ankle", 0.12, 0.60, 10.0)],
    ids=["knee in loading response", "knee in initial swing", "ankle in terminal stance"],
)
def test_the_peaks_are_those_of_a_textbook(
    joint: str, begin: float, end: float, angle: float
) -> None:
    phase, largest = peak(joint, begin, end)
    assert begin < phase < end
    assert largest == pytest.approx(angle, abs=3.0)


def test_the_hip_is_stretched_most_before_the_foot_leaves_the_ground() -> None:
    mean, _ = human.angles("hip", CYCLE)
    assert 0.45 < CYCLE[np.argmin(mean)] < 0.60
    assert -15.0 < mean.min() < -5.0
