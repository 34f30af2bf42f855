"""What each procedure proposes next."""

import dataclasses
import itertools

import numpy as np
import pytest
from conftest import Ground, planned, run, walk_at

from drake_gait import proposers, surrogate
from drake_gait.gait import FRAMES
from drake_gait.plan import Mode
from drake_gait.problem import OUTPUTS, Constraints, Objective
from drake_gait.proposers import design_of_experiments, proposer, training_data
from drake_gait.ranking import sample
from drake_gait.records import StudyWalk
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


NOTHING = np.empty((0, 16))


def test_the_default_knows_nothing_of_the_iteration_that_is_still_under_way(quick, study, tmp_path):
    settings = planned(study, samples=20, simulations=40, batch=5)

    def candidates(name, iteration_2):
        """What a study walks whose walks 25 to 29 are `iteration_2`'s."""
        number = itertools.count()
        ground = Ground(
            study.space, lambda x: (iteration_2 if 25 <= next(number) < 30 else walk_at)(x)
        )
        return [walk.candidate for walk in run(settings, tmp_path / f"{name}.db", ground)]

    def splendid(x):
        return dataclasses.replace(walk_at(np.zeros(16)), forward=0.5)

    usual, changed = candidates("usual", walk_at), candidates("changed", splendid)
    assert changed[:35] == usual[:35]  # The last five were proposed while those walked.
    assert not set(changed[35:]) & set(usual[35:])


@pytest.mark.parametrize("mode", [Mode.PAPER, Mode.ISADE, Mode.CMAES])
def test_the_other_procedures_wait_for_all_walks(study, mode):
    assert not proposer(planned(study, mode=mode)).overlaps
    assert proposer(study).overlaps


def nearest(x):
    """Smallest distance between two of some design vectors, per variable."""
    distance = np.sqrt(((x[:, None] - x) ** 2).mean(axis=2))
    return distance[~np.eye(len(x), dtype=bool)].min()


def test_proposals_of_a_batch_keep_apart_from_each_other_and_from_what_is_under_way(
    quick, study, monkeypatch
):
    monkeypatch.setattr(proposers, "_ISADE_ITERATIONS", 60)
    known = samples_at(design_of_experiments(study), study)
    alone = [proposer(study).propose(1, known, NOTHING, 1).x for _ in range(2)]
    assert (alone[0] == alone[1]).all()
    batch = proposer(study).propose(1, known, NOTHING, 4).x
    assert (batch[0] == alone[0]).all()
    assert nearest(batch) > 0.1
    # What is under way at the place of the first proposal drives the next one off.
    moved = proposer(study).propose(1, known, batch[:1], 1).x
    assert nearest(np.vstack([batch[:1], moved])) > 0.1


def test_a_proposal_lies_in_the_trust_region_around_the_best_sample(quick, study):
    known = samples_at(design_of_experiments(study), study)
    best = min(known, key=lambda one: one.rank)
    x = proposer(study).propose(1, known, NOTHING, 5).x
    centre = study.space.encode(best.candidate)
    assert np.abs(x - centre).max() <= 0.6 + 1e-9
    assert np.abs(x - centre).max() > 0.3


def test_the_trust_region_grows_with_success_and_shrinks_without(quick, study):
    x = design_of_experiments(study)
    base = samples_at(x, study)
    best = study.space.encode(min(base, key=lambda one: one.rank).candidate)
    tried = best + 0.01 * np.random.default_rng(0).standard_normal((50, 16))

    def strays(distances):
        """How far a proposal is from the best walk after ten batches of such distances."""
        forward = iter(distances)

        def walk(point):
            return dataclasses.replace(walk_at(np.zeros(16)), forward=float(next(forward)))

        known = base + samples_at(tried, study, walk, first=40)
        centre = study.space.encode(min(known, key=lambda one: one.rank).candidate)
        return np.abs(proposer(study).propose(11, known, NOTHING, 5).x - centre).max()

    assert strays(np.zeros(50)) <= 0.6 * 0.9**10 + 1e-9
    assert strays(np.linspace(0.2, 0.4, 50)) > 0.6


def penalised(expected, limits):
    """The paper's F(x) of forward, lateral, yaw, height and steps, shape (n, 5) [mm]."""
    forward, lateral, yaw, height, steps = expected.T
    violation = (
        np.maximum(np.abs(lateral) / limits.lateral - 1.0, 0.0)
        + np.maximum(np.abs(yaw) / limits.yaw - 1.0, 0.0)
        + np.maximum(1.0 - height / limits.com_height, 0.0)
        + np.maximum(1.0 - steps / FRAMES, 0.0)
    )
    return -1000.0 * forward + 1000.0 * violation


def test_the_paper_s_proposal_minimises_the_penalised_prediction_in_the_box(study, monkeypatch):
    monkeypatch.setattr(surrogate, "_PAPER_EPOCHS", 60)
    settings = planned(study, mode=Mode.PAPER, samples=40, simulations=55)
    known = samples_at(design_of_experiments(settings), settings)
    proposal = proposer(settings).propose(1, known, NOTHING, 1)
    assert proposal.x.shape == (1, 16)
    assert (np.abs(proposal.x) <= 1.0).all()

    def fitness(x):
        return penalised(proposal.network.predict(x).mean, settings.constraints)

    rng = np.random.default_rng(0)
    found = fitness(proposal.x)[0]
    assert found < fitness(rng.uniform(-1.0, 1.0, (50_000, 16))).min()
    nearby = np.clip(proposal.x + 0.02 * rng.standard_normal((20_000, 16)), -1.0, 1.0)
    assert found <= fitness(nearby).min() + 0.5  # Half a millimetre.


def test_the_paper_s_network_learns_from_falls_and_all(quick, study):
    settings = planned(study, mode=Mode.PAPER, samples=40, simulations=55)
    x = design_of_experiments(settings)
    known = samples_at(x, settings)
    assert any(not one.walks[0].walk.survived for one in known)

    def other_fall(point):
        walk = walk_at(point)
        return walk if walk.survived else dataclasses.replace(walk, steps=20, forward=-0.2)

    changed = samples_at(x, settings, other_fall)
    one, other = (
        proposer(settings).propose(1, samples, NOTHING, 1).network.predict(x).mean
        for samples in (known, changed)
    )
    assert one.shape == (40, 5)
    assert (one != other).all()
    # The default's network learns from survivors only what a walk is worth.
    one, other = (
        proposer(study).propose(1, samples, NOTHING, 1).network.predict(x).mean
        for samples in (known, changed)
    )
    assert (one == other).all()


def test_the_paper_s_procedure_bears_walks_that_could_not_be_simulated(quick, study):
    settings = planned(study, mode=Mode.PAPER, samples=40, simulations=55)
    x = design_of_experiments(settings)
    known = samples_at(x, settings, lambda x: Walk.diverged("made up") if x[0] > 0 else walk_at(x))
    assert np.isfinite(proposer(settings).propose(1, known, NOTHING, 1).x).all()


@pytest.mark.parametrize("mode", [Mode.ISADE, Mode.CMAES])
def test_an_optimiser_on_the_simulator_beats_as_many_samples(study, path, mode):
    settings = planned(study, mode=mode, samples=400, simulations=400)
    walks = run(settings, path)
    sampled = samples_at(design_of_experiments(settings), settings)
    most = min(one.assessment.fitness for one in sampled)
    assert min(settings.assess(walk.walk).fitness for walk in walks) < most - 2.0


@pytest.mark.parametrize("mode", Mode)
def test_a_proposer_that_starts_anew_proposes_what_the_one_before_would_have(quick, study, mode):
    plan = {"mode": mode, "samples": 20, "simulations": 200, "batch": 5}
    settings = planned(study, **plan)
    one, known = proposer(settings), []
    for iteration in range(4):
        count = one.batch if iteration else one.samples
        x = one.propose(iteration, known, NOTHING, count).x
        assert x.shape == (count, 16)
        anew = proposer(settings).propose(iteration, known, NOTHING, count).x
        assert (anew == x).all()
        known = samples_at(
            np.vstack([*(settings.space.encode(s.candidate) for s in known), x]), settings
        )


def test_fewer_walks_at_the_end_of_a_budget_are_the_first_of_a_batch(quick, study):
    for mode in (Mode.DEFAULT, Mode.ISADE, Mode.CMAES):
        settings = planned(study, mode=mode, samples=40, simulations=90, batch=5)
        first = proposer(settings)
        known = samples_at(first.propose(0, [], NOTHING, first.samples).x, settings)
        full = proposer(settings).propose(1, known, NOTHING, first.batch).x
        assert (proposer(settings).propose(1, known, NOTHING, 3).x == full[:3]).all()


def test_a_study_of_cost_learns_the_cost(quick, study, measures):
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
    proposal = proposer(settings).propose(1, known, NOTHING, 5)
    assert proposal.network.predict(proposal.x).mean.shape == (5, 6)
