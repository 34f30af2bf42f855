"""What a walk says of itself."""

import pytest

from drake_gait.walk import Outcome, Walk


@pytest.mark.parametrize(
    ("reason", "cause"),
    [
        ("solver: no convergence", "solver"),
        ("the state is not finite", "solver"),
        ("its process died with exit code -6", "worker died"),
        ("took longer than 60 s", "time limit"),
        ("gave no sign for 120 s", "time limit"),
        ("something new", "lost"),
    ],
)
def test_a_walk_that_diverged_says_in_a_word_why(reason, cause):
    assert Walk.diverged(reason).failure == cause


@pytest.mark.parametrize(("outcome", "failure"), [(Outcome.WALKED, None), (Outcome.FELL, "fell")])
def test_a_walk_that_was_simulated_fails_by_a_fall_alone(outcome, failure):
    walk = Walk(outcome=outcome, frames=9, forward=0.0, lateral=0.0, yaw=0.0, com_height=0.2)
    assert walk.failure == failure
