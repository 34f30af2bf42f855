"""Which of a search's walks can be trusted: its best candidates, walked again.

A single walk says little: a twentieth of a degree may turn it by degrees. The best candidates are
walked with noise on every coefficient and friction that is lower and higher in turn; one that
fails too often is dropped at once. The robust ones, and the best single walk, are then walked at
reference fidelity.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from drake_gait.problem.problem import Trial
from drake_gait.search.grounds import end_of, on_ground
from drake_gait.search.runner import Planned, Runner, perturbed
from drake_gait.study.finalists import REFERENCE, Finalist, finalists, winner
from drake_gait.study.ranking import Sample
from drake_gait.study.records import CONFIRMATION, CONFIRMATIONS, StudyWalk
from drake_gait.study.settings import StudySettings
from drake_gait.walk import Fidelity, WalkSettings

__all__ = ["Finalist", "confirm", "finalists", "walked_as", "winner"]

_IN_TURN = 4
"""Candidates that are walked again side by side: workers are to have enough to do."""
_LOOKED_AT = 12
"""Feasible walks, the best first, that are looked at for one that does not slip."""


def confirm(settings: StudySettings, runner: Runner, samples: Sequence[Sample]) -> None:
    """Walk the best candidates of a finished search again.

    The same walks give the same confirmation: one that was interrupted goes on.
    """
    if settings.confirmation.walks == 0:
        return
    race = _Race(settings, runner, samples)
    while contenders := race.contenders():
        runner.start(race.next_walks(contenders))
        runner.finish()
    runner.start(race.last_walks())
    runner.finish()


def walked_as(settings: StudySettings, walk: StudyWalk) -> WalkSettings:
    """How any walk of a study was simulated, its ground and fidelity included."""
    if walk.variation == REFERENCE:
        return replace(settings.walk, fidelity=Fidelity.REFERENCE)
    return on_ground(settings.walk, settings, end_of(settings, walk))


def _after_replicas(settings: StudySettings, variation: int) -> int:
    """Other noise than that of the search's own replicas."""
    return variation + settings.search.replicas - 1


class _Race:
    """The best candidates, walked again a few at a time until enough are known to be robust."""

    def __init__(self, settings: StudySettings, runner: Runner, samples: Sequence[Sample]) -> None:
        self._settings, self._plan = settings, settings.confirmation
        self._runner = runner
        ranked = sorted(samples, key=lambda one: one.rank)
        self._field = [one for one in ranked if one.assessment.feasible]
        self._tried: dict[int, int] = {}  # Variations of a sample, by its number.
        self._used = 0

    def contenders(self) -> list[Sample]:
        """Those that are walked again next; none when the race is over."""
        if sum(self._is_robust(one) for one in self._field) >= self._plan.winners:
            return []
        open_ = [one for one in self._field if not self._is_decided(one)]
        return open_[: min(_IN_TURN, self._plan.walks - self._used)]

    def next_walks(self, contenders: Sequence[Sample]) -> list[Planned]:
        """One more variation of each."""
        planned = []
        for one in contenders:
            variation = self._tried.get(one.number, 0) + 1
            self._tried[one.number] = variation
            self._used += 1
            planned.append(self._planned(one, variation))
        return planned

    def last_walks(self) -> Iterator[Planned]:
        """The measures of the best, and the reference walks of those that are to be believed."""
        robust = [one for one in self._field if self._is_robust(one)]
        listed = {one.number: one for one in (*robust, *self._field[:1])}  # In full.
        for one in listed.values():
            for variation in (*range(1, self._plan.replicas + 1), REFERENCE):
                yield self._planned(one, variation)
        for one in {**listed, **{one.number: one for one in self._field[:_LOOKED_AT]}}.values():
            yield self._planned(one, 0)

    def _planned(self, one: Sample, variation: int) -> Planned:
        nominal = one.walks[0]
        trial = Trial(candidate=nominal.candidate, settings=self._settings.trial_settings)
        if variation == REFERENCE:
            trial = replace(trial, settings=replace(trial.settings, fidelity=Fidelity.REFERENCE))
        elif variation == 0:
            own = on_ground(trial.settings, self._settings, end_of(self._settings, nominal))
            trial = replace(trial, settings=replace(own, measures=True))
        else:
            other = _after_replicas(self._settings, variation)
            trial = perturbed(trial, self._settings, nominal.id, other)
        return Planned(
            id=self._id(one, variation),
            stage=CONFIRMATION,
            iteration=nominal.iteration,
            trial=trial,
            nominal=nominal.id,
            variation=variation,
        )

    def _id(self, one: Sample, variation: int) -> int:
        """A walk's id, the same whatever else is confirmed: with room for every variation."""
        room = self._plan.replicas + 2
        return CONFIRMATIONS + one.number * room + variation - REFERENCE

    def _walks(self, one: Sample) -> list[StudyWalk]:
        ids = (self._id(one, number) for number in range(1, self._tried.get(one.number, 0) + 1))
        return [self._runner.walks[id_] for id_ in ids]

    def _failures(self, one: Sample) -> int:
        return sum(not self._settings.assess(walk.walk).feasible for walk in self._walks(one))

    def _is_robust(self, one: Sample) -> bool:
        tried = self._tried.get(one.number, 0)
        return tried - self._failures(one) >= self._plan.feasible

    def _is_decided(self, one: Sample) -> bool:
        lost = self._failures(one) > self._plan.replicas - self._plan.feasible
        return lost or self._tried.get(one.number, 0) == self._plan.replicas
