"""The proposer of each mode that a study can ask for."""

from collections.abc import Callable

from drake_gait.search.direct import DirectCmaes, DirectIsade
from drake_gait.search.isade_network import NetworkIsade
from drake_gait.search.paper import PaperProcedure
from drake_gait.search.proposer import Proposer
from drake_gait.search.trust_region import TrustRegion
from drake_gait.study.search_settings import Mode
from drake_gait.study.settings import StudySettings


def proposer(settings: StudySettings) -> Proposer:
    """Return the proposer of a study's mode, as it is without settings of its own."""
    modes: dict[Mode, Callable[[StudySettings], Proposer]] = {
        Mode.DEFAULT: TrustRegion,
        Mode.ISADE_NETWORK: NetworkIsade,
        Mode.PAPER: PaperProcedure,
        Mode.ISADE: DirectIsade,
        Mode.CMAES: DirectCmaes,
    }
    return modes[settings.search.mode](settings)
