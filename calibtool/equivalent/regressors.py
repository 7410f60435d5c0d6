"""The learned models that can be trained; the first is the default."""

from calibtool.equivalent.network import Network
from calibtool.equivalent.random_features import RandomFeatures
from calibtool.equivalent.regressor import Regressor

REGRESSORS: dict[str, type[Regressor]] = {kind.id: kind for kind in (Network, RandomFeatures)}
