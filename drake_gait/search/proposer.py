"""Proposers, proposals, and the data that surrogates learn from."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from drake_gait.errors import SettingsError
from drake_gait.gait import FloatArray
from drake_gait.problem import DesignSpace, quantity
from drake_gait.search.seeding import Purpose, generator
from drake_gait.study.ranking import Sample
from drake_gait.study.records import StudyWalk
from drake_gait.study.settings import StudySettings

if TYPE_CHECKING:  # It loads torch, which a proposer need not know.
    from drake_gait.surrogates.prediction import Network


@dataclass(frozen=True, kw_only=True)
class IsadeSettings:
    """When ISADE stops on a network (paper, IV.B)."""

    iterations: int = 1000
    """Generations at most."""
    stagnation: int = 50
    """Stop after so many generations without a better point."""

    def __post_init__(self) -> None:
        for name in ("iterations", "stagnation"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise SettingsError(f"isade {name} must be a whole number >= 1, got {value!r}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """Candidates to simulate."""

    x: FloatArray
    """Design vectors, shape (n, d)."""
    stage: str
    """What they are for: "design" or "infill"."""
    network: "Network | None" = None
    """What expects something of them."""


class Proposer(Protocol):
    """One way to search.

    A study searches with any object that has these, see docs/howto/own_proposer.md. A study that
    goes on makes the proposer anew: it is to propose the same from the same samples, whenever it is
    asked. So its random numbers come from a seed and the iteration.
    """

    @property
    def name(self) -> str:
        """Its name with its settings: a proposer of another name does not resume a study."""
        ...

    @property
    def samples(self) -> int:
        """Candidates of the first iteration."""
        ...

    @property
    def batch(self) -> int:
        """Candidates of every other iteration."""
        ...

    def vintage(self, iteration: int) -> int:
        """Return the iteration whose network an iteration uses, at most its own.

        A smaller one learns while later walks are still being simulated, without those.
        """
        ...

    def learn(self, iteration: int, known: Sequence[Sample]) -> "Network | None":
        """Learn for an iteration from the walks so far; None where nothing is learnt.

        Args:
            iteration: Its number, from 0.
            known: The samples to learn from, in the order in which they were proposed.
        """
        ...

    def propose(
        self, iteration: int, known: Sequence[Sample], network: "Network | None", count: int
    ) -> Proposal:
        """Return the candidates of an iteration.

        Args:
            iteration: Its number, from 0.
            known: The samples of all iterations before it, in the order of their proposal.
            network: What was learnt for it.
            count: Candidates to propose; fewer than a batch at the end of the budget.
        """
        ...


def design_of_experiments(settings: StudySettings) -> FloatArray:
    """A Latin hypercube in the box: design vectors, shape (samples, d)."""
    return latin_hypercube(settings, settings.search.samples)


def latin_hypercube(settings: StudySettings, count: int, *index: int) -> FloatArray:
    """Return points of the box, shape (count, d); the index fixes their random numbers."""
    from scipy.stats import qmc  # It takes half a second to load.

    rng = generator(settings.seed, Purpose.DESIGN, *index)
    unit = qmc.LatinHypercube(settings.space.dimension, rng=rng).random(count)
    lower, upper = settings.space.box.T
    samples: FloatArray = lower + (upper - lower) * unit
    return samples


def training_data(
    walks: Sequence[StudyWalk], space: DesignSpace, names: Sequence[str]
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Design vectors (n, d), the named quantities (n, k), and who survived (n,)."""
    x = np.array([space.encode(walk.candidate) for walk in walks])
    outputs = np.array([[quantity(walk.walk, name) for name in names] for walk in walks])
    survived = np.array([walk.walk.survived for walk in walks], dtype=bool)
    size = len(walks)
    return x.reshape(size, space.dimension), outputs.reshape(size, len(names)), survived


def all_walks(samples: Sequence[Sample]) -> list[StudyWalk]:
    """The walks of all samples, replicas too."""
    return [walk for sample in samples for walk in sample.walks]
