"""Whether there are enough measurements for the model: refusal where not, or a warning."""

from calibtool.errors import NoSolutionError
from calibtool.identification.identification import Identification
from calibtool.measurement.measurements import Measurements

_RIGID = 6  # things that a configuration shows of a rigid tool


def check_rows(measurements: Measurements) -> None:
    """NoSolutionError for fewer equations than the set-up and one zero per joint have unknowns."""
    setup, robot = measurements.setup, measurements.robot
    unknowns = 6 * (not setup.frame_known) + robot.n
    unknowns += len(setup.free_names)
    shown = _shown(measurements.coordinates)
    if len(measurements) * shown < unknowns:
        needed = -(-unknowns // shown)
        raise NoSolutionError(
            f"{len(measurements)} configurations give {len(measurements) * shown} equations for "
            f"{unknowns} unknowns of the "
            f"set-up and of one zero per joint; measure at least {needed}, and {_useful(robot.n)} "
            "for a useful result"
        )


def few_rows(identification: Identification, configurations: int) -> str | None:
    """A warning for fewer equations than there are directions to determine, otherwise None."""
    if identification.posterior is None:
        return None
    shown = _shown(identification.setup.kind.coordinates(identification.setup))
    directions = identification.observable_rank
    if configurations * shown >= directions:
        return None
    return (
        f"{configurations} configurations give {configurations * shown} equations for {directions} "
        "directions of the errors: most of the result is the tolerances, and a correction may miss "
        "by "
        f"as much as the arm does now; measure at least {-(-directions // shown)}, and twice as "
        "many "
        "for a useful result"
    )


def _shown(coordinates: int) -> int:
    return min(coordinates, _RIGID)


def _useful(n: int) -> int:
    return 5 * n
