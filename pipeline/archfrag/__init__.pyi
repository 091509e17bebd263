from .api.results import Results, open
from .api.studies import Study, fit
from .arch.model import Arch, Block, Bridge
from .fragility.curve import Curve
from .fragility.fit import fit_ida, fit_stripes
from .motions.formats.columns import Columns
from .motions.motion import Motion
from .motions.read import read_motion
from .simulation.joints import crushed, jointed
from .simulation.response import Response
from .simulation.rest import Onset, onset
from .simulation.simulate import limit_load, simulate, simulate_many
from .simulation.springings import move_springing, springing_path
from .study.reading import read_motions
from .version import __version__

__all__ = [
    "Arch",
    "Block",
    "Bridge",
    "Columns",
    "Curve",
    "Motion",
    "Onset",
    "Response",
    "Results",
    "Study",
    "__version__",
    "crushed",
    "fit",
    "fit_ida",
    "fit_stripes",
    "jointed",
    "limit_load",
    "move_springing",
    "onset",
    "open",
    "read_motion",
    "read_motions",
    "simulate",
    "simulate_many",
    "springing_path",
]
