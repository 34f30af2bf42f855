"""Means of neighbours, which no search has walked, as candidates of a confirmation."""

import dataclasses
import time
from concurrent.futures import ThreadPoolExecutor, as_completed

import numpy as np
import pytest
from conftest import Interruption, numbers

from drake_gait.execution.base import Finished
from drake_gait.report.result import summary
from drake_gait.search.confirmation import confirm, walked_as
from drake_gait.search.grounds import BETWEEN, end_of
from drake_gait.search.recommendation import Recommended
from drake_gait.search.runner import Runner
from drake_gait.study.finalists import Tier, finalists, winner
from drake_gait.study.ranking import nominal_walks, sample
from drake_gait.study.records import CONFIRMATIONS, StudyWalk
from drake_gait.study.search_settings import ConfirmationSettings
from drake_gait.study.store import Study
from drake_gait.walk import Outcome, Walk

SEARCHED = 6
GAINS = (0.3, 0.5, 0.4)
"""What the means walk, and what is expected of them."""
GOOD = Walk(outcome=Outcome.WALKED, frames=240, forward=0.2, lateral=0.0, yaw=0.0, com_height=0.245)


@pytest.fixture
def settings(study):
    return dataclasses.replace(study, confirmation=ConfirmationSettings())


def point(number):
    """The design vector of a candidate; that of a mean lies between two of them."""
    return np.random.default_rng(number).uniform(-0.5, 0.5, 16)


MEANS = [0.5 * (point(n) + point(n + 1)) for n in range(3)]


def advise(settings, searched=SEARCHED):
    """Recommend all candidates, and means that promise more than any of them."""

    def recommended(answers):
        listed = [(point(n), n, n, 0.2 + 0.01 * n) for n in range(searched)]
        listed += [(x, None, n, GAINS[n]) for n, x in enumerate(MEANS)]
        return [
            Recommended(
                x=x,
                candidate=settings.space.decode(x),
                number=number,
                nearest=near,
                chance=0.7,
                gain=gain,
                promise=0.7 * gain,
            )
            for x, number, near, gain in listed
        ]

    return recommended


class Field:
    """Walks that hold, but for the mean in `falling`; it looks at what walks, and not at ids."""

    def __init__(self, settings, *, falling=(), stop_after=None):
        self.settings, self.falling, self.stop_after, self.asked = settings, falling, stop_after, 0

    def walk(self, trial):
        x = self.settings.space.encode(trial.candidate)
        near = [float(((x - one) ** 2).sum()) for one in MEANS]
        mean = int(np.argmin(near))
        if min(near) > 0.05:
            return GOOD
        if mean in self.falling:
            return dataclasses.replace(GOOD, outcome=Outcome.FELL, frames=99)
        return dataclasses.replace(GOOD, forward=GAINS[mean])

    def __call__(self, trials):
        for index, trial in enumerate(trials):
            if self.asked == self.stop_after:
                raise Interruption
            self.asked += 1
            yield Finished(index=index, walk=self.walk(trial), seconds=0.0)


class Hurried(Field):
    """The same from several threads, which end in no order."""

    def __init__(self, settings, workers):
        super().__init__(settings)
        self.pool = ThreadPoolExecutor(workers)

    def __call__(self, trials):
        futures = {self.pool.submit(self.slow, trial): n for n, trial in enumerate(trials)}
        return self.finished(futures)

    def finished(self, futures):
        for future in as_completed(futures):
            yield Finished(index=futures[future], walk=future.result(), seconds=0.0)

    def slow(self, trial):
        time.sleep(0.001 * (abs(hash(trial.candidate.gait.coefficients.tobytes())) % 4))
        return self.walk(trial)


def confirmed(settings, path, field=None, searched=SEARCHED):
    """Walks of a study after its confirmation."""
    field = field or Field(settings)
    opened = Study.open(path, driver=True) if path.exists() else Study.create(path, {})
    with opened as study:
        for number in range(len([w for w in study.walks() if w.is_search_walk]), searched):
            candidate = settings.space.decode(point(number))
            study.add(
                StudyWalk(
                    id=number,
                    stage="infill",
                    iteration=1,
                    candidate=candidate,
                    walk=GOOD,
                )
            )
        runner = Runner(settings, study, field, lambda progress: None)
        samples = [sample(n, [runner.walks[n]], settings) for n in range(searched)]
        confirm(settings, runner, samples, advise=advise(settings, searched))
        return study.walks()


def test_a_mean_that_holds_is_a_finalist_with_an_id_of_its_own_and_may_win(settings, path):
    walks = confirmed(settings, path)
    found = winner(settings, walks)
    assert found.walk.is_mean
    assert found.walk.id >= CONFIRMATIONS
    assert found.walk.candidate == settings.space.decode(MEANS[1])
    assert (found.tier, found.feasible, found.converged_feasible) == (Tier.CONVERGED, 8, 8)
    assert found.trusted == pytest.approx(0.5)
    assert {walk.nominal for walk in found.converged} == {found.walk.id}
    assert len(found.servo) == 16
    assert found.other_sole is not None
    assert len({walk.id for walk in walks}) == len(walks)
    assert len({walk.candidate for walk in found.variations + found.converged}) == 16


def test_a_mean_is_walked_as_it_is_between_the_grounds(settings, path):
    walks = confirmed(settings, path)
    (own,) = (walk for walk in walks if walk.id == winner(settings, walks).walk.id)
    assert end_of(settings, own) == BETWEEN
    assert walked_as(settings, own) == settings.walk
    # It is no walk of the search, and counts for none.
    assert not own.is_search_walk
    assert own.id not in {walk.id for walk in nominal_walks(walks)}


def test_a_mean_that_falls_as_it_is_is_dropped(settings, path):
    walks = confirmed(settings, path, Field(settings, falling=(1,)))
    found = winner(settings, walks)
    assert found.trusted == pytest.approx(0.4)
    assert found.walk.candidate == settings.space.decode(MEANS[2])
    (fallen,) = (walk for walk in walks if walk.is_mean and not walk.walk.survived)
    assert len([walk for walk in walks if walk.nominal == fallen.id]) <= 4


def test_without_means_no_mean_is_walked(settings, path):
    plain = dataclasses.replace(settings, confirmation=ConfirmationSettings(means=False))
    walks = confirmed(plain, path)
    assert not any(walk.is_mean for walk in walks)
    assert winner(plain, walks).trusted == pytest.approx(0.2)


@pytest.mark.parametrize("workers", [2, 4])
def test_any_number_of_workers_makes_the_same_walks_of_means(settings, tmp_path, workers):
    expected = confirmed(settings, tmp_path / "one.db")
    hurried = Hurried(settings, workers)
    assert numbers(confirmed(settings, tmp_path / "many.db", hurried)) == numbers(expected)


@pytest.mark.parametrize("walks", [1, 9, 22, 40, 60])
def test_means_go_on_as_they_were_begun(settings, tmp_path, walks):
    expected = confirmed(settings, tmp_path / "whole.db")
    parted = tmp_path / "parted.db"
    with pytest.raises(Interruption):
        confirmed(settings, parted, Field(settings, stop_after=walks))
    with Study.open(parted) as study:  # A study can be read wherever it was stopped.
        summary(settings, study.walks(), None, wall_s=0.0)
    assert numbers(confirmed(settings, parted)) == numbers(expected)


def test_means_of_a_longer_search_have_other_ids(settings, tmp_path):
    means = [
        {walk.id for walk in confirmed(settings, tmp_path / f"{n}.db", searched=n) if walk.is_mean}
        for n in (SEARCHED - 1, SEARCHED)
    ]
    assert means[0]
    assert means[1]
    assert not means[0] & means[1]


def test_a_result_says_that_a_mean_wins(settings, path):
    walks = confirmed(settings, path)
    result = summary(settings, walks, None, wall_s=0.0)
    first = result["finalists"][0]
    assert first["mean"]
    assert result["winner"] == first["walk"] == result["best"]["id"]
    assert "a mean of neighbours" in result["verdict"]
    assert result["simulations"] == SEARCHED
    assert sum(one["mean"] for one in result["finalists"]) < len(finalists(settings, walks))
