"""What each procedure proposes next."""

import dataclasses

import numpy as np
import pytest
from conftest import planned, quick_proposer, run, walk_at

from drake_gait.gait import FRAMES
from drake_gait.problem import OUTPUTS, Constraints, Objective
from drake_gait.search.grounds import Grounded
from drake_gait.search.learner import WINDOW, grounded_data
from drake_gait.search.modes import proposer
from drake_gait.search.paper import PaperProcedure
from drake_gait.search.proposer import design_of_experiments, training_data
from drake_gait.study.ranking import sample
from drake_gait.study.records import StudyWalk
from drake_gait.study.search_settings import Mode
from drake_gait.surrogates import ensemble as surrogate
from drake_gait.surrogates.residual_gp import KrigedNetwork
from drake_gait.surrogates.settings import PAPER_NETWORK
from drake_gait.walk import Walk


def test_the_design_of_experiments_is_a_latin_hypercube_in_the_box(study):
    x = design_of_experiments(study)
    assert x.shape == (40, 16)
    # One sample in each of forty slices of every variable.
    slices = np.sort(np.floor((x + 1.0) / 2.0 * 40), axis=0)
    assert (slices == np.arange(40)[:, None]).all()


def test_samples_stay_within_the_limits_where_the_box_reaches_beyond(study):
    centre = np.array(study.space.centre)
    centre[2, 0] = np.radians(0.5)
    narrow = dataclasses.replace(study, space=dataclasses.replace(study.space, centre=centre))
    limits = narrow.space.limits
    assert limits[8, 0] > -1.0
    x = design_of_experiments(narrow)
    assert (x >= limits[:, 0]).all()
    assert (x <= limits[:, 1]).all()


def test_the_seed_fixes_the_design_of_experiments(study):
    other = dataclasses.replace(study, seed=1)
    assert (design_of_experiments(study) == design_of_experiments(study)).all()
    assert (design_of_experiments(study) != design_of_experiments(other)).any()


def test_the_network_learns_from_design_vectors_in_the_order_of_the_walks(space, entry):
    x = np.linspace(-1, 1, 32).reshape(2, 16)
    walks = [
        StudyWalk(
            id=number,
            stage="design",
            iteration=0,
            candidate=space.decode(x[number]),
            walk=walk,
        )
        for number, walk in enumerate([entry.walk, Walk.diverged("made up")])
    ]
    vectors, outputs, survived = training_data(walks, space, OUTPUTS)
    assert vectors == pytest.approx(x, abs=1e-12)
    walk = entry.walk
    assert outputs[0].tolist() == [walk.forward, walk.lateral, walk.yaw, walk.com_height]
    assert survived.tolist() == [True, False]
    assert [part.shape for part in training_data([], space, OUTPUTS)] == [(0, 16), (0, 4), (0,)]


def samples_at(x, settings, walk=walk_at, *, first=0):
    """A sample of one walk at each design vector; the first has this number."""
    walks = [
        StudyWalk(
            id=number,
            stage="design",
            iteration=0,
            candidate=settings.space.decode(point),
            walk=walk(point),
        )
        for number, point in enumerate(x, first)
    ]
    return [sample(one.id, [one], settings) for one in walks]


@pytest.mark.parametrize(
    ("mode", "learnt_from"),
    [
        (Mode.DEFAULT, [20, 25]),
        (Mode.ISADE_NETWORK, [20, 25, 30]),
        (Mode.PAPER, [20, 21, 22, 23]),
    ],
)
def test_a_network_knows_all_walks_but_those_that_are_under_way_while_it_learns(
    study, tmp_path, monkeypatch, mode, learnt_from
):
    name = "fit_single" if mode is Mode.PAPER else "fit"
    fit, found = getattr(surrogate, name), []

    def watched(x, *rest, **options):
        found.append(len(x))
        return fit(x, *rest, **options)

    monkeypatch.setattr(surrogate, name, watched)
    batches = 20 + 4 * (1 if mode is Mode.PAPER else 5)
    run(planned(study, mode=mode, samples=20, simulations=batches, batch=5), tmp_path / "s.db")
    assert found == learnt_from


def test_the_default_corrects_its_network_by_its_errors_on_walks_it_had_no_time_to_learn(study):
    known = samples_at(np.random.default_rng(0).uniform(-1.0, 1.0, (55, 16)), study)
    one = proposer(study)
    assert one.vintage(2) == 1
    network = one.learn(1, known[:40])
    found = one.propose(2, known[:45], network, study.search.batch)
    data = grounded_data(study, [sample.walks[0] for sample in known[40:45]])
    expected = Grounded(KrigedNetwork(network, *data)).predict(found.x)
    assert found.network.predict(found.x).mean == pytest.approx(expected.mean)
    bare = Grounded(network).predict(found.x)
    assert expected.mean != pytest.approx(bare.mean, rel=1e-3)


@pytest.mark.parametrize("mode", [Mode.PAPER, Mode.ISADE, Mode.CMAES])
def test_the_other_procedures_wait_for_all_walks(study, mode):
    one = proposer(planned(study, mode=mode))
    assert [one.vintage(iteration) for iteration in range(9)] == list(range(9))


@pytest.mark.parametrize(
    ("mode", "first"),
    [(Mode.DEFAULT, [0, 1, 1, 1, 2, 3]), (Mode.ISADE_NETWORK, [0, 1, 1, 2, 3, 4])],
)
def test_networks_are_learnt_ahead_and_less_often_the_more_walks_there_are(study, mode, first):
    one = proposer(planned(study, mode=mode, samples=100, simulations=2500, batch=12))
    vintages = [one.vintage(iteration) for iteration in range(200)]
    assert vintages[:6] == first
    assert all(vintage < iteration for iteration, vintage in enumerate(vintages) if iteration > 1)
    renewed = np.flatnonzero(np.diff(vintages))
    assert np.diff(renewed)[-20:].tolist() == [3] * 20
    # Asked in any order, it says the same.
    other = proposer(planned(study, mode=mode, samples=100, simulations=2500, batch=12))
    assert [other.vintage(iteration) for iteration in (150, 7, 0)] == [
        vintages[iteration] for iteration in (150, 7, 0)
    ]


def test_a_network_learns_the_latest_walks_only(study):
    x = np.random.default_rng(0).uniform(-1.0, 1.0, (WINDOW + 50, 16))
    network = quick_proposer(study).learn(30, samples_at(x, study))
    assert len(network.x) == WINDOW
    assert network.x[:, :16] == pytest.approx(x[50:])


def nearest(x):
    """Smallest distance between two of some design vectors, per variable."""
    distance = np.sqrt(((x[:, None] - x) ** 2).mean(axis=2))
    return distance[~np.eye(len(x), dtype=bool)].min()


def propose(one, iteration, known, count):
    """What a proposer makes of samples that are all known."""
    return one.propose(iteration, known, one.learn(iteration, known), count)


def proposals(settings, known, iterations):
    """What the default proposes after some iterations, given the samples of each."""
    one = proposer(settings)
    for iteration in range(1, iterations + 1):
        before = known[: settings.search.samples + (iteration - 1) * settings.search.batch]
        found = one.propose(iteration, before, one.learn(iteration, before), settings.search.batch)
    return found.x


def test_proposals_of_a_batch_keep_apart(study):
    known = samples_at(design_of_experiments(study), study)
    x = proposals(study, known, 1)
    assert (x == proposals(study, known, 1)).all()
    assert nearest(x) > 0.1


def test_the_first_region_lies_around_the_better_samples(study):
    x = design_of_experiments(study)

    def uphill(point):
        return dataclasses.replace(walk_at(np.zeros(16)), forward=0.1 + 0.05 * float(point[0]))

    found = proposals(study, samples_at(x, study, uphill), 1)
    best = x[np.argsort(-x[:, 0])[:8]].mean(axis=0)
    # Drawn with a standard deviation of 0.35 in each variable.
    assert np.sqrt(((found - best) ** 2).mean(axis=1)).max() < 3 * 0.35


@pytest.mark.slow
def test_a_region_without_feasible_candidates_returns_to_the_best(study):
    settings = planned(study, samples=20, simulations=60, batch=5)
    rng = np.random.default_rng(0)
    # It hears of a batch when the next one is under way.
    x = np.vstack([design_of_experiments(settings), rng.uniform(2.0, 3.0, (25, 16))])

    def feasible_first(point):
        walk = dataclasses.replace(walk_at(np.zeros(16)), forward=0.1 + 0.01 * float(point[0]))
        return walk if np.abs(point).max() <= 1.0 else dataclasses.replace(walk, lateral=0.5)

    known = samples_at(x, settings, feasible_first)
    best = settings.space.encode(min(known, key=lambda one: one.rank).candidate)
    after_four = proposals(settings, known, 6)
    assert np.sqrt(((after_four - best) ** 2).mean(axis=1)).max() < 3 * 0.15
    after_three = proposals(settings, known, 5)
    assert np.sqrt(((after_three - best) ** 2).mean(axis=1)).min() > 3 * 0.15


def penalised(expected, limits):
    """The paper's F(x) of forward, lateral, yaw, height and frames, shape (n, 5) [mm]."""
    forward, lateral, yaw, height, frames = expected.T
    violation = (
        np.maximum(np.abs(lateral) / limits.lateral - 1.0, 0.0)
        + np.maximum(np.abs(yaw) / limits.yaw - 1.0, 0.0)
        + np.maximum(1.0 - height / limits.com_height, 0.0)
        + np.maximum(1.0 - frames / FRAMES, 0.0)
    )
    return -1000.0 * forward + 1000.0 * violation


def test_the_paper_s_proposal_minimises_the_penalised_prediction_in_the_box(study):
    settings = planned(study, mode=Mode.PAPER, samples=40, simulations=55)
    known = samples_at(design_of_experiments(settings), settings)
    procedure = PaperProcedure(settings, network=dataclasses.replace(PAPER_NETWORK, epochs=60))
    proposal = propose(procedure, 1, known, 1)
    assert proposal.x.shape == (1, 16)
    assert (np.abs(proposal.x) <= 1.0).all()

    def fitness(x):
        return penalised(proposal.network.predict(x).mean, settings.constraints)

    rng = np.random.default_rng(0)
    found = fitness(proposal.x)[0]
    assert found < fitness(rng.uniform(-1.0, 1.0, (50_000, 16))).min()
    nearby = np.clip(proposal.x + 0.02 * rng.standard_normal((20_000, 16)), -1.0, 1.0)
    assert found <= fitness(nearby).min() + 0.5  # Half a millimetre.


def test_the_paper_s_network_learns_from_falls_and_all(study):
    settings = planned(study, mode=Mode.PAPER, samples=40, simulations=55)
    x = design_of_experiments(settings)
    known = samples_at(x, settings)
    assert any(not one.walks[0].walk.survived for one in known)

    def other_fall(point):
        walk = walk_at(point)
        return walk if walk.survived else dataclasses.replace(walk, frames=20, forward=-0.2)

    changed = samples_at(x, settings, other_fall)
    one, other = (
        propose(quick_proposer(settings), 1, samples, 1).network.predict(x).mean
        for samples in (known, changed)
    )
    assert one.shape == (40, 5)
    assert (one != other).all()
    # The default's network learns from survivors only what a walk is worth.
    one, other = (
        propose(quick_proposer(study), 1, samples, 1).network.predict(x).mean
        for samples in (known, changed)
    )
    assert (one == other).all()


def test_the_paper_s_procedure_bears_walks_that_could_not_be_simulated(study):
    settings = planned(study, mode=Mode.PAPER, samples=40, simulations=55)
    x = design_of_experiments(settings)
    known = samples_at(x, settings, lambda x: Walk.diverged("made up") if x[0] > 0 else walk_at(x))
    assert np.isfinite(propose(quick_proposer(settings), 1, known, 1).x).all()


@pytest.mark.parametrize("mode", [Mode.ISADE, Mode.CMAES])
def test_an_optimiser_on_the_simulator_beats_as_many_samples(study, path, mode):
    settings = planned(study, mode=mode, samples=400, simulations=400)
    walks = run(settings, path)
    sampled = samples_at(design_of_experiments(settings), settings)
    most = min(one.assessment.fitness for one in sampled)
    assert min(settings.assess(walk.walk).fitness for walk in walks) < most - 2.0


@pytest.mark.parametrize("mode", Mode)
def test_a_proposer_that_starts_anew_proposes_what_the_one_before_would_have(study, mode):
    plan = {"mode": mode, "samples": 20, "simulations": 200, "batch": 5}
    settings = planned(study, **plan)
    one, known = quick_proposer(settings), []
    for iteration in range(4):
        count = one.batch if iteration else one.samples
        x = propose(one, iteration, known, count).x
        assert x.shape == (count, 16)
        anew = propose(quick_proposer(settings), iteration, known, count).x
        assert (anew == x).all()
        known = samples_at(
            np.vstack([*(settings.space.encode(s.candidate) for s in known), x]), settings
        )


def test_fewer_walks_at_the_end_of_a_budget_are_the_first_of_a_batch(study):
    for mode in (Mode.DEFAULT, Mode.ISADE, Mode.CMAES):
        settings = planned(study, mode=mode, samples=40, simulations=90, batch=5)
        first = quick_proposer(settings)
        known = samples_at(propose(first, 0, [], first.samples).x, settings)
        full = propose(quick_proposer(settings), 1, known, first.batch).x
        assert (propose(quick_proposer(settings), 1, known, 3).x == full[:3]).all()


def test_a_study_of_cost_learns_the_cost(study, measures):
    settings = planned(
        study, samples=40, simulations=55, batch=5, objective=Objective.COST_OF_TRANSPORT
    )
    settings = dataclasses.replace(settings, constraints=Constraints(clearance=0.005))
    names = (*OUTPUTS, "transport_efficiency", "clearance")
    assert settings.outputs == names

    def costly(x):
        cost = 2.0 + 0.5 * float(x[0])
        found = dataclasses.replace(measures, cost_of_transport=cost)
        return dataclasses.replace(walk_at(x), measures=found)

    known = samples_at(design_of_experiments(settings), settings, costly)
    _, outputs, _ = training_data([one.walks[0] for one in known], settings.space, names)
    assert outputs[:, 4] == pytest.approx(
        [
            1.0 / costly(settings.space.encode(one.candidate)).measures.cost_of_transport
            for one in known
        ]
    )
    assert (outputs[:, 5] == 0.009).all()
    proposal = propose(quick_proposer(settings), 1, known, 5)
    assert proposal.network.predict(proposal.x).mean.shape == (5, 6)
