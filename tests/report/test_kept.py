"""Parts of a report are made again where they would come out otherwise, and only there."""

import dataclasses
import json

import numpy as np
import pytest

from drake_gait.problem import Candidate
from drake_gait.report import build
from drake_gait.report.build import write_outputs
from drake_gait.report.kept import Kept, fingerprint
from drake_gait.surrogates import baselines
from drake_gait.walk import Outcome

SETTINGS_OF_A_WALK = ("text", 3, 0.1, True, None, Outcome.WALKED, np.arange(4.0))


@pytest.fixture
def walks(study, entry):
    """Forty walks of a study, eight of which fell, scattered over its box."""
    draw = np.random.default_rng(0)
    fell = dataclasses.replace(entry.walk, outcome=Outcome.FELL, frames=120)

    def walk(number):
        x = draw.uniform(-1.0, 1.0, 16)
        gone = dataclasses.replace(entry.walk, forward=0.2 + 0.05 * x[0], yaw=0.01 * x[1])
        return dataclasses.replace(
            entry,
            id=number,
            candidate=Candidate(gait=study.space.decode(x).gait),
            walk=fell if number % 5 == 0 else gone,
        )

    return [walk(number) for number in range(40)]


@pytest.fixture
def made(monkeypatch, entry):
    """Names of the parts that reports make, as they make them; walks have no history."""
    made = []
    monkeypatch.setattr(build, "simulate", lambda *_, **__: made.append("walk") or entry.walk)
    monkeypatch.setattr(build, "_draw_search", lambda *_: made.append("search"))
    monkeypatch.setattr(build, "_draw_network", lambda *_: made.append("network"))
    return made


def test_a_report_of_the_same_walks_makes_nothing_again_and_says_the_same(
    study, walks, made, tmp_path, monkeypatch
):
    first = write_outputs(study, walks, tmp_path, wall_s=1.0)
    assert sorted(made) == ["network", "search", "walk"]
    said = (tmp_path / "result.json").read_bytes()
    made.clear()
    monkeypatch.delattr(baselines, "compare")
    again = write_outputs(study, walks, tmp_path, wall_s=1.0)
    assert made == []
    assert (tmp_path / "result.json").read_bytes() == said
    assert again.network.r2_heldout.tolist() == first.network.r2_heldout.tolist()
    assert again.result == first.result
    assert again.measures == first.measures


def test_a_walk_more_is_a_network_and_a_search_to_draw_but_not_the_best_walk(
    study, walks, made, tmp_path
):
    worst = min(walks, key=lambda one: one.walk.forward)
    write_outputs(study, [one for one in walks if one is not worst], tmp_path, wall_s=1.0)
    made.clear()
    write_outputs(study, walks, tmp_path, wall_s=1.0)
    assert sorted(made) == ["network", "search"]


@pytest.mark.parametrize("spoil", ["{", "[]", '{"made": 3}', '{"made": {"walk": {}}}'])
def test_a_result_that_says_nothing_of_its_parts_is_made_anew(study, walks, made, tmp_path, spoil):
    (tmp_path / "result.json").write_text(spoil)
    write_outputs(study, walks, tmp_path, wall_s=1.0)
    assert sorted(made) == ["network", "search", "walk"]


def test_the_page_stands_before_a_network_is_learnt_and_has_it_afterwards(
    study, walks, made, tmp_path, monkeypatch
):
    seen = []

    def learn(*arguments, **options):
        seen.append((tmp_path / "report.html").read_text("utf-8"))
        seen.append(json.loads((tmp_path / "result.json").read_text("utf-8")))
        return compare(*arguments, **options)

    compare = baselines.compare
    monkeypatch.setattr(baselines, "compare", learn)
    write_outputs(study, walks, tmp_path, wall_s=1.0)
    page, result = seen
    assert "R²" not in page
    assert result["r2_heldout"]["forward"] is None
    assert "R²" in (tmp_path / "report.html").read_text("utf-8")


def test_a_network_learns_the_latest_walks_only(study, walks, made, tmp_path):
    lost = [dataclasses.replace(walks[0], id=walk.id) for walk in walks[:10]]
    assert write_outputs(study, walks, tmp_path, wall_s=1.0, learnt_from=30).network.walks == 30
    made.clear()
    write_outputs(study, [*lost, *walks[10:]], tmp_path, wall_s=1.0, learnt_from=30)
    assert "network" not in made


@pytest.mark.parametrize("change", ["gone", "other"])
def test_a_part_is_made_again_when_a_file_of_it_was_changed_or_lost(tmp_path, change):
    drawn = tmp_path / "drawn.svg"
    drawn.write_text("<svg/>")
    kept = Kept(tmp_path, {})
    kept.keep("part", "key", {"number": 1.5}, ["drawn.svg", "never.svg"])
    content = {"number": 1.5, "made": kept.plain()}
    assert Kept(tmp_path, content).found("part", "key") == {"number": 1.5}
    assert Kept(tmp_path, content).found("part", "other key") is None
    drawn.unlink() if change == "gone" else drawn.write_text("<svg></svg>")
    assert Kept(tmp_path, content).found("part", "key") is None


@pytest.mark.parametrize("value", SETTINGS_OF_A_WALK, ids=str)
def test_a_fingerprint_tells_every_value_from_every_other(value):
    assert fingerprint(value) == fingerprint(value)
    prints = {fingerprint(one) for one in SETTINGS_OF_A_WALK}
    assert len(prints) == len(SETTINGS_OF_A_WALK)
    assert fingerprint([value], []) != fingerprint([], [value])


def test_what_has_no_lasting_text_has_no_fingerprint():
    with pytest.raises(TypeError, match="lambda"):
        fingerprint(lambda: None)
