"""Time to train the paper's network beside scikit-learn and PyTorch.

Run: python benchmarks/peers/training.py [--seeds 5] [--python PACKAGE=PYTHON]. The paper's
experiment (benchmarks/paper.py): fanuc-m1000ia in its 1 m cube, network on the nominal robot, 6-6-6
tanh, 50 + 50 configurations,
joint motions δρ̂ as the target (joint loss, Eq. 21). All train on the same scaled inputs and
targets in float64 on one thread, five restarts per seed, and are judged by the same validation
loss; calibtool and PyTorch start from the same weights and make the same steps. L-BFGS cannot be
watched while it runs: its time is that of a fit that knows beforehand when to stop. Every tool runs
in a process of its own.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from process import Interpreters, PeerError, add_interpreters, interpreters, output, require

HIDDEN, RESTARTS = 6, 5
ITERATIONS, EPOCHS = 200, 5000  # at most: Levenberg–Marquardt or L-BFGS; Adam
Curve = list[tuple[float, float]]  # (CPU seconds since the start, validation loss)


def write_data(file: Path, seed: int) -> None:
    """Inputs s in [−1, 1], targets δρ̂ over their RMS, both halves; start
    weights of every restart.
    """
    from calibtool.calibration import identify
    from calibtool.equivalent.loss import joint_loss
    from calibtool.equivalent.network import Network
    from calibtool.equivalent.training import split_rows
    from calibtool.measurement.observation import observation_matrix, residuals, weights
    from calibtool.measurement.simulate import Simulation, simulate
    from calibtool.robot.catalogue import load_robot

    robot = load_robot("fanuc-m1000ia")
    measurements = simulate(robot, Simulation(seed=seed))
    pose, jacobian = identify(measurements, "nominal").base_forward_and_jacobian(measurements.q)
    weight = weights(measurements)
    G = observation_matrix(measurements.setup, pose) @ jacobian * weight[..., None]
    loss = joint_loss(measurements.q, G, residuals(measurements, measurements.setup, pose) * weight)
    rng = np.random.default_rng(seed)
    train, held = split_rows(len(measurements), 0.5, rng)
    t = loss.t / np.sqrt(np.mean(loss.t[train] ** 2))
    starts = [
        Network.initial(measurements.q[train], np.ones(6), HIDDEN, r) for r in rng.spawn(RESTARTS)
    ]
    s = starts[0].scaled_input(measurements.q)
    weights_0 = [start.weights for start in starts]
    np.savez(file, s=s[train], t=t[train], s_held=s[held], t_held=t[held], starts=weights_0)


def held_loss(data: dict, predicted: np.ndarray) -> float:
    """Mean square on the validation half; the targets' own is about 1."""
    return float(((data["t_held"] - predicted) ** 2).mean())


def calibtool_lm(data: dict, restart: int) -> Iterator[float]:
    """calibtool's own Levenberg–Marquardt."""
    from calibtool.equivalent.loss import Loss
    from calibtool.equivalent.network import Network
    from calibtool.equivalent.optimisers import levenberg_marquardt

    eye = np.broadcast_to(np.eye(6), (len(data["s"]), 6, 6))
    start = Network.initial(
        np.array([[-1.0] * 6, [1.0] * 6]), np.ones(6), HIDDEN, np.random.default_rng(0)
    )
    start = start.with_weights(data["starts"][restart])
    steps = levenberg_marquardt(start, Loss(data["s"], eye, data["t"]))
    for _, (network, _) in zip(range(ITERATIONS), steps, strict=False):
        yield held_loss(data, network(data["s_held"]))


def torch_lm(data: dict, restart: int) -> Iterator[float]:
    """The same iteration in PyTorch: Jacobian by `vmap(jacrev)`, damping by Nielsen's rule."""
    import torch
    from torch.func import jacrev, vmap

    torch.set_num_threads(1)
    s, t, s_held = (torch.from_numpy(data[name]) for name in ("s", "t", "s_held"))
    h, n, p = HIDDEN, s.shape[1], t.shape[1]

    def network(w: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        w1, b1, w2, b2 = torch.split(w, [h * n, h, p * h, p])
        return w2.view(p, h) @ torch.tanh(w1.view(h, n) @ x + b1) + b2

    forward, jacobian = vmap(network, (None, 0)), vmap(jacrev(network), (None, 0))
    w = torch.from_numpy(data["starts"][restart])
    damping, growth = None, 2.0
    residual = (t - forward(w, s)).ravel()
    for _ in range(ITERATIONS):
        J = jacobian(w, s).reshape(-1, len(w))
        gram, gradient = J.T @ J, J.T @ residual
        damping = 1e-2 * torch.trace(gram) / len(w) if damping is None else damping
        while True:
            step = torch.linalg.solve(gram + damping * torch.eye(len(w), dtype=w.dtype), gradient)
            trial = (t - forward(w + step, s)).ravel()
            gain = residual @ residual - trial @ trial
            if gain > 0:
                break
            damping, growth = damping * growth, growth * 2
            if not torch.isfinite(damping):
                return
        ratio = min(float(gain / (step @ (damping * step + gradient))), 1.0)
        damping, growth = damping * max(1 / 3, 1 - (2 * ratio - 1) ** 3), 2.0
        w, residual = w + step, trial
        yield held_loss(data, forward(w, s_held).numpy())


def regressor(restart: int, **options: object):
    from sklearn.neural_network import MLPRegressor

    return MLPRegressor(
        hidden_layer_sizes=(HIDDEN,), activation="tanh", alpha=0.0, random_state=restart, **options
    )


def sklearn_adam(data: dict, restart: int) -> Iterator[float]:
    """MLPRegressor's default solver, an epoch of all rows at a time."""
    model = regressor(restart, batch_size=len(data["s"]))
    for _ in range(EPOCHS):
        model.partial_fit(data["s"], data["t"])
        yield held_loss(data, model.predict(data["s_held"]))


def sklearn_lbfgs(data: dict, restart: int) -> Curve:
    """MLPRegressor's solver for small data.

    It cannot be watched: one whole fit per number of iterations.
    """
    curve = []
    for iterations in np.unique(np.geomspace(1, ITERATIONS * 5, 40).astype(int)):
        start = time.process_time()
        model = regressor(restart, solver="lbfgs", max_iter=int(iterations), tol=0.0).fit(
            data["s"], data["t"]
        )
        curve.append((time.process_time() - start, held_loss(data, model.predict(data["s_held"]))))
    return curve


ADAM = "scikit-learn MLPRegressor, Adam"
TOOLS = {
    "calibtool, Levenberg–Marquardt": ("calibtool", calibtool_lm),
    "PyTorch, Levenberg–Marquardt": ("torch", torch_lm),
    "scikit-learn MLPRegressor, L-BFGS": ("sklearn", sklearn_lbfgs),
    ADAM: ("sklearn", sklearn_adam),
}


def watch(losses: Iterator[float]) -> Curve:
    start = time.process_time()
    return [(time.process_time() - start, loss) for loss in losses]


def tool_process(tool: str, files: list[Path]) -> None:
    """Inside the tool's process: one curve per data set and restart, after one to warm up, into
    FILE.curves.npz.
    """
    warnings.simplefilter("ignore")  # scikit-learn's about iterations that were asked for
    function = TOOLS[tool][1]

    def curve(data: dict, restart: int) -> Curve:
        result = function(data, restart)
        return result if isinstance(result, list) else watch(result)

    curve(dict(np.load(files[0])), 0)
    for file in files:
        data = dict(np.load(file))
        np.savez(
            f"{file}.curves.npz", *[np.array(curve(data, restart)) for restart in range(RESTARTS)]
        )


def run_tool(tool: str, files: list[Path], pythons: Interpreters) -> list[list[np.ndarray]]:
    """Curves (I, 2) by data set and restart. PeerError if the peer is missing or fails."""
    python = pythons[TOOLS[tool][0]]
    require(TOOLS[tool][0], python)
    output([__file__, "--tool", tool, *map(str, files)], python)
    return [list(np.load(f"{file}.curves.npz").values()) for file in files]


def time_to(curve: np.ndarray, level: float) -> float:
    reached = np.flatnonzero(curve[:, 1] <= level)
    return float(curve[reached[0], 0]) if len(reached) else np.inf


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    add_interpreters(parser)
    parser.add_argument("--tool", help=argparse.SUPPRESS)
    parser.add_argument("files", nargs="*", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.tool is not None:
        tool_process(arguments.tool, arguments.files)
        return
    curves: dict[str, list[list[np.ndarray]]] = {}
    notes = {}
    with tempfile.TemporaryDirectory() as place:
        files = [Path(place, f"{seed}.npz") for seed in range(arguments.seeds)]
        for seed, file in enumerate(files):
            write_data(file, seed)
        for tool in TOOLS:
            try:
                curves[tool] = run_tool(tool, files, interpreters(arguments))
            except PeerError as error:
                notes[tool] = str(error)
    table(curves, notes)


def table(curves: dict[str, list[list[np.ndarray]]], notes: dict[str, str]) -> None:
    """Time to two losses per seed that the median run of every tool, and of every one
    but Adam, reaches.
    """
    best = {
        tool: np.array([[c[:, 1].min() for c in seed] for seed in sets])
        for tool, sets in curves.items()
    }
    medians = {tool: np.median(b, axis=1) for tool, b in best.items()}
    coarse = np.max(list(medians.values()), axis=0)
    fine = np.max([m for tool, m in medians.items() if tool != ADAM], axis=0)
    print(
        "| tool | lowest validation loss | time to the coarse loss | runs | time to the "
        "fine loss | runs |"
    )
    print("|---|---|---|---|---|---|")
    for tool in TOOLS:
        if tool in notes:
            print(f"| {tool} | {notes[tool]} | | | | |")
            continue
        cells = [f"{np.median(best[tool]):.3f} ({best[tool].max():.3f})"]
        for level in (coarse, fine):
            sets = zip(curves[tool], level, strict=True)
            taken = np.array([time_to(curve, 1.001 * e) for seed, e in sets for curve in seed])
            median = np.median(taken)
            cells += [
                f"{median * 1e3:.1f} ms" if np.isfinite(median) else "-",
                f"{np.isfinite(taken).sum()} of {len(taken)}",
            ]
        print(f"| {tool} | {' | '.join(cells)} |")
    print(
        "\nMedians over runs; losses divided by the mean square of the targets: coarse "
        f"{np.median(coarse):.3f},",
        end=" ",
    )
    print(
        f"fine {np.median(fine):.3f}. A run that never gets there counts as the slowest. Time is "
        "that of one CPU."
    )


if __name__ == "__main__":
    main()
