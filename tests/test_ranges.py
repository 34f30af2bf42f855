"""A value that cannot be used is told with the key, the value and the unit that somebody wrote."""

import math
import re

import numpy as np
import pytest
from conftest import MINIMAL

from drake_gait.errors import SettingsError
from drake_gait.gait import TERMS, WAVEFORMS
from drake_gait.problem import ROUNDING, DesignSpace
from drake_gait.ranges import NONE, POSITIVE, OutOfRangeError, Range, Unit, check
from drake_gait.study import keys as study_keys
from drake_gait.study.keys import difference, in_file

TABLES = {
    "servo": study_keys.SERVO,
    "constraints": study_keys.CONSTRAINTS,
    "foot": study_keys.FOOT,
    "confirmation": {
        key: study_keys.CONFIRMATION[key]
        for key in ("noise_deg", "joint_zero_deg", "command_delay_ms")
    },
    "walk": study_keys.WALK,
}
KEYS = [
    (section, key, field, unit)
    for section, table in TABLES.items()
    for key, (field, unit) in table.items()
]


def refusal(read, section, key, value):
    with pytest.raises(SettingsError) as caught:
        read(f"{MINIMAL}[{section}]\n{key} = {value}\n")
    message = str(caught.value)
    assert "\n" not in message
    return message.partition("study.toml: ")[2]


def test_every_key_with_a_unit_in_its_name_has_one():
    endings = ("_mm", "_deg", "_j", "_n_m", "_per_rad", "_per_s", "_per_deg", "_s", "_ms")
    for section, keys in study_keys.KEYS.items():
        for key in keys:
            if key.endswith(endings):
                units = [
                    unit
                    for name, (found, unit) in study_keys._IN_FILE.items()
                    if found == f"{section}.{key}"
                ]
                assert len(units) == 1, key
                assert units[0].name, key


@pytest.mark.parametrize("value", ["-3.25", "1e99", "0.0"])
@pytest.mark.parametrize(("section", "key", "field", "unit"), KEYS)
def test_a_number_out_of_range_is_told_as_it_was_written(read, section, key, field, unit, value):
    try:
        read(f"{MINIMAL}[{section}]\n{key} = {value}\n")
    except SettingsError:
        pass
    else:  # Within this range.
        assert value != "-3.25"
        return
    message = refusal(read, section, key, value)
    assert message.startswith(f"{section}.{key} must be ")
    assert message.endswith(f", got {float(value)!r}")
    assert unit.name in message
    rest = message.replace(f"{section}.{key}", "").replace(unit.name, "")
    assert not re.search(rf"\b({field}|rad|m)\b", rest)


@pytest.mark.parametrize(
    "value", ["nan", "inf", "'1,4'", "true", "[1]", "{a = 1}", "1" + 400 * "0"]
)
@pytest.mark.parametrize(("section", "key", "field", "unit"), KEYS)
def test_what_is_no_number_is_told_with_its_key(read, section, key, field, unit, value):
    assert refusal(read, section, key, value).startswith(f"{section}.{key} must be a finite number")


@pytest.mark.parametrize("value", ["[2.5, 1.25]", "[1.25, 1.25]", "[0.0, 0.0]"])
@pytest.mark.parametrize("key", study_keys.CONSTRAINTS)
def test_both_ends_of_a_limit_rise_or_are_told_as_they_were_written(read, key, value):
    message = refusal(read, "constraints", key, value)
    assert message == f"constraints.{key} must rise from smallest to largest, got {value}"


@pytest.mark.parametrize("value", ["[-7.5, 1.25]", "[2.5, 1.25]", "[1.25, 1.25]", "[0.0, 1e9]"])
@pytest.mark.parametrize("key", study_keys.FOOT)
def test_an_open_range_that_cannot_be_used_is_told_as_it_was_written(read, key, value):
    _, unit = study_keys.FOOT[key]
    message = refusal(read, "design", key, value)
    assert message.startswith(f"design.{key} must rise and lie in ")
    assert unit.name in message
    assert message.endswith(f"got {[float(end) for end in value.strip('[]').split(',')]!r}")


def test_the_ends_of_a_range_are_told_in_the_unit_of_the_key(read):
    assert refusal(read, "foot", "big_toe_width_mm", "55.5") == (
        "foot.big_toe_width_mm must be 8 to 50 mm, got 55.5"
    )
    assert refusal(read, "foot", "big_toe_stiffness_n_mm_per_deg", "9") == (
        "foot.big_toe_stiffness_n_mm_per_deg must be 0.02 to 5 N·mm/deg, got 9"
    )
    assert refusal(read, "constraints", "yaw_swing_deg", "-20") == (
        "constraints.yaw_swing_deg must be > 0 degrees and finite, got -20"
    )
    assert refusal(read, "walk", "friction", "3") == "walk.friction must be 0.1 to 1.5, got 3"


@pytest.mark.parametrize("row", range(4))
@pytest.mark.parametrize("column", range(4))
def test_a_coefficient_out_of_range_is_told_by_its_name_in_degrees(read, row, column):
    for key, value, allowed in (
        ("centre_deg", 170.0625, f"degrees, got {170.0625}"),
        ("half_width_deg", -0.0625, "must be > 0 degrees and finite, got -0.0625"),
    ):
        rows = np.ones((4, 4))
        rows[row, column] = value
        with pytest.raises(SettingsError) as caught:
            read(re.sub(rf"(?m)^{key} = .*$", f"{key} = {rows.tolist()}", MINIMAL))
        assert f"{WAVEFORMS[row]}_{TERMS[column]} of box.{key} must" in str(caught.value)
        assert str(caught.value).endswith(allowed)


def test_rigid_toes_that_are_to_be_searched_are_refused_with_their_keys(read):
    text = f"{MINIMAL}[foot]\nrigid_toes = true\n[design]\ntoe_length_mm = [12, 30]\n"
    with pytest.raises(SettingsError, match=r"design\.toe_length_mm is open.*foot\.rigid_toes"):
        read(text)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_coefficient_at_its_end_may_be_beyond_it_by_a_rounding_error(space, sign):
    ends = DesignSpace(centre=np.zeros((4, 4)), half_width=np.ones((4, 4))).limits
    end = ends[:, 1 if sign > 0 else 0].reshape(4, 4)
    beyond = DesignSpace(
        centre=np.radians(np.degrees(end)) + sign * 0.9 * ROUNDING, half_width=space.half_width
    )
    assert (beyond.centre == end).all()
    assert (beyond.box[:, 0] <= beyond.box[:, 1]).all()
    with pytest.raises(OutOfRangeError):
        DesignSpace(centre=end + sign * 3.0 * ROUNDING, half_width=space.half_width)


def test_a_centre_within_its_ranges_stays_as_it_is(space):
    again = DesignSpace(centre=space.centre, half_width=space.half_width)
    assert again.centre.tobytes() == space.centre.tobytes()


def test_a_range_has_its_ends_unless_it_is_open_and_never_what_is_not_finite():
    closed, opened = Range(lower=0.0, upper=1.0), Range(lower=0.0, upper=1.0, open=True)
    assert [value in closed for value in (0.0, 1.0, -0.1, 1.1)] == [True, True, False, False]
    assert [value in opened for value in (0.0, 1.0, 0.5)] == [False, False, True]
    assert not any(value in POSITIVE for value in (math.nan, math.inf, 0.0, -1.0))
    check("anything", 0.5, opened)
    with pytest.raises(SettingsError, match=r"^thing must be > 0 and < 1000 mm, got 7$"):
        check("thing", 7, opened, Unit(name="mm", si=1e-3))


def test_a_difference_is_told_in_the_unit_of_the_file():
    assert difference("constraints.lateral", 0.02, 0.025) == "constraints.lateral_mm = 20, not 25"
    assert difference("study.seed", 0, 1) == "study.seed = 0, not 1"
    assert difference("constraints.slip", None, 0.01) == "constraints.slip_mm = none, not 10"
    assert difference("foot.rigid_toes", False, True) == "foot.rigid_toes = false, not true"
    assert difference("design.toe_length", [0.01, 0.02], None) == (
        "design.toe_length_mm = [10, 20], not none"
    )


def test_of_two_tables_the_first_coefficient_that_differs_is_told():
    was = np.radians(np.arange(16.0)).reshape(4, 4)
    now = was.copy()
    now[1, 2] += 1e-12
    one = difference("box.centre", was.tolist(), now.tolist())
    assert re.fullmatch(r"hip_c of box\.centre_deg = 6, not 6\.000000000\d+", one)
    now[3, 3] += 0.1
    two = difference("box.centre", was.tolist(), now.tolist())
    assert two == f"{one} (1 more differ)"


def test_a_setting_without_a_unit_is_named_alike_in_a_file():
    assert in_file("search.samples") == ("search.samples", NONE)
    assert in_file("box.half_width")[0] == "box.half_width_deg"
