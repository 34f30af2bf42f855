"""The procedure: samples, network, ISADE, confirmation by simulation (paper, IV.C, steps 1-6).

The study file is the state. A search that is resumed reads it and proposes the same walks again.
For every random number has an address (seed, purpose, index), and a network is trained on the walks
of earlier iterations only.
"""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import replace
from functools import partial

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.problem import DesignSpace, Trial
from drake_gait.search import modes
from drake_gait.search.confirmation import confirm
from drake_gait.search.grounds import Grounded, end_of_proposal, on_ground
from drake_gait.search.proposer import Proposal, Proposer
from drake_gait.search.runner import Evaluate, Planned, Progress, Runner, perturbed
from drake_gait.study.ranking import Sample, sample
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study
from drake_gait.surrogates.arithmetic import single_thread
from drake_gait.surrogates.ensemble import Surrogate
from drake_gait.surrogates.prediction import Network, Prediction

_ROUNDING = 1e-6
"""A design vector beyond a limit by no more than this is at it, in units of the box."""

_STAGES = ("design", "infill")

_WORTH_A_START = 4  # Walks that take as long as the start of a process.


def search(
    settings: StudySettings,
    study: Study,
    evaluate: Evaluate,
    report: Callable[[Progress], None] = lambda progress: None,
    *,
    proposer: Proposer | None = None,
) -> None:
    """Run a study to its end, from wherever it stands.

    Args:
        settings: What to search, how, and with how many walks.
        study: Where every finished walk is kept.
        evaluate: Simulates trials.
        report: Told how far it is, after every walk.
        proposer: Proposes the candidates; by default that of the study's mode.

    Raises:
        SettingsError: the proposer proposes what cannot be walked.
        WorkerError: what simulates yields other walks than it was given.
    """
    runner = Runner(settings, study, evaluate, report)
    run = _Run(settings, runner, proposer or modes.proposer(settings))
    for iteration in range(run.iterations):
        if run.is_complete(iteration):
            continue
        if run.has_converged(iteration):  # Step 6.
            break
        run.learn_ahead(iteration)  # Step 3.
        runner.wait(run.heard_ids(iteration))  # Meanwhile: what is still simulated.
        run.learn_ahead(iteration)
        proposal = run.propose(iteration, run.network(iteration))  # Steps 1 and 4.
        runner.start(run.planned(iteration, proposal), beside=True)  # Steps 2 and 5.
    runner.finish()
    confirm(settings, runner, run.samples())


def useful_workers(settings: StudySettings, proposer: Proposer | None = None) -> int:
    """Return how many processes can walk for a study at once and are worth their start.

    A process takes as long to start as a few walks take.
    """
    own, plan = proposer or modes.proposer(settings), settings.search
    at_once = max(own.samples, own.batch * plan.replicas, settings.confirmation.replicas)
    return max(1, min(at_once, plan.simulations // _WORTH_A_START))


def _in_background(function: Callable[[], Network | None]) -> "Future[Network | None]":
    """Return the promise of a function's value, from a thread that holds up no Ctrl-C."""
    promise: Future[Network | None] = Future()

    def keep() -> None:
        try:
            promise.set_result(function())
        except BaseException as error:
            promise.set_exception(error)

    threading.Thread(target=keep, daemon=True).start()
    return promise


class _Run:
    """State of one search: its steps, and the walks known so far.

    Candidates are numbered from 0; those after a design of experiments have replicas.
    """

    def __init__(self, settings: StudySettings, runner: Runner, proposer: Proposer) -> None:
        self._settings, self._plan = settings, settings.search
        self._runner = runner
        self._proposer = proposer
        samples = min(proposer.samples, self._plan.simulations)
        self._single = samples if self._plan.learns else 0
        # Not part of the protocol, so that a proposer of one's own needs none.
        self._overlap: int = getattr(proposer, "overlap", 0)
        self._known: dict[int, Sample] = {}
        self._networks: dict[int, Future[Network | None]] = {}

    @property
    def iterations(self) -> int:
        """Iterations that the budget has room for, the design of experiments included."""
        rest = self._candidates - self._proposer.samples
        return 1 + max(0, -(-rest // self._proposer.batch))

    def is_complete(self, iteration: int) -> bool:
        """Return whether every walk of an iteration is known."""
        ids = (id_ for number in self._numbers(iteration) for id_ in self._ids(number))
        return all(id_ in self._runner.walks for id_ in ids)

    def has_converged(self, iteration: int) -> bool:
        """Return whether the allowed number of networks has not bettered the best feasible walk."""
        patience = self._plan.stagnation
        if patience is None or iteration <= patience:
            return False
        self._runner.finish()
        best = min(self._samples_before(iteration), key=lambda one: one.rank)
        return best.number < self._numbers(iteration - patience).start

    def heard_ids(self, iteration: int) -> set[int]:
        """Return the ids of the latest walks that the proposal of an iteration knows."""
        first = self._numbers(max(0, iteration - 2)).start
        heard = range(first, self._heard(iteration))
        return {id_ for number in heard for id_ in self._ids(number)}

    def learn_ahead(self, iteration: int) -> None:
        """Start to learn what this iteration and the next ones use, as far as walks are known."""
        for vintage in map(self._proposer.vintage, range(iteration, self.iterations)[:3]):
            before = range(max(0, vintage - 2), vintage)
            if vintage < iteration and all(map(self.is_complete, before)):
                self._start_learning(vintage)

    def network(self, iteration: int) -> Network | None:
        """Return the network of an iteration, once it is learnt."""
        vintage = self._proposer.vintage(iteration)
        self._start_learning(vintage)
        self._networks = {key: one for key, one in self._networks.items() if key >= vintage}
        return self._networks[vintage].result()

    def learning(self, vintage: int) -> Callable[[], Network | None]:
        """Learns from the samples before an iteration, which are known."""
        return partial(self._proposer.learn, vintage, self._samples_before(vintage))

    def _start_learning(self, vintage: int) -> None:
        if vintage not in self._networks:
            self._networks[vintage] = _in_background(self.learning(vintage))

    def propose(self, iteration: int, network: Network | None) -> Proposal:
        """The candidates of an iteration."""
        if isinstance(network, Surrogate):
            self._runner.network = network
        known = [self._sample(number) for number in range(self._heard(iteration))]
        count = len(self._numbers(iteration))
        with single_thread():  # Once, not at each of a thousand predictions.
            proposal = self._proposer.propose(iteration, known, network, count)
        _check(proposal, self._settings.space, self._proposer.name, iteration, count)
        return proposal

    def planned(self, iteration: int, proposal: Proposal) -> Iterator[Planned]:
        """The walks of a proposal."""
        # Of all: the last digits of a prediction depend on how many are made together.
        network = self._on_its_ground(proposal.network, iteration)
        expected = network.predict(proposal.x) if network else None
        for place, number in enumerate(self._numbers(iteration)):
            candidate = self._settings.space.decode(proposal.x[place])
            first = self._ids(number).start
            nominal = Trial(candidate=candidate, settings=self._settings.walk)
            end = end_of_proposal(self._settings, iteration, first)
            own = replace(nominal, settings=on_ground(nominal.settings, self._settings, end))
            for variation, id_ in enumerate(self._ids(number)):
                yield Planned(
                    id=id_,
                    stage=proposal.stage,
                    iteration=iteration,
                    trial=perturbed(nominal, self._settings, first, variation)
                    if variation
                    else own,
                    nominal=first if variation else None,
                    variation=variation,
                    predicted=_expected(expected, place) if expected else None,
                )

    def _on_its_ground(self, network: Network | None, iteration: int) -> Network | None:
        first = self._ids(self._numbers(iteration).start).start
        if isinstance(network, Grounded):
            return network.on(end_of_proposal(self._settings, iteration, first))
        return network

    def samples(self) -> list[Sample]:
        """All samples."""
        complete = (
            self._numbers(iteration)
            for iteration in range(self.iterations)
            if self.is_complete(iteration)
        )
        return [self._sample(number) for numbers in complete for number in numbers]

    @property
    def _candidates(self) -> int:
        return self._single + (self._plan.simulations - self._single) // self._plan.replicas

    def _numbers(self, iteration: int) -> range:
        """Numbers of an iteration's candidates."""
        size = self._proposer.samples if iteration == 0 else self._proposer.batch
        start = 0 if iteration == 0 else self._proposer.samples + (iteration - 1) * size
        return range(start, min(start + size, self._candidates))

    def _ids(self, number: int) -> range:
        """Ids of a candidate's walks; the first is of the candidate as it is."""
        if number < self._single:
            return range(number, number + 1)
        start = self._single + (number - self._single) * self._plan.replicas
        return range(start, start + self._plan.replicas)

    def _heard(self, iteration: int) -> int:
        """Return the number of samples that the proposal of an iteration knows.

        Some of the batch before are still being simulated meanwhile, so that workers never wait.
        """
        before = self._numbers(iteration).start
        return before - self._overlap if iteration > 1 else before

    def _samples_before(self, iteration: int) -> list[Sample]:
        stop = self._numbers(iteration).start
        return [self._sample(number) for number in range(stop)]

    def _sample(self, number: int) -> Sample:
        if number not in self._known:
            walks = [self._runner.walks[id_] for id_ in self._ids(number)]
            self._known[number] = sample(number, walks, self._settings)
        return self._known[number]


def _expected(prediction: Prediction, index: int) -> dict[str, float]:
    forward, lateral, yaw = (float(value) for value in prediction.mean[index][:3])
    survival = float(prediction.survival[index])
    return {"forward": forward, "lateral": lateral, "yaw": yaw, "survival": survival}


def _check(proposal: Proposal, space: DesignSpace, name: str, iteration: int, count: int) -> None:
    """Refuse design vectors that are not the ones asked for, or that no candidate has."""
    told = f"iteration {iteration} of the proposer {name}"
    x = np.asarray(proposal.x, dtype=float)
    if x.shape != (count, space.dimension):
        raise SettingsError(
            f"{told} proposes design vectors of shape {x.shape}; it must be "
            f"({count}, {space.dimension})"
        )
    lower, upper = space.limits.T
    outside = ~((x >= lower - _ROUNDING) & (x <= upper + _ROUNDING))  # NaN is outside too.
    if outside.any():
        row, column = np.argwhere(outside)[0]
        raise SettingsError(
            f"{told} proposes {space.names[column]} = {x[row, column]:g} in row {row}; in units of "
            f"the box it must lie in {lower[column]:.6g} to {upper[column]:.6g}; clip it to "
            "settings.space.limits"
        )
    if proposal.stage not in _STAGES:
        raise SettingsError(
            f"{told} gives the stage {proposal.stage!r}; it must be one of {', '.join(_STAGES)}"
        )
