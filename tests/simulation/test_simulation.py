"""One walk: repeatable, honest about falls and failures, and complete in what it records."""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from drake_gait import Candidate, FootDesign, Gait, Outcome, WalkSettings, simulate
from drake_gait.errors import ModelError, SettingsError
from drake_gait.gait import FRAME_TIME, FRAMES, STANDING, Start
from drake_gait.simulation import plant as robot
from drake_gait.simulation import simulate as simulation
from drake_gait.simulation.simulate import follow
from drake_gait.study.reading import default_study, read_study
from drake_gait.walk import Walk

WALKING = Candidate(gait=read_study(default_study()).space.decode(np.zeros(16)).gait)
# Bends the standing leg under the body.
FALLING = Candidate(gait=Gait.from_degrees([[15, 0, 0, 0], [40, 0, 0, 0], [0] * 4, [0] * 4]))

NUMBERS = ("forward", "lateral", "yaw", "com_height", "frames")

IN_A_FRESH_PROCESS = """
import json, sys
from drake_gait import Candidate, Gait, simulate
walk = simulate(Candidate(gait=Gait(coefficients=json.loads(sys.argv[1]))))
print(json.dumps([getattr(walk, name) for name in json.loads(sys.argv[2])]))
"""


def numbers(walk: Walk) -> list[float]:
    return [getattr(walk, name) for name in NUMBERS]


@pytest.fixture(scope="module")
def usual() -> Walk:
    """What WALKING walks."""
    return simulate(WALKING)


@pytest.fixture(scope="module")
def watched() -> Walk:
    """The same with its history."""
    return simulate(WALKING, history=True)


def test_the_same_candidate_walks_the_same_after_any_other_walk_and_in_any_process() -> None:
    first = simulate(WALKING)
    simulate(FALLING)
    simulate(Candidate(gait=WALKING.gait, foot=FootDesign(big_toe_stiffness=0.1)))
    again = simulate(WALKING)
    coefficients = json.dumps(WALKING.gait.coefficients.tolist())
    elsewhere = subprocess.run(
        [sys.executable, "-c", IN_A_FRESH_PROCESS, coefficients, json.dumps(NUMBERS)],
        capture_output=True,
        text=True,
        check=True,
    )
    assert numbers(again) == numbers(first)
    assert json.loads(elsewhere.stdout) == numbers(first)


def test_a_walk_has_the_same_numbers_with_the_shapes_that_reach_no_ground(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Falls too: they end before anything else than a foot can touch.
    candidates = (WALKING, FALLING)
    without = [repr(simulate(one)) for one in candidates]
    monkeypatch.setattr(robot, "out_of_reach", lambda plant, scene_graph, robot: [])
    simulation._robot.cache_clear()
    try:
        assert [repr(simulate(one)) for one in candidates] == without
    finally:
        simulation._robot.cache_clear()


def test_a_process_that_only_walks_imports_nothing_heavy_but_drake() -> None:
    listed = subprocess.run(
        [
            sys.executable,
            "-c",
            (
                "import sys, drake_gait.execution.worker_process\n"
                "import drake_gait.simulation.simulate\n"
                "print(*sys.modules)"
            ),
        ],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert "drake_gait.simulation.simulate" in listed
    assert not {"torch", "matplotlib", "scipy", "sqlite3", "dask"} & set(listed)


def test_watching_a_walk_does_not_change_it(usual: Walk, watched: Walk) -> None:
    assert numbers(watched) == numbers(usual)
    assert numbers(simulate(FALLING, history=True)) == numbers(simulate(FALLING))


def test_the_middle_of_the_default_box_walks_to_the_end(usual: Walk) -> None:
    assert usual.outcome is Outcome.WALKED
    assert usual.frames == FRAMES
    assert usual.forward > 0.1
    assert usual.reason == ""


def test_a_fall_ends_the_walk_early_and_says_when() -> None:
    walk = simulate(FALLING, history=True)
    assert walk.outcome is Outcome.FELL
    assert walk.frames < FRAMES
    assert "fell at" in walk.reason
    assert walk.history is not None
    assert len(walk.history.time) == walk.frames + 2  # the first frame, and the one of the fall


def test_a_history_has_one_row_a_frame_in_the_shapes_of_its_documentation(watched: Walk) -> None:
    history = watched.history
    assert history is not None
    shapes = {
        "time": (),
        "positions": (21,),
        "com": (3,),
        "torso": (6,),
        "ankles": (2, 3),
        "commands": (10,),
        "angles": (10,),
        "speeds": (10,),
        "torques": (10,),
        "toes": (4,),
        "ground_reaction": (2, 3),
        "sole_height": (2,),
    }
    for name, shape in shapes.items():
        assert getattr(history, name).shape == (FRAMES + 1, *shape), name
        assert np.isfinite(getattr(history, name)).all(), name
    assert history.time == pytest.approx(np.arange(FRAMES + 1) * 0.02)
    assert history.commands == pytest.approx(WALKING.gait.commands_from(Start.RAMP))


def test_the_walks_numbers_are_the_first_and_last_frames_of_its_history(watched: Walk) -> None:
    walk = watched
    assert walk.history is not None
    moved = walk.history.com[-1] - walk.history.com[0]
    assert moved[:2] == pytest.approx([walk.forward, walk.lateral], abs=1e-12)
    assert walk.history.com[-1, 2] == pytest.approx(walk.com_height, abs=1e-12)
    turned = walk.history.torso[-1, 5] - walk.history.torso[0, 5]
    assert turned == pytest.approx(walk.yaw, abs=1e-9)


def test_a_walk_without_end_is_given_up_at_its_time_limit() -> None:
    walk = simulate(WALKING, WalkSettings(time_limit=1e-9))
    assert walk.outcome is Outcome.DIVERGED
    assert "longer than" in walk.reason


@pytest.mark.slow
def test_time_that_a_walk_waits_for_others_does_not_count() -> None:
    waits = iter([3.0])
    walk = simulate(
        WALKING, WalkSettings(time_limit=2.5), watch=lambda *_: time.sleep(next(waits, 0.0))
    )
    assert walk.survived


@pytest.mark.parametrize("failure", [RuntimeError("no convergence"), SystemExit("Failure at icf")])
def test_a_solver_that_fails_is_an_outcome_with_its_reason(
    monkeypatch: pytest.MonkeyPatch, failure: BaseException
) -> None:
    follow(STANDING.commands)  # What is cached is built before the solver breaks.
    advance: Callable[..., object] = Simulator.AdvanceTo

    def fail_after_a_second(simulator: Simulator, boundary_time: float, **options: bool) -> object:
        if boundary_time > 1.0:
            raise failure
        return advance(simulator, boundary_time, **options)

    monkeypatch.setattr(Simulator, "AdvanceTo", fail_after_a_second)
    walk = simulate(WALKING)
    assert walk.outcome is Outcome.DIVERGED
    assert str(failure) in walk.reason
    assert walk.frames == 50


def test_a_solver_that_fails_after_a_fall_makes_no_difference(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fell = simulate(FALLING)
    advance: Callable[..., object] = Simulator.AdvanceTo

    def fail_after_the_fall(simulator: Simulator, boundary_time: float, **options: bool) -> object:
        advance(simulator, boundary_time, **options)
        if boundary_time > (fell.frames + 1) * FRAME_TIME:
            raise RuntimeError("no convergence")
        return None

    monkeypatch.setattr(Simulator, "AdvanceTo", fail_after_the_fall)
    assert numbers(simulate(FALLING)) == numbers(fell)


def test_a_missing_robot_is_named_with_those_that_exist() -> None:
    with pytest.raises(ModelError, match=r"no robot description 'khr4\.sdf'.*khr3hv\.sdf"):
        simulate(WALKING, WalkSettings(model="khr4.sdf"))


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("</sdf>", "", "not a well-formed XML"),
        ('name="knee_r" type', 'name="elbow_r" type', "no joint 'knee_r'"),
        ('name="big_toe_r"', 'name="thumb_r"', "no link 'big_toe_r'"),
        ("spring_stiffness>", "spring_thickness>", "line .*Drake ignores <spring_thickness>"),
        ("<mass>", "<mass>-", "<mass> must be > 0"),
    ],
)
def test_a_broken_robot_is_refused_in_one_line(
    tmp_path: Path, old: str, new: str, complaint: str
) -> None:
    from drake_gait.robot.description import model_path

    text = model_path().read_text()
    assert old in text
    broken = tmp_path / "broken.sdf"
    broken.write_text(text.replace(old, new))
    with pytest.raises(ModelError, match=complaint) as refusal:
        simulate(WALKING, WalkSettings(model=broken))
    assert "\n" not in str(refusal.value)


def test_another_foot_walks_another_walk(usual: Walk) -> None:
    for change in ({"big_toe_width": 0.04}, {"lesser_toes_stiffness": 0.2}, {"toe_damping": 5e-3}):
        other = simulate(replace(WALKING, foot=FootDesign(**change)))
        assert other.forward != usual.forward


def test_a_time_limit_must_be_positive() -> None:
    with pytest.raises(SettingsError, match="time_limit"):
        WalkSettings(time_limit=0.0)


def test_who_watches_a_walk_sees_every_frame_and_changes_no_number(usual: Walk) -> None:
    seen: list[tuple[float, np.ndarray]] = []
    watched = simulate(
        WALKING, history=True, watch=lambda instant, positions: seen.append((instant, positions))
    )
    assert watched.history is not None
    assert numbers(watched) == numbers(usual)
    np.testing.assert_allclose([instant for instant, _ in seen], watched.history.time[1:])
    np.testing.assert_array_equal(
        [positions for _, positions in seen], watched.history.positions[1:]
    )


def test_every_walk_has_the_same_measures_with_a_history_and_without(
    usual: Walk, watched: Walk
) -> None:
    assert usual.history is None
    assert usual.measures is not None
    assert usual.measures == watched.measures


def test_the_range_of_the_heading_is_known_of_every_walk(usual: Walk, watched: Walk) -> None:
    assert watched.history is not None
    assert watched.yaw_swing == pytest.approx(np.ptp(watched.history.torso[:, 5]), abs=1e-9)
    assert watched.yaw_swing == usual.yaw_swing


def test_a_fall_has_measures_too() -> None:
    walk = simulate(FALLING)
    assert walk.outcome is Outcome.FELL
    assert walk.measures is not None
    assert walk.measures.energy > 0.0


def test_another_friction_walks_another_walk_and_a_factor_of_one_the_same(usual: Walk) -> None:
    assert numbers(simulate(WALKING, WalkSettings(friction=1.0))) == numbers(usual)
    slippery, sticky = (
        simulate(WALKING, WalkSettings(friction=friction)) for friction in (0.9, 1.1)
    )
    assert len({walk.forward for walk in (usual, slippery, sticky)}) == 3
    assert numbers(simulate(WALKING)) == numbers(usual)  # Robots of both are kept side by side.


def test_on_ice_the_soles_slide_further(usual: Walk) -> None:
    ice = simulate(WALKING, WalkSettings(friction=0.05))
    assert usual.measures is not None
    assert ice.measures is not None
    assert sum(ice.measures.slip) > 1.5 * sum(usual.measures.slip)


@pytest.mark.parametrize("friction", [0.04, 2.3, -1.0, float("nan")])
def test_a_friction_out_of_range_is_refused(friction: float) -> None:
    with pytest.raises(SettingsError, match=r"friction must be 0\.05 to 2\.25, got"):
        WalkSettings(friction=friction)


def test_commands_that_no_servo_can_follow_are_refused_before_the_walk() -> None:
    degrees = np.degrees(WALKING.gait.commands)
    for wrong in (degrees, degrees[:-1], np.full_like(degrees, np.nan)):
        with pytest.raises(SettingsError, match="commands"):
            follow(wrong, settings=WalkSettings(model="nowhere.sdf"))


def test_commands_as_a_list_are_followed_as_an_array_is() -> None:
    commands = WALKING.gait.commands
    assert numbers(follow(commands.tolist())) == numbers(follow(commands))


def test_walks_in_threads_have_the_numbers_of_one_after_the_other() -> None:
    candidates = [WALKING, FALLING, Candidate(gait=STANDING)]
    with ThreadPoolExecutor(3) as pool:
        together = list(pool.map(simulate, candidates))
    assert [numbers(walk) for walk in together] == [numbers(simulate(one)) for one in candidates]
