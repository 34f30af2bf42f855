"""The procedure, on walks that are computed instead of simulated."""

import dataclasses

import numpy as np
import pytest

from drake_gait import proposers, surrogate
from drake_gait.plan import SearchSettings
from drake_gait.problem import OUTPUTS, Constraints, assess
from drake_gait.proposers import design_of_experiments, training_data
from drake_gait.ranking import best_walk, feasible_walks
from drake_gait.records import StudyWalk
from drake_gait.search import search
from drake_gait.store import Study
from drake_gait.walk import Outcome, Walk
from drake_gait.workers import Finished

TARGET = np.array([0.8, -0.5, 0.3, 0.4, -0.6, 0.7, -0.2, 0.1])


def walk_at(x):
    """A walk that depends smoothly on the design vector, with a region where the robot falls."""
    if x[3] + x[4] > 1.2:
        return Walk(
            outcome=Outcome.FELL, steps=120, forward=0.05, lateral=0.03, yaw=0.5, com_height=0.1
        )
    return Walk(
        outcome=Outcome.WALKED,
        steps=240,
        forward=float(0.15 - 0.01 * ((x[:8] - TARGET) ** 2).sum()),
        lateral=float(0.03 * x[8] + 0.01 * x[9] * x[10]),
        yaw=float(0.15 * np.sin(x[11])),
        com_height=float(0.2445 + 0.002 * x[12]),
    )


def fall_at(x):
    return Walk(
        outcome=Outcome.FELL,
        steps=int(100 + 20 * x[0]),
        forward=0.0,
        lateral=0.0,
        yaw=0.0,
        com_height=0.1,
    )


class Interruption(BaseException):
    """What stops a driver in the midst of its work."""


class Ground:
    """Computes walks, and remembers how many it was asked for."""

    def __init__(self, space, walk=walk_at, *, shuffle=None, stop_after=None):
        self.space, self.walk = space, walk
        self.rng = None if shuffle is None else np.random.default_rng(shuffle)
        self.stop_after = stop_after
        self.asked = []

    def __call__(self, trials):
        order = np.arange(len(trials))
        if self.rng is not None:
            order = self.rng.permutation(order)
        for index in order.tolist():
            if len(self.asked) == self.stop_after:
                raise Interruption
            x = self.space.encode(trials[index].candidate)
            self.asked.append(x)
            yield Finished(index=index, walk=self.walk(x), seconds=0.0)


@pytest.fixture
def quick(monkeypatch):
    """Smaller networks and shorter runs of ISADE: the laws here hold for any."""
    monkeypatch.setattr(surrogate, "_EPOCHS", 20)
    monkeypatch.setattr(proposers, "_ISADE_ITERATIONS", 8)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "study.db"


def planned(settings, **plan):
    return dataclasses.replace(settings, search=SearchSettings(**plan))


def run(settings, path, ground=None, report=lambda progress: None):
    """Start or go on with a study; its walks."""
    ground = ground or Ground(settings.space)
    opened = Study.open(path, driver=True) if path.exists() else Study.create(path, {})
    with opened as study:
        search(settings, study, ground, report)
        return study.walks()


def numbers(walks):
    """All that a study says of its walks."""
    return [
        (
            walk.id,
            walk.stage,
            walk.iteration,
            walk.candidate.gait.coefficients.tobytes(),
            dataclasses.astuple(walk.candidate.foot),
            dataclasses.astuple(walk.walk),
            walk.predicted,
        )
        for walk in walks
    ]


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


@pytest.mark.parametrize(("samples", "simulations", "batch"), [(40, 55, 5), (40, 53, 4), (7, 7, 5)])
def test_a_study_uses_exactly_its_budget_and_stores_every_walk_once(
    quick, study, path, samples, simulations, batch
):
    settings = planned(study, samples=samples, simulations=simulations, batch=batch)
    ground = Ground(settings.space)
    walks = run(settings, path, ground)
    assert len(ground.asked) == simulations
    assert [walk.id for walk in walks] == list(range(simulations))
    assert len({walk.candidate for walk in walks}) == simulations
    for walk in walks:
        expected = walk_at(settings.space.encode(walk.candidate))
        assert dataclasses.astuple(walk.walk) == dataclasses.astuple(expected)
    design = [walk for walk in walks if walk.stage == "design"]
    assert len(design) == samples
    assert all(walk.iteration == 0 and walk.predicted is None for walk in design)
    assert all(walk.stage == "infill" and walk.predicted for walk in walks[samples:])


def test_an_infill_walk_tells_which_network_proposed_it_and_what_was_expected(quick, study, path):
    walks = run(study, path)
    assert [walk.iteration for walk in walks[40:]] == [1] * 5 + [2] * 5 + [3] * 5
    for walk in walks[40:]:
        assert set(walk.predicted) == {"forward", "lateral", "yaw", "survival"}
        assert 0.0 <= walk.predicted["survival"] <= 1.0


def test_walks_that_finish_in_another_order_give_the_same_study(quick, study, tmp_path):
    expected = numbers(run(study, tmp_path / "ordered.db"))
    for seed in (1, 2):
        ground = Ground(study.space, shuffle=seed)
        assert numbers(run(study, tmp_path / f"{seed}.db", ground)) == expected


@pytest.mark.parametrize("walks", [0, 1, 39, 40, 43, 45, 54])
def test_an_interrupted_study_that_goes_on_is_the_same_walk_for_walk(quick, study, tmp_path, walks):
    expected = numbers(run(study, tmp_path / "whole.db"))
    path = tmp_path / "parted.db"
    first = Ground(study.space, shuffle=walks, stop_after=walks)
    with pytest.raises(Interruption):
        run(study, path, first)
    with Study.open(path) as kept:
        assert len(kept.walks()) == walks
    second = Ground(study.space)
    assert numbers(run(study, path, second)) == expected
    assert len(second.asked) == 55 - walks


def test_a_finished_study_simulates_nothing_more(quick, study, path):
    expected = numbers(run(study, path))
    again = Ground(study.space)
    assert numbers(run(study, path, again)) == expected
    assert again.asked == []


@pytest.mark.parametrize("first", [41, 47, 50])
def test_a_study_whose_budget_grew_is_the_one_that_had_it_from_the_start(
    quick, study, tmp_path, first
):
    plan = {"samples": 40, "batch": 5}
    run(planned(study, simulations=first, **plan), tmp_path / "grown.db")
    ground = Ground(study.space)
    grown = run(planned(study, simulations=53, **plan), tmp_path / "grown.db", ground)
    whole = run(planned(study, simulations=53, **plan), tmp_path / "whole.db")
    assert len(ground.asked) == 53 - first
    # The last digits of a prediction depend on how many are made together.
    assert [row[:-1] for row in numbers(grown)] == [row[:-1] for row in numbers(whole)]
    for one, other in zip(grown[40:], whole[40:], strict=True):
        assert one.predicted == pytest.approx(other.predicted, rel=1e-9)


def test_another_seed_gives_another_study(quick, study, tmp_path):
    one = run(study, tmp_path / "0.db")
    other = run(dataclasses.replace(study, seed=1), tmp_path / "1.db")
    assert not {walk.candidate for walk in one} & {walk.candidate for walk in other}


def test_trials_stay_within_the_limits(quick, study, path):
    # A box at the edge of Table I, and feet: walking improves towards and beyond the edge.
    centre = np.array(study.space.centre)
    centre[0] = np.radians([14.0, -14.0, 14.0, 14.0])
    space = dataclasses.replace(
        study.space, centre=centre, foot_ranges=(("big_toe_width", 0.010, 0.040),)
    )

    def outward(x):
        walk = walk_at(np.zeros(16))
        forward = 0.1 + 0.02 * (x[0] - x[1] + x[2] + x[3]) + 0.02 * x[16]
        return dataclasses.replace(walk, forward=float(forward))

    settings = dataclasses.replace(study, space=space)
    walks = run(settings, path, Ground(space, outward))
    x = np.array([space.encode(walk.candidate) for walk in walks])
    assert (x >= space.limits[:, 0] - 1e-9).all()
    assert (x <= space.limits[:, 1] + 1e-9).all()
    # The law is tested at the edge only if some trial went there.
    assert (np.abs(x[40:, 16]) > 0.9).any()


def test_every_number_reported_is_that_of_a_simulated_walk(quick, study, path):
    reports = []
    ground = Ground(study.space)
    walks = run(study, path, ground, reports.append)
    last = reports[-1]
    assert (last.walks, last.total) == (55, 55)
    assert last.survivors == sum(walk.walk.survived for walk in walks)
    assert last.feasible == len(feasible_walks(walks, study.constraints))
    assert last.best.walk.forward == best_walk(walks, study.constraints).walk.forward
    assert any((study.space.encode(last.best.candidate) == x).all() for x in ground.asked)
    assert [one.walks for one in reports] == sorted(one.walks for one in reports)
    assert {one.walks for one in reports} == set(range(1, 56))


@pytest.mark.slow
def test_the_search_beats_as_many_samples_on_most_seeds(study, tmp_path):
    better = 0
    for seed in range(4):
        settings = dataclasses.replace(study, seed=seed)
        found = best_walk(run(settings, tmp_path / f"{seed}.db"), study.constraints)
        sampling = planned(settings, samples=55, simulations=55)
        sampled = best_walk(run(sampling, tmp_path / f"{seed}-sampled.db"), study.constraints)
        assert assess(found.walk, study.constraints).feasible
        better += found.walk.forward > sampled.walk.forward + 0.005
    assert better >= 3


def test_stagnation_ends_a_study_before_its_budget(quick, study, path):
    def plateau(x):
        return dataclasses.replace(walk_at(np.zeros(16)), forward=0.1)

    settings = planned(study, samples=40, simulations=100, batch=5, stagnation=2)
    ground = Ground(settings.space, plateau)
    assert len(run(settings, path, ground)) == 50
    # The same command again does not go on with what has ended.
    again = Ground(settings.space, plateau)
    assert len(run(settings, path, again)) == 50
    assert again.asked == []


def test_a_study_that_improves_does_not_stagnate(quick, study, path):
    # Each walk goes further than the one before.
    count = iter(range(1000))

    def further(x):
        return dataclasses.replace(walk_at(np.zeros(16)), forward=0.1 + 1e-3 * next(count))

    settings = planned(study, samples=40, simulations=60, batch=5, stagnation=1)
    assert len(run(settings, path, Ground(settings.space, further))) == 60


def test_where_nothing_survives_the_study_goes_on_sampling(quick, study, path):
    ground = Ground(study.space, fall_at)
    walks = run(study, path, ground)
    assert len(walks) == 55
    assert {walk.stage for walk in walks} == {"design"}
    assert [walk.iteration for walk in walks[40:]] == [1] * 5 + [2] * 5 + [3] * 5
    assert len({walk.candidate for walk in walks}) == 55
    assert (np.abs(np.array(ground.asked)) <= 1.0 + 1e-9).all()


def test_sampling_on_ends_with_enough_survivors_for_a_network(quick, study, tmp_path):
    def rarely(x):
        return walk_at(x) if x[0] > 0.1 else fall_at(x)

    settings = planned(study, samples=20, simulations=60, batch=10)
    walks = run(settings, tmp_path / "whole.db", Ground(settings.space, rarely))
    stages = [walk.stage for walk in walks]
    first = stages.index("infill")
    assert first > 20
    # It is made while the ten walks before it are under way, and knows those before them.
    survived = np.cumsum([walk.walk.survived for walk in walks])
    assert survived[first - 11] >= surrogate.FEWEST_SURVIVORS
    assert survived[first - 21] < surrogate.FEWEST_SURVIVORS
    # Interrupted while it samples on, it is the same study.
    path = tmp_path / "parted.db"
    with pytest.raises(Interruption):
        run(settings, path, Ground(settings.space, rarely, stop_after=23, shuffle=1))
    assert numbers(run(settings, path, Ground(settings.space, rarely))) == numbers(walks)


def test_a_study_of_diverged_walks_ends_without_a_crash(quick, study, path):
    walks = run(study, path, Ground(study.space, lambda x: Walk.diverged("made up")))
    assert len(walks) == 55
    assert best_walk(walks, study.constraints).id == 0


def kept(entry, number, **changes):
    return dataclasses.replace(entry, id=number, walk=dataclasses.replace(entry.walk, **changes))


def test_the_best_walk_is_the_furthest_that_is_feasible(entry):
    walks = [
        kept(entry, 0, forward=0.10),
        kept(entry, 1, forward=0.15),
        kept(entry, 2, forward=0.20, lateral=0.03),
        kept(entry, 3, forward=0.15),
    ]
    assert best_walk(walks, Constraints()).id == 1
    assert [walk.id for walk in feasible_walks(walks, Constraints())] == [1, 3, 0]


def test_without_a_feasible_walk_the_best_is_the_one_that_violates_least(entry):
    walks = [
        kept(entry, 0, lateral=0.10, forward=0.2),
        kept(entry, 1, lateral=0.03, forward=0.1),
        kept(entry, 2, yaw=1.0),
    ]
    assert best_walk(walks, Constraints()).id == 1


def test_a_robot_on_its_feet_is_nearer_to_a_feasible_walk_than_one_that_fell_or_was_lost(entry):
    crooked = kept(entry, 0, yaw=np.radians(40.0), lateral=0.1)
    fallen = kept(entry, 1, outcome=Outcome.FELL, steps=230, lateral=0.1, com_height=0.05)
    lost = dataclasses.replace(entry, id=2, walk=Walk.diverged("its process died"))
    assert best_walk([lost, fallen, crooked], Constraints()).id == 0
    assert best_walk([lost, fallen], Constraints()).id == 1
    assert best_walk([lost], Constraints()).id == 2


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
