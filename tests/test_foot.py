"""The foot's design."""

import dataclasses

import numpy as np
import pytest

from drake_gait.errors import SettingsError
from drake_gait.foot import (
    DESIGN_LIMITS,
    DESIGN_UNITS,
    N_MM_PER_DEG,
    SEARCHED_IN_LOG,
    FootDesign,
)

FIELDS = [field.name for field in dataclasses.fields(FootDesign) if field.name != "rigid_toes"]


def test_the_default_foot_is_the_paper_s():
    foot = FootDesign()
    # 0.52 and 0.26 N·mm/deg; 22 mm of 78 mm, a ratio of 0.28.
    assert foot.big_toe_stiffness == pytest.approx(0.0298, abs=5e-5)
    assert foot.lesser_toes_stiffness == pytest.approx(0.0149, abs=5e-5)
    assert foot.big_toe_width == 0.022
    assert round(foot.big_toe_width / 0.078, 2) == 0.28
    assert foot.toe_length == pytest.approx(0.123 - 0.095)
    assert not foot.rigid_toes


def test_one_newton_millimetre_per_degree_is_0_0573_newton_metres_per_radian():
    assert pytest.approx(0.001 / np.radians(1.0)) == N_MM_PER_DEG


def test_every_field_of_the_foot_has_limits_and_a_default_within():
    assert list(DESIGN_LIMITS) == list(DESIGN_UNITS) == FIELDS
    assert set(FIELDS) > SEARCHED_IN_LOG
    for name, (lower, upper) in DESIGN_LIMITS.items():
        assert 0.0 < lower < getattr(FootDesign(), name) < upper


@pytest.mark.parametrize("name", FIELDS)
def test_a_foot_may_lie_on_its_limits(name):
    for limit in DESIGN_LIMITS[name]:
        assert getattr(FootDesign(**{name: limit}), name) == limit


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("factor", [np.nan, -1.0, 0.0, 0.999, np.inf])
def test_a_foot_outside_its_limits_is_refused_with_range_unit_and_value(name, factor):
    value = DESIGN_LIMITS[name][0] * factor
    with pytest.raises(SettingsError, match=rf"^{name} must be .+ to .+ (N·m|m).*, got "):
        FootDesign(**{name: value})


@pytest.mark.parametrize("name", FIELDS)
def test_a_foot_above_its_limits_is_refused(name):
    with pytest.raises(SettingsError, match=name):
        FootDesign(**{name: DESIGN_LIMITS[name][1] * 1.001})


def test_feet_are_equal_and_hash_alike_when_their_fields_are():
    assert FootDesign(big_toe_width=0.03) == FootDesign(big_toe_width=0.03)
    assert len({FootDesign(), FootDesign(), FootDesign(big_toe_width=0.03)}) == 2


@pytest.mark.parametrize("value", [1, 0.0, "yes", None])
def test_rigid_toes_are_true_or_false(value):
    with pytest.raises(SettingsError, match=r"rigid_toes must be true or false, got"):
        FootDesign(rigid_toes=value)


def test_feet_that_differ_in_their_springs_only_have_one_body():
    sprung = FootDesign(big_toe_stiffness=0.1, lesser_toes_stiffness=0.2, toe_damping=1e-3)
    assert sprung.body == FootDesign().body == FootDesign()
    for shape in ({"big_toe_width": 0.03}, {"toe_length": 0.02}, {"rigid_toes": True}):
        body = dataclasses.replace(sprung, **shape).body
        assert body == FootDesign(**shape) != sprung.body
