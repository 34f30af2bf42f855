"""Gait families: the paper's waveforms as a special case, walks of any length, and bad families."""

import pickle
from dataclasses import dataclass, replace

import numpy as np
import pytest

from drake_gait.errors import SettingsError
from drake_gait.gait import (
    ANGLE_LIMITS,
    FRAME_TIME,
    JOINTS,
    PAPER,
    WAVEFORMS,
    Gait,
    GaitFamily,
    Harmonics,
    KeyFrames,
    PaperFamily,
    Start,
    Variable,
    family_of,
    gait_of,
    plain_family,
    plain_gait,
    setting,
)
from drake_gait.gait.harmonics import warped

PAPERS = Gait.from_degrees(
    [
        [0.8, 1.6, 7.7, -0.1],
        [13, -24.6, 10.8, -0.4],
        [23.6, -3.3, 16.5, -0.2],
        [9.5, 15.7, 6.6, 1.8],
    ]
)
SHIPPED = [PAPER, Harmonics(), Harmonics(harmonics=3, asymmetric=True), KeyFrames()]


class Bow(GaitFamily):
    """A gait that bends the hips."""

    variables = (Variable("depth", lower=0.0, upper=1.0),)

    def commands(self, x):
        angles = np.zeros((len(self.times(x)), 10))
        angles[:, 1] = x[0]
        return angles


@dataclass(frozen=True, kw_only=True)
class Broken(Bow):
    """A family whose commands are what a setting says."""

    fault: str = setting("none")

    def commands(self, x):
        good = super().commands(x)
        return {
            "shape": good.T,
            "length": good[:-1],
            "nan": np.where(np.arange(10) == 3, np.nan, good),
            "travel": good + 3.0,
            "text": "angles",
            "error": None if self.fault != "error" else good[:, 99],
        }[self.fault]


def like_the_paper(family):
    return family.gait(family.values(family.like(PAPERS)))


def test_the_paper_s_waveforms_are_a_special_case_of_harmonics():
    time = np.linspace(0.0, 4.8, 500)
    gait = like_the_paper(Harmonics())
    assert gait.family.waveforms(gait.variables, time) == pytest.approx(
        PAPERS.waveforms(time), abs=1e-12
    )


def test_harmonics_that_begin_with_a_shift_send_what_the_paper_s_gait_sends():
    frames = slice(0, 100)  # Until they begin to shrink.
    sent = PAPERS.commands_from(Start.SHIFT)
    assert like_the_paper(Harmonics()).commands[frames] == pytest.approx(sent[frames], abs=1e-12)


def test_the_special_case_holds_at_another_period():
    slow = replace(PAPERS, family=PaperFamily(period=1.6, cycles=2))
    gait = Harmonics(period=1.6).gait(Harmonics().values(Harmonics().like(slow)))
    time = np.linspace(0.0, 3.0, 300)
    found = gait.family.waveforms(gait.variables, time)
    assert found == pytest.approx(slow.waveforms(time), abs=1e-12)


@pytest.mark.parametrize("period", [0.8, 1.2, 1.6])
@pytest.mark.parametrize("cycles", [2, 3, 5])
@pytest.mark.parametrize("kind", [PaperFamily, Harmonics, KeyFrames])
def test_frames_follow_from_period_cycles_and_standing(kind, period, cycles):
    family = kind(period=period, cycles=cycles, standing=0.6)
    values = family.like(PAPERS) | ({"period": period} if kind is Harmonics else {})
    gait = family.gait(family.values(values))
    assert gait.frames * FRAME_TIME == pytest.approx(cycles * period + 0.6)
    assert gait.commands_from(Start.RAMP).shape == (gait.frames + 1, 10)
    begin, end = gait.walking
    assert 0 <= begin < end <= gait.frames
    assert not gait.commands[-1].any()


@pytest.mark.parametrize("start", Start)
def test_a_gait_at_another_period_is_the_paper_s_in_slow_motion(start):
    slow = replace(PAPERS, family=PaperFamily(period=2.4, standing=2.4))
    assert slow.commands_from(start)[:360:2] == pytest.approx(
        PAPERS.commands_from(start)[:180], abs=np.radians(12.0 if start is Start.PAPER else 1e-9)
    )
    assert slow.walking == (30, 330)


@pytest.mark.parametrize("family", [Harmonics(), KeyFrames(phases=np.arange(8) / 8)])
def test_blended_gaits_have_no_jump(family):
    gait = like_the_paper(family)
    assert np.degrees(np.abs(gait.jumps_from(Start.PAPER))).max() < 0.3
    assert np.degrees(np.abs(np.diff(gait.commands, n=2, axis=0))).max() < 1.0
    assert np.degrees(np.abs(PAPERS.jumps)).max() > 5.0


def test_walking_may_take_as_long_whatever_the_period():
    family = Harmonics(walking=3.6)
    values = family.like(PAPERS)
    frames = {family.gait(family.values(values | {"period": p})).frames for p in (1.0, 1.2, 1.37)}
    assert frames == {240}


@pytest.mark.parametrize("duty", [0.35, 0.5, 0.62])
def test_a_stance_takes_its_share_of_the_cycle(duty):
    parts = (np.arange(20_000) + 0.5) / 20_000
    phase = warped(parts, duty)
    assert np.mean((phase % 1.0) > 0.5) == pytest.approx(duty, abs=1e-3)
    assert (np.diff(phase) > 0.0).all()
    assert warped(parts + 1.0, duty) == pytest.approx(phase + 1.0)


def test_legs_differ_by_what_their_difference_says():
    family = Harmonics(asymmetric=True, walking=3.6)
    values = family.like(PAPERS)
    same = family.gait(family.values(values)).commands
    other = family.gait(family.values(values | {"hip_mean_difference": 0.02})).commands
    hips = [JOINTS.index(f"hip_pitch_{side}") for side in "rl"]
    assert (other - same)[90, hips] == pytest.approx([0.01, -0.01])
    assert same == pytest.approx(like_the_paper(Harmonics(walking=3.6)).commands)


def test_key_frames_lead_through_their_angles_and_mirror_the_other_leg():
    family = KeyFrames(phases=(0.0, 0.2, 0.5, 0.7), cycles=4)
    rng = np.random.default_rng(3)
    count = len(family.phases)
    x = np.append(rng.uniform(0.1, 0.2, 5 * count), family.phases)
    angles = family.leg(x, np.array(family.phases))
    assert angles == pytest.approx(x[: 5 * count].reshape(5, count).T)
    commands = family.gait(x).commands
    right, left = commands[90:120, :5], commands[60:90, 5:]
    assert right == pytest.approx(left * [-1, 1, 1, 1, -1])
    assert family.leg(x, np.array([1.3])) == pytest.approx(family.leg(x, np.array([0.3])))


def test_many_key_frames_of_a_paper_s_gait_are_nearly_that_gait():
    straight = Gait(coefficients=PAPERS.coefficients * [[0, 1, 1, 0], *3 * [[1, 1, 1, 1]]])
    family = KeyFrames(phases=np.arange(12) / 12)
    gait = family.gait(family.values(family.like(straight)))
    sent = straight.commands_from(Start.SHIFT)
    assert np.degrees(np.abs(gait.commands[:100] - sent[:100])).max() < 0.1


@pytest.mark.parametrize("family", SHIPPED, ids=lambda one: one.label)
def test_angles_stay_inside_their_ranges_anywhere_inside_the_limits(family):
    rng = np.random.default_rng(0)
    ranges = ANGLE_LIMITS[[0, 1, 2, 3, 0] * 2]
    for _ in range(20):
        gait = family.gait(
            family.limits @ [0.5, 0.5] + rng.uniform(-0.5, 0.5) * np.ptp(family.limits, axis=1)
        )
        assert (gait.commands >= np.minimum(ranges[:, 0], 0.0) - 1e-9).all()
        assert (gait.commands <= ranges[:, 1] + 1e-9).all()


@pytest.mark.parametrize("family", [*SHIPPED, Bow(cycles=2)], ids=lambda one: one.label)
def test_families_and_gaits_are_pickled_and_told_in_plain_words(family):
    gait = family.gait(family.limits.mean(axis=1))
    again = pickle.loads(pickle.dumps(gait))
    assert again.commands.tobytes() == gait.commands.tobytes()
    assert again == gait
    assert hash(again) == hash(gait)
    assert gait_of(plain_gait(gait)) == gait
    assert family_of(plain_family(family)) == family


def test_noise_moves_angles_alone_and_stops_at_the_limits():
    family = Harmonics()
    gait = like_the_paper(family)
    moved = gait.moved(np.full(len(gait.variables), 0.01))
    change = dict(zip(family.names, moved.variables - gait.variables, strict=True))
    assert change.pop("duty") == change.pop("period") == 0.0
    assert list(change.values()) == pytest.approx([0.01] * 20)
    assert (gait.moved(np.full(22, 9.0)).variables <= family.limits[:, 1]).all()


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Harmonics(harmonics=9), "harmonics of the gait family harmonics must be 1 to 8"),
        (lambda: Harmonics(harmonics=1.5), "must be a whole number, got 1.5"),
        (lambda: Harmonics(period=np.nan), "period of .* 0.2 to 10.*nan"),
        (lambda: Harmonics(cycles=0), "cycles .*got 0"),
        (lambda: Harmonics(asymmetric=1), "asymmetric .*true or false, got 1"),
        (lambda: KeyFrames(phases=(0.0, 0.5, 0.4)), "phases .* rise"),
        (lambda: KeyFrames(phases=()), "phases .* must be a list"),
        (lambda: PaperFamily(standing=-1), "standing .*got -1"),
        (lambda: Variable("Hip"), "lower-case .*'Hip'"),
        (lambda: Variable("hip", lower=1.0, upper=0.0), "limits of the variable hip"),
        (lambda: family_of({"family": "waltz"}), "'waltz'; there are paper, harmonics, keyframes"),
        (lambda: family_of({"family": "harmonics", "hops": 1}), "no setting 'hops'; there are per"),
        (lambda: family_of({"family": "nowhere.at:All"}), "nowhere.at:All is not at hand"),
        (lambda: Harmonics().gait([1.0]), r"22 variables, got an array of shape \(1,\)"),
        (lambda: Harmonics().gait([np.inf] * 22), "roll_mean .*-15 to 15 degrees, got inf"),
        (lambda: Bow().gait([1.1]), "depth of the gait family Bow must be 0 to 57.*degrees"),
        (lambda: Harmonics().values({"hip_tan1": 0.0}), "'hip_tan1' .*there are roll_mean"),
        (lambda: Harmonics().values({"roll_mean": 0.0}), "needs roll_cos1, roll_sin1"),
        (lambda: Bow().like(PAPERS), "Bow knows no gait like"),
    ],
)
def test_what_no_family_can_use_is_told_by_its_name(make, told):
    with pytest.raises(SettingsError, match=told) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("shape", r"\(frames \+ 1, 10\) in shape.* got \(10, 241\); transpose"),
        ("length", "must have 241 rows.* got 240"),
        ("nan", "ankle_pitch_r in frame 0, is nan"),
        ("travel", "hip_roll_r in frame 0, is 3 rad; a servo turns"),
        ("text", "must be real numbers"),
        ("error", "cannot be computed: IndexError"),
        ("other", "cannot be computed: KeyError"),
    ],
)
def test_commands_that_no_servo_can_follow_are_told_with_their_family(fault, told):
    with pytest.raises(SettingsError, match=told) as caught:
        _ = Broken(fault=fault).gait([0.5]).commands
    assert "commands of the gait family Broken" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_family_without_a_variable_is_refused():
    class Empty(Bow):
        variables = ()

    class Twice(Bow):
        variables = (Variable("depth"), Variable("depth"))

    with pytest.raises(SettingsError, match="Empty must have Variables"):
        Empty()
    with pytest.raises(SettingsError, match="Twice has two variables 'depth'"):
        Twice()


def test_waveforms_are_named_as_the_harmonics_variables():
    assert {name.partition("_")[0] for name in Harmonics().names[:-2]} == set(WAVEFORMS)
