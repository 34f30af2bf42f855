"""What a confirmation changes of walks: by settings with ranges and tiers, and by a user's own."""

import dataclasses
import json
import math

import pytest
from conftest import MINIMAL

from drake_gait.errors import SettingsError
from drake_gait.execution.base import Finished
from drake_gait.foot import FootDesign
from drake_gait.gait import FRAME_TIME
from drake_gait.search.confirmation import confirm, walked_as
from drake_gait.search.grounds import BETWEEN, end_of
from drake_gait.search.runner import Runner
from drake_gait.study.finalists import Tier, tier_of
from drake_gait.study.keys import OLDER
from drake_gait.study.ranking import sample
from drake_gait.study.search_settings import CHANGES, ConfirmationSettings
from drake_gait.study.settings import study_settings
from drake_gait.study.toml import study_toml
from drake_gait.walk import Outcome, Walk

HELD = Walk(outcome=Outcome.WALKED, frames=240, forward=0.2, lateral=0.0, yaw=0.0, com_height=0.245)


def confirmed(study, entry, **changes):
    """Walks that confirm one candidate which always holds, and their trials, by variation."""
    settings = dataclasses.replace(study, confirmation=ConfirmationSettings(**changes))
    first = dataclasses.replace(entry, id=0, walk=HELD)
    kept, asked = [], {}

    class Kept:
        def walks(self):
            return [first]

        def add(self, walk):
            kept.append(walk)

    def evaluate(trials):
        for index, trial in enumerate(trials):
            asked[trial] = None
            yield Finished(index=index, walk=HELD, seconds=0.0)

    confirm(
        settings,
        Runner(settings, Kept(), evaluate, lambda progress: None),
        [sample(0, [first], settings)],
    )
    return settings, {walk.variation: walk for walk in kept}, list(asked)


def of_tier(settings, walks, tier):
    """How the walks of a tier were simulated."""
    plan = settings.confirmation
    return [walked_as(settings, walks[number]) for number in tier.variations(plan)]


def masses(hows):
    return [how.disturbance.mass if how.disturbance else 1.0 for how in hows]


def test_every_change_has_its_tier_and_those_of_the_first_are_made_in_the_second():
    plan = ConfirmationSettings()
    assert plan.changes(1) == plan.changes(2) == ("noise", "friction")
    assert plan.changes(0) == ()
    assert set(plan.changes(3)) == set(CHANGES) - {"noise", "friction"}
    moved = ConfirmationSettings(tiers={"mass": 1, "noise": 3})
    assert moved.changes(1) == moved.changes(2) == ("friction", "mass")
    assert "noise" in moved.changes(3)


def test_a_change_that_is_moved_is_made_in_its_new_tier_alone(study, entry):
    settings, walks, _ = confirmed(study, entry, tiers={"mass": 2})
    of_two, of_three = (
        masses(of_tier(settings, walks, tier)) for tier in (Tier.CONVERGED, Tier.SERVO)
    )
    assert set(masses(of_tier(settings, walks, Tier.REPEATS))) == set(of_three) == {1.0}
    assert len(set(of_two)) == 8
    assert all(0.97 <= mass <= 1.03 for mass in of_two)


def test_no_change_moves_the_random_numbers_of_another(study, entry):
    settings, walks, _ = confirmed(study, entry)
    usual = of_tier(settings, walks, Tier.SERVO)
    for changes in ({"joint_zero": 0.0}, {"command_delay": 0.02}, {"integrator_step": 0.5}):
        other = of_tier(*confirmed(study, entry, **changes)[:2], Tier.SERVO)
        for one, two in zip(usual, other, strict=True):
            assert one.servo == two.servo
            assert one.disturbance.mass == two.disturbance.mass
            zeros = (two if "joint_zero" in changes else one).disturbance.joint_zeros
            assert zeros == two.disturbance.joint_zeros


def test_delays_and_steps_are_drawn_from_their_ranges(study, entry):
    changes = {"command_delay": 0.03, "integrator_step": 0.5}
    hows = of_tier(*confirmed(study, entry, **changes)[:2], Tier.SERVO)
    delays = [how.disturbance.delay for how in hows]
    assert len(set(delays)) == 16
    assert all(0.0 <= delay <= 0.03 for delay in delays)
    steps = [how.stepping.step for how in hows]
    assert len(set(steps)) > 2
    assert all(0.0005 <= step <= 0.001 for step in steps)
    assert [FRAME_TIME / step for step in steps] == pytest.approx(
        [round(FRAME_TIME / step) for step in steps]
    )


def test_without_friction_in_a_tier_its_walks_are_on_the_study_s_ground(study, entry):
    settings, walks, _ = confirmed(study, entry, tiers={"friction": 2})
    plan = settings.confirmation
    for variation, walk in walks.items():
        usual = tier_of(plan, variation) is not Tier.CONVERGED and variation
        assert not usual or end_of(settings, walk) == BETWEEN
    of_two = of_tier(settings, walks, Tier.CONVERGED)
    assert {round(how.friction, 9) for how in of_two} == {0.9, 1.1}


@dataclasses.dataclass(frozen=True)
class Uphill:
    """A change of a user's own: it touches the settings and the candidate."""

    tier: int = 2
    name: str = "slower servos and softer toes"

    def __call__(self, trial, rng):
        slower = dataclasses.replace(trial.settings.servo, no_load_speed=7.0 * rng.uniform(0.9, 1))
        foot = FootDesign(big_toe_stiffness=0.02 * rng.uniform(0.9, 1.0))
        return dataclasses.replace(
            trial,
            candidate=dataclasses.replace(trial.candidate, foot=foot),
            settings=dataclasses.replace(trial.settings, servo=slower),
        )


@pytest.mark.parametrize("tier", [1, 2, 3])
def test_a_user_s_change_is_made_in_its_tier_and_again_when_a_walk_is_replayed(study, entry, tier):
    settings, walks, trials = confirmed(study, entry, own=(Uphill(tier),))
    how_of = {trial.candidate: trial.settings for trial in trials}
    changed = set()
    for variation, walk in walks.items():
        how = how_of[walk.candidate] if variation > 0 else None
        if how and walk.candidate.foot != entry.candidate.foot:
            changed.add(tier_of(settings.confirmation, variation))
            assert walked_as(settings, walk).servo == how.servo
            assert how.servo.no_load_speed <= 7.0
    assert changed == {Tier(tier), *([Tier.CONVERGED] if tier == 1 else [])}


def test_a_study_remembers_a_user_s_change_by_its_name_and_replays_none_without_it(study, entry):
    settings, walks, _ = confirmed(study, entry, own=(Uphill(),))
    kept = study_settings(json.loads(json.dumps(settings.description())))
    assert kept.description() == settings.description()
    assert kept.confirmation != ConfirmationSettings()
    plan = kept.confirmation
    assert walked_as(kept, walks[1]) == walked_as(settings, walks[1])
    with pytest.raises(SettingsError, match=r"'slower servos and softer toes'.*own="):
        walked_as(kept, walks[Tier.CONVERGED.variations(plan).start])
    assert "own" not in study_toml(kept)


@pytest.mark.parametrize(
    ("own", "named"),
    [
        (Uphill(tier=4), "one of 1, 2, 3, got 4"),
        (Uphill(tier=True), "got True"),
        (Uphill(name=""), "got ''"),
        (Uphill(name="mass"), "got 'mass'"),
        (object(), "got None"),
    ],
)
def test_what_is_no_change_is_refused(own, named):
    with pytest.raises(SettingsError, match=named):
        ConfirmationSettings(own=(own,))


def test_two_changes_of_one_name_are_refused():
    with pytest.raises(SettingsError, match="names of their own"):
        ConfirmationSettings(own=(Uphill(), Uphill()))


def test_ranges_and_tiers_are_read_in_the_units_of_their_keys_and_written_again(read, tmp_path):
    text = f"""{MINIMAL}
[confirmation]
joint_zero_deg = 1.5
servo_stiffness = 0.2
supply_voltage = 0.05
mass = 0.1
command_delay_ms = 30
integrator_step = 0.5
tiers = {{mass = 2, joint_zero = 1}}
means = false
transfer = false
transfer_distance = 0.2
"""
    settings = read(text)
    assert settings.confirmation == ConfirmationSettings(
        joint_zero=math.radians(1.5),
        servo_stiffness=0.2,
        supply_voltage=0.05,
        mass=0.1,
        command_delay=0.03,
        integrator_step=0.5,
        tiers={"mass": 2, "joint_zero": 1},
        means=False,
        transfer=False,
        transfer_distance=0.2,
    )
    assert read(study_toml(settings)).description() == settings.description()


@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("tiers = 3", r"confirmation\.tiers must be a table"),
        ("tiers = {weight = 2}", r"names 'weight'; there are noise, .*mass"),
        ("tiers = {mass = 4}", r"confirmation\.tiers\.mass must be one of 1, 2, 3, got 4"),
        ("means = 1", r"confirmation\.means must be true or false, got 1"),
        ("command_delay_ms = 101", r"command_delay_ms must be 0 to 100 ms, got 101"),
    ],
)
def test_what_cannot_be_changed_is_refused_by_its_key(read, line, named):
    with pytest.raises(SettingsError, match=named):
        read(f"{MINIMAL}[confirmation]\n{line}\n")


def test_older_studies_have_the_ranges_of_today_s_defaults():
    plan = ConfirmationSettings()
    for name in CHANGES.keys() - {"noise", "friction"}:
        assert OLDER[f"confirmation.{name}"] == getattr(plan, name)
    assert not {"tiers", "own"} & plan.plain().keys()
