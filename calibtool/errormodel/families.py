"""The families of errors that a robot can have, in the order of their parameters.

A new one is one more line here. A family nearer to the end changes placements nearer to the base:
growth, then bending, then placement errors.
"""

from calibtool.errormodel.backlash import Backlash
from calibtool.errormodel.family import Family
from calibtool.errormodel.gravity import Gravity
from calibtool.errormodel.harmonics import Harmonics
from calibtool.errormodel.offsets import Offsets
from calibtool.errormodel.payload import Payload
from calibtool.errormodel.placements import Placements
from calibtool.errormodel.temperature import Temperature
from calibtool.errormodel.twists import Twists

FAMILIES: tuple[Family, ...] = (
    Placements(),
    Twists(),
    Offsets(),
    Harmonics(),
    Gravity(),
    Backlash(),
    Payload(),
    Temperature(),
)
BY_ID = {family.id: family for family in FAMILIES}
ERROR_KINDS = tuple(dict.fromkeys(family.kind for family in FAMILIES))  # of simulated errors
