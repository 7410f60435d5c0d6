"""The learned models that can be stored and chosen."""

from calibtool.equivalent.gaussian_process import GaussianProcess
from calibtool.equivalent.network import Network
from calibtool.equivalent.regressor import Regressor

REGRESSORS: dict[str, type[Regressor]] = {kind.id: kind for kind in (Network, GaussianProcess)}
