"""The comparison of the engines: what its rows count."""

import importlib
from dataclasses import replace

import numpy as np
import pytest

from drake_gait.gait import STANDING
from drake_gait.problem import Candidate
from drake_gait.sole import Sole
from drake_gait.walk import Engine, Fidelity, Outcome, Walk, WalkSettings


@pytest.fixture(scope="module")
def bench(repository):
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(repository / "tools")
        return importlib.import_module("bench_mujoco")


def walked(forward, lateral, degrees, outcome=Outcome.WALKED):
    return replace(
        Walk.diverged(""),
        outcome=outcome,
        forward=1e-3 * forward,
        lateral=1e-3 * lateral,
        yaw=np.radians(degrees),
    )


OWN = [walked(500, 10, 1), walked(510, -4, 2), walked(530, 6, -3), walked(560, 8, 0)]


def batch(bench, walks):
    return bench.Batch(walks, np.ones(len(walks)), elapsed=np.nan)


def cells(bench, walks):
    """The cells of a row by their headings."""
    text = bench.row("it", batch(bench, walks), batch(bench, OWN)).strip("|").split("|")
    return dict(zip(bench.HEADINGS, (cell.strip() for cell in text[1:]), strict=True))


def test_an_engine_agrees_with_itself(bench):
    found = cells(bench, OWN)
    assert found["Z r (mm)"] == found["X r (mm)"] == found["R r (deg)"] == "1.00 (0.0)"
    assert (found["X mm"], found["R deg"]) == ("+0.0", "+0.0")
    assert (found["same"], found["same side"]) == ("100 %", "4 of 4")


def test_what_an_engine_adds_to_every_walk_is_told_with_its_sign(bench):
    shifted = [walked(1e3 * w.forward - 7, 1e3 * w.lateral + 5, np.degrees(w.yaw) - 2) for w in OWN]
    found = cells(bench, shifted)
    assert found["Z r (mm)"] == "1.00 (7.0)"
    assert (found["X mm"], found["R deg"], found["same side"]) == ("+5.0", "-2.0", "3 of 4")


def test_only_who_survives_in_both_is_compared(bench):
    found = cells(bench, [*OWN[:3], walked(0, 900, 90, Outcome.FELL)])
    assert (found["survive"], found["same"]) == ("75 %", "75 %")
    assert (found["X r (mm)"], found["same side"]) == ("1.00 (0.0)", "3 of 3")


def test_every_candidate_walks_in_each_engine_in_turn(bench):
    order = []

    def engine(name):
        return lambda candidate: order.append(name) or OWN[0]

    candidates = [Candidate(gait=STANDING)] * 2
    found = bench.alternate({name: engine(name) for name in "ab"}, candidates)
    assert order == list("abab")
    assert len(found["a"].walks) == 2


@pytest.mark.parametrize("table", ["agreement", "causes"])
def test_the_reference_comes_first_and_both_engines_are_there_on_the_same_sole(bench, table):
    walk = WalkSettings(sole=Sole.POINTS)
    first, *others = getattr(bench, table)(walk).values()
    assert first.keywords["settings"] == replace(walk, fidelity=Fidelity.REFERENCE)
    settings = [one.keywords["settings"] for one in others]
    assert {one.engine for one in settings} == set(Engine)
    assert {one.sole for one in settings} == {Sole.POINTS}
