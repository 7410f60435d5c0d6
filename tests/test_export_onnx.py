"""The ONNX model is the network, and on the nominal base the whole correction."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from exported import anywhere, calibrated

from calibtool.calibration import Calibration
from calibtool.compensation.solve import one_step
from calibtool.equivalent.network import Network
from calibtool.errors import InputError, UsageError
from calibtool.export.as_onnx import calibration_as_onnx
from calibtool.robot.se3 import Array


def outputs(model: bytes, q: Array) -> dict[str, Array]:
    """Run a model by onnxruntime, or by the reference implementation of onnx."""
    try:
        import onnxruntime
    except ImportError:
        from onnx.reference import ReferenceEvaluator

        session = ReferenceEvaluator(model)
        names = session.output_names
    else:
        session = onnxruntime.InferenceSession(model)
        names = [output.name for output in session.get_outputs()]
    return dict(zip(names, session.run(None, {"q": q}), strict=True))


def ensemble(name: str, base: str) -> Calibration:
    calibration = calibrated(name, base, True)
    rng = np.random.default_rng(4)
    scale = np.full(calibration.equivalent.p, 1e-3)
    return replace(
        calibration, networks=tuple(Network.initial(calibration.q, scale, 5, rng) for _ in range(3))
    )


def motions(calibration: Calibration, q: Array) -> Array:
    """The mean motion errors of the actuated joints (N, n) by the networks themselves."""
    mean: Array = np.mean([network(q) for network in calibration.networks], axis=0)
    return mean[:, : calibration.robot.n]


@pytest.mark.parametrize(
    ("precision", "dtype", "accuracy"), [("double", float, 1e-14), ("single", np.float32, 1e-7)]
)
def test_the_model_is_the_mean_of_the_networks(
    precision: str, dtype: type, accuracy: float
) -> None:
    pytest.importorskip("onnx", reason="onnx is not installed")
    calibration = ensemble("scara", "local-poe")
    q = anywhere(calibration, 10_000).astype(dtype)
    found = outputs(calibration_as_onnx(calibration, precision), q)
    expected = np.mean([network(q.astype(float)) for network in calibration.networks], axis=0)
    assert set(found) == {"rho"}
    assert found["rho"].dtype == dtype
    assert np.abs(found["rho"] - expected).max() < accuracy


@pytest.mark.parametrize(("precision", "accuracy"), [("double", 1e-14), ("single", 1e-6)])
def test_the_model_is_the_gaussian_process(precision: str, accuracy: float) -> None:
    pytest.importorskip("onnx", reason="onnx is not installed")
    calibration = calibrated("scara", "process", True)
    dtype = float if precision == "double" else np.float32
    q = anywhere(calibration, 1000).astype(dtype)
    found = outputs(calibration_as_onnx(calibration, precision), q)["rho"]
    expected = calibration.networks[0](q.astype(float))
    assert np.abs(found - expected).max() < accuracy * max(1.0, np.abs(expected).max())
    assert np.abs(expected).max() > 1e-4


def test_on_the_nominal_base_the_model_corrects_as_one_step_does() -> None:
    pytest.importorskip("onnx", reason="onnx is not installed")
    calibration = ensemble("panda", "nominal")
    q = anywhere(calibration, 10_000)
    model = calibration_as_onnx(calibration)
    found = outputs(model, q)["q_corrected"]
    assert np.abs(found - (q - motions(calibration, q))).max() < 1e-14
    judged = np.abs(found - one_step(calibration, q).q).max(axis=1)  # has bounds, too
    assert (judged < 1e-14).mean() > 0.99
    assert model == calibration_as_onnx(calibration)


def test_a_controller_s_joint_values_are_converted_in_the_model() -> None:
    pytest.importorskip("onnx", reason="onnx is not installed")
    calibration = ensemble("fanuc-m1000ia", "nominal")
    q = anywhere(calibration, 100)
    expected, shown = q - motions(calibration, q), q.copy()
    for values in (expected, shown):
        values[:, 2] -= values[:, 1]  # J3 = q3 − J2
    found = outputs(calibration_as_onnx(calibration, joint_values="controller"), shown)
    assert np.abs(found["q_corrected"] - expected).max() < 1e-14
    assert np.abs(found["rho"] - outputs(calibration_as_onnx(calibration), q)["rho"]).max() < 1e-14


def test_without_a_network_there_is_nothing_to_export() -> None:
    with pytest.raises(InputError, match="no network"):
        calibration_as_onnx(calibrated("fanuc-m1000ia", "local-poe", False))


def test_without_the_package_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(UsageError, match=r"pip install 'calibtool\[onnx\]'"):
        calibration_as_onnx(calibrated("fanuc-m1000ia", "nominal", True))
