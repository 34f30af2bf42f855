"""What proposes the next candidates of a search: networks, or an optimiser on the simulator itself.

Every random number has an address (seed, purpose, index), and a proposer keeps nothing that it
could not find again from the samples before: a search that goes on proposes the same.
"""

from collections.abc import Callable

from drake_gait.search.direct import DirectCmaes, DirectIsade, PaperProcedure
from drake_gait.search.proposal import Proposer
from drake_gait.search.trust_region import TrustRegion
from drake_gait.study.search_settings import Mode
from drake_gait.study.settings import StudySettings


def proposer(settings: StudySettings) -> Proposer:
    """The proposer of a study's mode."""
    modes: dict[Mode, Callable[[StudySettings], Proposer]] = {
        Mode.DEFAULT: TrustRegion,
        Mode.PAPER: PaperProcedure,
        Mode.ISADE: DirectIsade,
        Mode.CMAES: DirectCmaes,
    }
    return modes[settings.search.mode](settings)
