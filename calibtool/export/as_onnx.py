"""A calibration's network with its scalings as an ONNX model."""

from dataclasses import replace

import numpy as np

from calibtool.calibration import Calibration
from calibtool.equivalent.network import Network
from calibtool.errors import InputError, UsageError
from calibtool.export.closed_loop_network import Taught
from calibtool.export.layers import layers
from calibtool.export.rendering import Precision, check_words, left_out
from calibtool.robot.coupling import JointValues
from calibtool.robot.se3 import readonly

OPSET, IR_VERSION = 17, 8  # of 2022: what runtimes of controllers and edge devices read


def calibration_as_onnx(
    calibration: Calibration, precision: Precision = "double", joint_values: JointValues = "serial"
) -> bytes:
    """The network (Eq. 16) or Gaussian process as an ONNX model; of several networks, their mean.

    Input `q` (N, n) in rad or m, output `rho` (N, p) = N(q), both double or float; on the nominal
    base also `q_corrected` (N, n) = q − ρ_a (Eqs. 23, 24). joint_values: the kind of the joint
    values q and q_corrected; `rho` is always of the serial chain. Metadata: robot, base model,
    units, joint values. With closed loops the network is `Taught`: ρ is q minus the exactly
    corrected joints. Raises InputError when there is no network, UsageError when the package `onnx`
    is not installed.
    """
    check_words(joint_values, precision)
    robot, loops = calibration.robot, calibration.robot.chain.tree is not None
    if calibration.network is None and not loops:
        raise InputError(
            "the calibration has no network, and ONNX holds nothing else; export it "
            "as json, c or st"
        )
    try:
        import onnx
        from onnx import TensorProto, helper, numpy_helper
    except ImportError:
        raise UsageError(
            "ONNX needs the package onnx, which is not installed; run: pip install "
            "'calibtool[onnx]'"
        ) from None

    network = layers(_taught(calibration) if loops else calibration.network)
    assert network is not None
    kind, dtype = (
        (TensorProto.DOUBLE, np.float64)
        if precision == "double"
        else (TensorProto.FLOAT, np.float32)
    )
    constants = {
        "input_centre": network.input_centre,
        "input_scale": network.input_scale,
        "hidden_weights": network.hidden_weights.T,
        "hidden_bias": network.hidden_bias,
        "output_weights": network.output_weights.T,
        "output_bias": network.output_bias,
        "output_scale": network.output_scale,
    }
    activation = [("Tanh", ["sum"], "hidden")]
    if network.kernel:
        constants["half"] = np.full((robot.n, 1), 0.5)
        activation = [
            ("Mul", ["scaled", "scaled"], "squares"),
            ("MatMul", ["squares", "half"], "square"),
            ("Sub", ["sum", "square"], "exponent"),
            ("Exp", ["exponent"], "hidden"),
        ]
    steps = [
        ("Sub", ["q", "input_centre"], "centred"),
        ("Div", ["centred", "input_scale"], "scaled"),
        ("MatMul", ["scaled", "hidden_weights"], "weighted"),
        ("Add", ["weighted", "hidden_bias"], "sum"),
        *activation,
        ("MatMul", ["hidden", "output_weights"], "combined"),
        ("Add", ["combined", "output_bias"], "scaled_output"),
        ("Mul", ["scaled_output", "output_scale"], "rho"),
    ]
    n, outputs = robot.n, {"rho": len(network.output_scale)}
    moved = "rho_actuated"
    if joint_values == "controller" and robot.coupled:
        constants |= {"coupling": robot.coupling.T, "uncoupling": robot.to_controller(np.eye(n))}
        steps[0] = ("Sub", ["serial", "input_centre"], "centred")
        steps.insert(0, ("MatMul", ["q", "coupling"], "serial"))
        moved = "rho_controller"
    tensors = [
        numpy_helper.from_array(np.ascontiguousarray(value, dtype), name)
        for name, value in constants.items()
    ]
    if calibration.base.model == "nominal" or loops:
        ranges = {"first": 0, "last": n, "axis": 1}
        tensors += [
            numpy_helper.from_array(np.array([value], np.int64), name)
            for name, value in ranges.items()
        ]
        steps.append(("Slice", ["rho", *ranges], "rho_actuated"))
        if moved != "rho_actuated":
            steps.append(("MatMul", ["rho_actuated", "uncoupling"], moved))
        steps.append(("Sub", ["q", moved], "q_corrected"))
        outputs["q_corrected"] = n
    graph = helper.make_graph(
        [
            helper.make_node(operator, inputs, [output], name=output)
            for operator, inputs, output in steps
        ],
        "joint_motion_errors",
        [helper.make_tensor_value_info("q", kind, ["N", n])],
        [helper.make_tensor_value_info(name, kind, ["N", size]) for name, size in outputs.items()],
        tensors,
        doc_string=f"Joint motion errors rho = N(q) of a calibrated {robot.name}: {network.words}.",
    )
    model = helper.make_model(
        graph,
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="calibtool",
    )
    helper.set_model_props(
        model,
        {
            "robot": robot.name,
            "base_model": calibration.base.model,
            "joint_units": " ".join(robot.joint_units),
            "joint_values": joint_values,
            "virtual_joints": " ".join(calibration.equivalent.virtual_joints),
            **({"left_out": left_out(calibration)} if left_out(calibration) else {}),
        },
    )
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString(deterministic=True))


def _taught(calibration: Calibration) -> Network:
    """The network that is taught the exact corrections, its sign that of joint motion errors."""
    network = Taught.of(calibration).network
    return replace(network, output_scale=readonly(-network.output_scale))
