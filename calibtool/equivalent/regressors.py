"""Learned models that can be trained, the first by default. A new one is one more line here."""

from calibtool.equivalent.network import Network
from calibtool.equivalent.random_features import RandomFeatures
from calibtool.equivalent.regressor import Regressor

REGRESSORS: dict[str, type[Regressor]] = {kind.id: kind for kind in (Network, RandomFeatures)}
