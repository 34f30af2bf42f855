"""What a search recommends: by the model's mean, means of neighbours too, and answers count."""

import dataclasses

import numpy as np
import pytest
from conftest import fall_at, run, walk_at
from robust_problem import Grounds

from drake_gait.problem import Trial
from drake_gait.search.recommendation import Adviser, recommended
from drake_gait.search.runner import perturbed
from drake_gait.study.ranking import sample
from drake_gait.study.records import CONFIRMATIONS, StudyWalk
from drake_gait.study.search_settings import SearchSettings


@pytest.fixture(scope="module")
def found(study, tmp_path_factory):
    """Settings and samples of a search on the robust problem."""
    plan = SearchSettings(samples=40, simulations=90, batch=10)
    settings = dataclasses.replace(study, search=plan)
    walks = run(settings, tmp_path_factory.mktemp("found") / "s.db", Grounds(settings))
    return settings, [sample(walk.id, [walk], settings) for walk in walks]


def told(settings, one, number, *, holds):
    """An answer about a recommended candidate."""
    nominal = Trial(candidate=one.candidate, settings=settings.walk)
    trial = perturbed(nominal, settings, one.nearest, number)
    good = dataclasses.replace(walk_at(np.zeros(16)), com_height=0.2445, lateral=0.0, yaw=0.0)
    return StudyWalk(
        id=CONFIRMATIONS + 100 * one.nearest + number,
        stage="confirmation",
        iteration=1,
        nominal=one.nearest,
        variation=number,
        candidate=trial.candidate,
        walk=good if holds else fall_at(np.zeros(16)),
    )


def test_candidates_come_by_chance_times_gain(found):
    first = recommended(*found)
    promises = [one.promise for one in first]
    assert promises == sorted(promises, reverse=True)
    assert promises == [one.chance * one.gain for one in first]
    assert all(one.gain > 0.0 for one in first)
    assert all(0.0 < one.chance < 1.0 for one in first)


def test_what_is_confirmed_already_is_no_gain(found):
    settings, samples = found
    adviser = Adviser(settings, samples)
    everything = adviser.recommended()
    beyond = float(np.median([one.gain for one in everything]))
    further = adviser.recommended(beyond=beyond)
    gains = sorted(one.gain for one in everything if one.gain > beyond)
    assert sorted(one.gain for one in further) == gains
    promises = [one.chance * (one.gain - beyond) for one in further]
    assert promises == [one.promise for one in further]
    assert promises == sorted(promises, reverse=True)


def test_all_feasible_samples_are_there_and_means_of_good_ones(found):
    settings, samples = found
    feasible = {one.number for one in samples if one.assessment.feasible}
    listed = recommended(settings, samples)
    assert {one.number for one in listed} - {None} == feasible
    means = [one for one in listed if one.number is None]
    assert len(means) == 25
    x = {one.number: settings.space.encode(one.candidate) for one in samples}
    for one in means[:5]:
        # A mean of five lies within their box, and nobody walked it.
        assert one.nearest in feasible
        assert min(((one.x - point) ** 2).sum() for point in x.values()) > 0.0
        assert settings.space.encode(one.candidate) == pytest.approx(one.x)


def test_the_same_samples_and_answers_recommend_the_same(found):
    settings, samples = found
    one, other = Adviser(settings, samples), Adviser(settings, samples)
    answers = [told(settings, first, 1, holds=False) for first in one.recommended()[:3]]
    other.recommended(answers[:1])  # What was asked before does not matter.
    for mine, its in zip(one.recommended(answers), other.recommended(answers), strict=True):
        assert (mine.x == its.x).all()
        assert mine.chance == its.chance


def test_failures_lower_the_chance_of_what_is_like_them_and_successes_raise_it(found):
    settings, samples = found
    adviser = Adviser(settings, samples)
    before = adviser.recommended()
    chances = {}
    for holds in (False, True):
        answers = [
            told(settings, one, number, holds=holds) for one in before[:6] for number in (1, 2)
        ]
        after = {one.x.tobytes(): one.chance for one in adviser.recommended(answers)}
        chances[holds] = np.array([after[one.x.tobytes()] for one in before[:6]])
    alone = np.array([one.chance for one in before[:6]])
    assert (chances[False] < alone).all()
    assert (alone < chances[True]).all()


def test_answers_teach_that_long_walks_fail(found):
    settings, samples = found
    adviser = Adviser(settings, samples)
    listed = [one for one in adviser.recommended() if one.number is not None]
    by_gain = sorted(listed, key=lambda one: one.gain)
    short, long = by_gain[:12], by_gain[-12:]
    answers = [told(settings, one, n, holds=True) for one in short for n in (1, 2)]
    answers += [told(settings, one, n, holds=False) for one in long for n in (1, 2)]
    after = {one.number: one.chance for one in adviser.recommended(answers)}
    before = {one.number: one.chance for one in listed}

    def odds_of_short(chance):
        return np.mean([chance[one.number] for one in short]) / np.mean(
            [chance[one.number] for one in long]
        )

    assert odds_of_short(after) > 1.5 * odds_of_short(before)


def test_without_a_network_all_feasible_samples_come_by_what_they_walked(study):
    walk = dataclasses.replace(walk_at(np.zeros(16)), com_height=0.2445, lateral=0.0)
    x = np.random.default_rng(0).uniform(-1.0, 1.0, (6, 16))
    samples = [
        sample(
            number,
            [
                StudyWalk(
                    id=number,
                    stage="design",
                    iteration=0,
                    candidate=study.space.decode(point),
                    walk=dataclasses.replace(walk, forward=0.1 + 0.01 * number),
                )
            ],
            study,
        )
        for number, point in enumerate(x)
    ]
    found = recommended(study, samples)
    assert sorted(one.number for one in found) == list(range(6))
    assert [one.promise for one in found] == sorted((one.promise for one in found), reverse=True)
    for one in found:
        assert one.gain == pytest.approx(0.1 + 0.01 * one.number)


def test_nothing_feasible_recommends_nothing(study):
    lost = StudyWalk(
        id=0,
        stage="design",
        iteration=0,
        candidate=study.space.decode(np.zeros(16)),
        walk=fall_at(np.zeros(16)),
    )
    assert recommended(study, [sample(0, [lost], study)]) == []
