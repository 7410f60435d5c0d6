"""The families of errors that a robot can have, in the order of their parameters.

Placements change by growth first, then by the turns of all families together, then by placement
errors, the first of all.
"""

from calibtool.errormodel.backlash import Backlash
from calibtool.errormodel.bending import Bending
from calibtool.errormodel.family import Family
from calibtool.errormodel.gravity import Gravity
from calibtool.errormodel.harmonics import Harmonics
from calibtool.errormodel.offsets import Offsets
from calibtool.errormodel.pairs import Pairs
from calibtool.errormodel.payload import Payload
from calibtool.errormodel.placements import Placements
from calibtool.errormodel.temperature import Temperature
from calibtool.errormodel.twists import Twists
from calibtool.errormodel.wobble import Wobble

FAMILIES: tuple[Family, ...] = (
    Placements(),
    Twists(),
    Offsets(),
    Harmonics(),
    Gravity(),
    Backlash(),
    Payload(),
    Temperature(),
    Bending(),
    Wobble(),
    Pairs(),
)
BY_ID = {family.id: family for family in FAMILIES}
ERROR_KINDS = tuple(dict.fromkeys(family.kind for family in FAMILIES))  # of simulated errors
