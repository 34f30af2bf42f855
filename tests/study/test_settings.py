"""A study's settings, as a person writes them and as the library has them."""

import json
import math
import re

import numpy as np
import pytest
from conftest import EVERY_KEY, MINIMAL

from drake_gait.errors import SettingsError
from drake_gait.gait import Start
from drake_gait.servo import Servo
from drake_gait.sole import Sole
from drake_gait.study.reading import default_study, read_override, read_study
from drake_gait.study.search_settings import SearchSettings
from drake_gait.study.settings import study_settings
from drake_gait.walk import Fidelity

N_MM_PER_DEG = 0.001 / np.radians(1.0)


def refused(read, text, overrides=None):
    """The text of the error that a study is refused with: one line that names the file."""
    with pytest.raises(SettingsError) as caught:
        read(text, overrides)
    message = str(caught.value)
    assert "study.toml" in message
    assert "\n" not in message
    return message


def test_a_study_needs_a_name_and_a_box_only(read):
    study = read(MINIMAL)
    assert study.name == "minimal"
    assert (study.seed, study.search.samples, study.search.simulations) == (0, 100, 400)
    assert study.walk.fidelity is Fidelity.SEARCH
    assert study.walk.model == "khr3hv.sdf"


def test_the_box_is_written_in_degrees(read):
    space = read(MINIMAL).space
    assert np.degrees(space.centre[1]) == pytest.approx([13, -11, 8, 0])
    assert np.degrees(space.half_width[:, 0]) == pytest.approx([1, 2, 2, 2])


def test_constraints_are_written_in_millimetres_and_degrees(read):
    limits = read(EVERY_KEY).constraints
    assert limits.lateral == pytest.approx(0.015)
    assert limits.yaw == pytest.approx(4.0 * np.pi / 180.0)
    assert limits.com_height == pytest.approx(0.240)


def test_the_foot_is_written_in_the_paper_s_units(read):
    foot = read(EVERY_KEY).space.foot
    assert foot.big_toe_stiffness == pytest.approx(1.0 * N_MM_PER_DEG)
    assert foot.lesser_toes_stiffness == pytest.approx(0.5 * N_MM_PER_DEG)
    assert foot.toe_damping == pytest.approx(3e-4)
    assert foot.big_toe_width == pytest.approx(0.025)
    assert foot.toe_length == pytest.approx(0.020)


def test_rigid_toes_are_said_in_the_foot_s_section_and_come_back(read):
    study = read(MINIMAL + "[foot]\nrigid_toes = true")
    assert study.space.foot.rigid_toes
    assert study_settings(study.description()).space.foot == study.space.foot
    assert not read(MINIMAL).space.foot.rigid_toes


def test_design_ranges_are_written_in_the_units_of_the_foot(read):
    ranges = {name: (low, high) for name, low, high in read(EVERY_KEY).space.foot_ranges}
    assert ranges == {
        "big_toe_stiffness": pytest.approx((0.1 * N_MM_PER_DEG, 2.0 * N_MM_PER_DEG)),
        "toe_damping": pytest.approx((1e-4, 1e-3)),
        "big_toe_width": pytest.approx((0.010, 0.040)),
    }


def test_walk_servo_and_search_are_written_in_si(read):
    study = read(EVERY_KEY)
    assert study.walk.model == "khr3hv_cad.sdf"
    assert study.walk.fidelity is Fidelity.REFERENCE
    assert study.walk.time_limit == 30.0
    servo = study.walk.servo
    assert (servo.stiffness, servo.damping, servo.no_load_speed) == (12.0, 0.15, 7.0)
    assert study.search == SearchSettings(samples=30, simulations=90, batch=6, stagnation=4)
    assert (study.seed, study.question, study.chosen) == (7, "What if?", "by hand")


def test_the_paper_s_study_is_the_paper_s(paper_study):
    study = read_study(paper_study)
    assert study.name == "paper"
    assert study.search.samples == 100
    limits = study.constraints
    assert limits.lateral == pytest.approx(0.020)
    assert np.degrees(limits.yaw) == pytest.approx(5.0)
    assert limits.com_height == pytest.approx(0.24353)
    assert study.space.foot.big_toe_stiffness == pytest.approx(0.52 * N_MM_PER_DEG)
    assert study.space.dimension == 16
    assert (study.space.box == [-1.0, 1.0]).all()


def test_the_default_study_has_limits_for_steps_beside_the_paper_s(paper_study):
    paper, default = (read_study(path).description() for path in (paper_study, default_study()))
    for name in ("lateral", "yaw", "com_height"):
        assert default[f"constraints.{name}"] == paper[f"constraints.{name}"]
    own = {
        "yaw_swing": math.radians(20.0),
        "slip_ratio": 0.08,
        "clearance": 0.002,
        "peak_torque": 1.373,  # 14.0 kgf·cm, the stall torque of models/khr3hv.sdf
        "peak_speed": Servo().no_load_speed,
    }
    for name, limit in own.items():
        assert paper[f"constraints.{name}"] is None
        assert default[f"constraints.{name}"] == pytest.approx(limit, rel=1e-3)
    assert (default["gait.start"], paper["gait.start"]) == ("shift", "paper")


def test_the_longer_study_is_the_default_one_but_for_its_budget_its_risk_and_its_end(repository):
    longer = read_study(repository / "studies" / "far.toml").description()
    default = read_study(default_study()).description()
    changed = {key for key in {*default, *longer} if default.get(key) != longer.get(key)}
    assert {key.split(".")[0] for key in changed} == {
        "study", "search", "confirmation", "box", "gait",
    }  # fmt: skip
    assert {key for key in changed if key.startswith("box.")} == {"box.chosen"}
    assert {key for key in changed if key.startswith("gait.")} == {"gait.stop"}


def test_every_committed_study_reads(repository):
    files = sorted((repository / "studies").glob("*.toml"))
    studies = [path for path in files if "[sweep]" not in path.read_text()]
    names = [read_study(path).name for path in studies]
    assert "paper" in names
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("text", [MINIMAL, EVERY_KEY])
def test_settings_return_from_their_description(read, text):
    description = read(text).description()
    again = study_settings(json.loads(json.dumps(description)))
    assert again.description() == description


def test_the_paper_s_study_returns_from_its_description(paper_study):
    study = read_study(paper_study)
    again = study_settings(study.description())
    assert again.description() == study.description()
    assert (again.space.centre == study.space.centre).all()
    assert (again.search, again.constraints, again.walk) == (
        study.search,
        study.constraints,
        study.walk,
    )


def test_a_description_names_each_setting_by_section_and_key(read):
    description = read(EVERY_KEY).description()
    assert description["search.samples"] == 30
    assert description["study.seed"] == 7
    assert description["walk.fidelity"] == "reference"
    assert description["servo.stiffness"] == 12.0
    assert description["design.big_toe_width"] == pytest.approx([0.010, 0.040])


@pytest.mark.parametrize(
    ("line", "key"),
    [
        ("seed = 7", "study.seed"),
        ("batch = 6", "search.batch"),
        ("yaw_deg = 4.0", "constraints.yaw"),
        ("time_limit_s = 30", "walk.time_limit"),
        ("damping_n_m_s_per_rad = 0.15", "servo.damping"),
        ("big_toe_width_mm = 25", "foot.big_toe_width"),
        ("big_toe_width_mm = [10, 40]", "design.big_toe_width"),
    ],
)
def test_two_studies_differ_in_their_description_where_they_differ(read, line, key):
    def description(text):
        return {**dict.fromkeys(one), **read(text).description()}

    one = read(EVERY_KEY).description()
    other = description(EVERY_KEY.replace(f"{line}\n", ""))
    assert {name for name in one if one[name] != other[name]} == {key}


def test_overrides_take_the_place_of_what_the_file_says(read):
    overrides = {
        ("search", "samples"): 33,
        ("study", "seed"): 5,
        ("servo", "damping_n_m_s_per_rad"): 0.1,
    }
    study = read(EVERY_KEY, overrides)
    assert (study.search.samples, study.seed, study.walk.servo.damping) == (33, 5, 0.1)
    assert study.search.simulations == 90


def test_an_override_of_a_section_that_the_file_lacks_is_used(read):
    assert read(MINIMAL, {("search", "samples"): 33}).search.samples == 33


def test_an_override_that_does_not_exist_is_refused(read):
    assert "'samples'" in refused(read, MINIMAL, {("search", "sample"): 3})


def test_a_refused_override_is_told_beside_the_file_that_it_changes(read):
    assert "study.toml, search.samples set: search.samples must" in refused(
        read, MINIMAL, {("search", "samples"): 0}
    )


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("7", 7),
        ("-0.5", -0.5),
        ("true", True),
        ("[0.1, 2]", [0.1, 2]),
        ('"text"', "text"),
        ("reference", "reference"),
        ("How far, and how straight?", "How far, and how straight?"),
        ("a=b", "a=b"),
        ("", ""),
        ("1\nseed = 2", "1\nseed = 2"),
    ],
)
def test_the_value_of_an_override_is_toml_and_else_text(text, value):
    found = read_override(f"walk.model={text}")
    assert found == (("walk", "model"), value)
    assert type(found[1]) is type(value)


@pytest.mark.parametrize("value", ["[1, 2", "{a", '"open', "'open"])
def test_a_value_that_begins_like_toml_and_is_none_is_refused_with_its_setting(value):
    with pytest.raises(SettingsError, match=r"the value of walk\.model is not TOML"):
        read_override(f"walk.model={value}")


@pytest.mark.parametrize("text", ["", "=", "samples", "samples=3", "search.=3", ".samples=3"])
def test_an_override_without_section_and_key_is_refused_with_one_that_has_them(text):
    with pytest.raises(SettingsError, match=r"section\.key=value, like \w+\.\w+=\.\.\."):
        read_override(text)


@pytest.mark.parametrize(
    ("wrong", "nearest"),
    [
        ("[serach]\nsamples = 3", "'search'"),
        ("[desing]", "'design'"),
        ("[zzz]", "'"),
        ("[search]\nsample = 3", "'samples'"),
        ("[walk]\nfidelty = 'search'", "'fidelity'"),
        ("[foot]\nbig_toe_width = 22", "'big_toe_width_mm'"),
        ("[servo]\nstifness_n_m_per_rad = 2", "'stiffness_n_m_per_rad'"),
        ("[constraints]\nyaw = 2", "'yaw_deg'"),
        ("[design]\ntoe_damping = [1, 2]", "'toe_damping_n_m_s_per_rad'"),
    ],
)
def test_an_unknown_section_or_key_is_refused_with_the_nearest(read, wrong, nearest):
    assert f"the nearest is {nearest}" in refused(read, MINIMAL + wrong)


def test_unknown_keys_of_study_and_box_are_refused_with_the_nearest(read):
    assert "'seed'" in refused(read, MINIMAL.replace("[box]", "sead = 3\n[box]"))
    assert "'centre_deg'" in refused(read, MINIMAL.replace("centre_deg", "center_deg"))


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("[constraints]\nyaw_deg = nan", "constraints.yaw_deg"),
        ("[constraints]\nyaw_deg = inf", "constraints.yaw_deg"),
        ("[constraints]\nyaw_deg = 'five'", "constraints.yaw_deg"),
        ("[constraints]\nyaw_deg = true", "constraints.yaw_deg"),
        ("[constraints]\nyaw_deg = [5]", "constraints.yaw_deg"),
        ("[constraints]\nyaw_deg = -5", "yaw"),
        ("[servo]\ndamping_n_m_s_per_rad = nan", "servo.damping_n_m_s_per_rad"),
        ("[servo]\ndamping_n_m_s_per_rad = 0", "damping"),
        ("[foot]\nbig_toe_width_mm = nan", "foot.big_toe_width_mm"),
        ("[foot]\nbig_toe_width_mm = 220", "big_toe_width"),
        ("[design]\nbig_toe_width_mm = 22", "design.big_toe_width_mm"),
        ("[design]\nbig_toe_width_mm = [10]", "design.big_toe_width_mm"),
        ("[design]\nbig_toe_width_mm = [10, nan]", "design.big_toe_width_mm"),
        ("[design]\nbig_toe_width_mm = [10, 'x']", "design.big_toe_width_mm"),
        ("[design]\nbig_toe_width_mm = [40, 10]", "big_toe_width"),
        ("[walk]\ntime_limit_s = nan", "walk.time_limit_s"),
        ("[walk]\ntime_limit_s = 0", "time_limit"),
        ("[walk]\nfidelity = 'coarse'", "walk.fidelity must be one of search, reference"),
        ("[walk]\nfidelity = 3", "walk.fidelity"),
        ("[walk]\nmodel = 3", "walk.model"),
        ("[search]\nsamples = 2.5", "search.samples"),
        ("[search]\nsamples = nan", "search.samples"),
        ("[search]\nsamples = true", "search.samples"),
        ("[search]\nsamples = '20'", "search.samples"),
        ("[search]\nsamples = 0", "search.samples"),
        ("[search]\nbatch = 0", "search.batch"),
        ("[search]\nstagnation = 0", "search.stagnation"),
        ("[search]\nsamples = 500", "search.simulations"),
    ],
)
def test_a_value_that_is_none_is_refused_by_its_name(read, text, name):
    assert name in refused(read, MINIMAL + text)


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("seed = -1", "study.seed"),
        ("seed = 1.5", "study.seed"),
        ("seed = true", "study.seed"),
        ("seed = nan", "study.seed"),
        ("question = 3", "study.question"),
    ],
)
def test_a_wrong_value_of_the_study_section_is_refused_by_its_name(read, line, name):
    assert name in refused(read, MINIMAL.replace("[box]", f"{line}\n[box]"))


@pytest.mark.parametrize("name", ['""', '"a/b"', '".hidden"', '".."', "3", "true", "[]"])
def test_a_name_that_does_not_do_as_a_folder_is_refused(read, name):
    assert "name" in refused(read, MINIMAL.replace('"minimal"', name))


@pytest.mark.parametrize(
    "rows",
    [
        "[1, 2, 3]",
        "3",
        "'x'",
        "[[1, 1, 1, 1], [2, 2, 2, 2], [2, 2, 2, 2]]",
        "[[1, 1, 1, 1], [2, 2, 2], [2, 2, 2, 2], [2, 2, 2, 2]]",
        "[[1, 1, 1, 'a'], [2, 2, 2, 2], [2, 2, 2, 2], [2, 2, 2, 2]]",
        "[[1, 1, 1, '1'], [2, 2, 2, 2], [2, 2, 2, 2], [2, 2, 2, 2]]",
        "[[1, 1, 1, true], [2, 2, 2, 2], [2, 2, 2, 2], [2, 2, 2, 2]]",
        "[[1, 1, 1, nan], [2, 2, 2, 2], [2, 2, 2, 2], [2, 2, 2, 2]]",
        "[[1, 1, 1, inf], [2, 2, 2, 2], [2, 2, 2, 2], [2, 2, 2, 2]]",
    ],
)
def test_a_box_that_is_not_four_rows_of_four_numbers_is_refused(read, rows):
    text = re.sub(r"half_width_deg = .*", f"half_width_deg = {rows}", MINIMAL)
    assert "half_width_deg" in refused(read, text)


@pytest.mark.parametrize("key", ["centre_deg", "half_width_deg"])
def test_a_study_without_a_box_is_told_what_a_box_is(read, key):
    text = re.sub(rf"(?m)^{key} = .*$", "", MINIMAL)
    assert f"needs {key}: 4 rows (roll, hip, knee, ankle) of 4 degrees" in refused(read, text)


def with_centre_from(result):
    return re.sub(r"(?m)^centre_deg = .*$", f'centre_from = "{result}"', MINIMAL)


def test_a_box_may_lie_around_the_winner_of_an_earlier_study(read, tmp_path):
    rows = [
        [0.1, 1.0, 2.0, 0.0],
        [12.0, -9.0, 8.0, 0.5],
        [20.0, -1.5, 12.0, 0.0],
        [9.0, 6.0, 5.0, 1.0],
    ]
    (tmp_path / "result.json").write_text(json.dumps({"coefficients_deg": rows}))
    assert np.degrees(read(with_centre_from("result.json")).space.centre) == pytest.approx(
        np.array(rows)
    )


def test_a_winner_named_on_the_command_line_takes_the_place_of_the_centre(tmp_path, monkeypatch):
    study = tmp_path / "studies" / "study.toml"
    study.parent.mkdir()
    study.write_text(MINIMAL)
    rows = np.arange(16.0).reshape(4, 4) / 4.0
    (tmp_path / "result.json").write_text(json.dumps({"coefficients_deg": rows.tolist()}))
    monkeypatch.chdir(tmp_path)  # The name is one of the folder where the command is given.
    settings = read_study(study, {("box", "centre_from"): "result.json"})
    assert np.degrees(settings.space.centre) == pytest.approx(rows)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (None, "cannot read the result"),
        ("{}", "is no result.json of a study"),
        ('{"coefficients_deg": [[1, 2]]}', "box.centre_deg must be 4 rows of 4 numbers"),
    ],
)
def test_a_result_that_is_none_cannot_be_the_centre_of_a_box(read, tmp_path, content, told):
    if content is not None:
        (tmp_path / "result.json").write_text(content)
    assert told in refused(read, with_centre_from("result.json"))


def test_a_box_with_two_centres_is_refused(read):
    text = MINIMAL.replace("half_width_deg", 'centre_from = "result.json"\nhalf_width_deg')
    assert "either centre_deg or centre_from" in refused(read, text)


def test_a_study_without_a_name_is_told_so(read):
    assert "[study] needs a name" in refused(read, MINIMAL.replace('name = "minimal"', ""))
    assert "[study] needs a name" in refused(read, MINIMAL[MINIMAL.index("[box]") :])


@pytest.mark.parametrize("section", ["study", "search", "box", "servo", "design"])
def test_a_section_that_is_a_value_is_refused(read, section):
    assert f"[{section}] must be a section, got 3" in refused(read, f"{section} = 3")


def test_an_override_in_a_section_that_is_a_value_is_refused(read):
    text = f"search = 3\n{MINIMAL}"
    assert "[search] must be a section" in refused(read, text, {("search", "samples"): 3})


def test_a_syntax_error_is_told_with_its_line(read):
    assert "line 3" in refused(read, "[study]\n\nname = = 3\n")


def test_a_file_that_is_not_text_is_refused(tmp_path):
    path = tmp_path / "study.toml"
    path.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(SettingsError, match=r"study\.toml is not TOML"):
        read_study(path)


def test_a_study_that_does_not_exist_is_told_with_its_path(tmp_path):
    with pytest.raises(SettingsError, match=r"cannot read study .*nowhere\.toml: No such file"):
        read_study(tmp_path / "nowhere.toml")
    with pytest.raises(SettingsError, match="cannot read study"):
        read_study(tmp_path)


# --- What walks on which sole, from which start ---------------------------------------------------


def test_a_new_study_walks_on_areas_from_a_ramp(read):
    walk = read(MINIMAL).walk
    assert (walk.sole, walk.start, walk.stepping.step) == (Sole.AREA, Start.RAMP, 0.004)


def test_a_file_names_sole_start_and_step(read):
    walk = read(EVERY_KEY).walk
    assert (walk.sole, walk.start, walk.step) == (Sole.POINTS, Start.PAPER, 0.0025)


def test_a_study_of_before_walked_on_boxes_from_the_paper_s_start(read):
    description = read(MINIMAL).description()
    for key in ("walk.sole", "walk.step", "walk.friction", "gait.start"):
        del description[key]
    walk = study_settings(description).walk
    assert (walk.sole, walk.start, walk.step, walk.friction) == (
        Sole.BOXES,
        Start.PAPER,
        0.004,
        1.0,
    )


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        (("walk", "sole"), "mud", "area, points, boxes"),
        (("walk", "sole"), 3, "area, points, boxes"),
        (("gait", "start"), "blend", "ramp, paper"),
        (("gait", "start"), ["ramp"], "ramp, paper"),
        (("walk", "step_ms"), 0.01, "0.1 to 20 ms"),
        (("walk", "step_ms"), 40, "0.1 to 20 ms"),
    ],
)
def test_a_sole_a_start_or_a_step_that_is_none_is_refused(read, name, value, allowed):
    with pytest.raises(SettingsError) as refused:
        read(MINIMAL, {name: value})
    text = str(refused.value)
    assert "\n" not in text
    assert all(part in text for part in (".".join(name), allowed, repr(value)))
