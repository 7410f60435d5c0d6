"""Payload and temperature as families of errors: one fit over all loads against one per load, and a
drift against none.

Run: python benchmarks/conditions.py [--seeds 10] [--configurations 100]. Prints Markdown tables of
mean position errors on 500 fresh rows, predicted against true poses: median over the seeds, and the
smallest and largest.
"""

import argparse
from collections.abc import Mapping

import numpy as np

from calibtool.calibration import Calibration, identify
from calibtool.calibration.fit import BaseOptions
from calibtool.errormodel.actual import ErrorScales
from calibtool.identification.complete import CompleteOptions
from calibtool.measurement.measurements import Measurements
from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot

LOADS = (0.0, 5.0, 10.0)  # kg
DRIFT = (20.0, 35.0)  # °C
Range = tuple[float, float]


def measured(
    kinds: tuple[str, ...], seed: int, count: int, first: Measurements | None, **rows: Range
) -> Measurements:
    """A simulated UR10, or that of `first` again without noise, at other configurations."""
    scales = ErrorScales(("geometric", "gear", "gravity", *kinds), warmth=0.0)
    again = {} if first is None else {"same_robot": first.truth, "noise": 0.0}
    more: Mapping[str, object] = {**rows, **again}
    return simulate(
        load_robot("ur10"),
        Simulation(seed=seed, configurations=count, workspace="full", scales=scales, **more),
    )


def error(calibration: Calibration, fresh: Measurements, blind: bool = False) -> float:
    """Mean position error of predicted poses, mm; `blind`: the calibration is not told payload
    and temperature.
    """
    assert fresh.truth is not None
    truth = fresh.truth.actual.forward(fresh.q, fresh.conditions)
    found = calibration.forward(fresh.q, None if blind else fresh.conditions)
    return 1e3 * float(np.linalg.norm((found - truth)[:, :3, 3], axis=-1).mean())


def without(family: str) -> BaseOptions:
    return BaseOptions("complete", CompleteOptions(orders={family: 0}))


def payload(seed: int, count: int) -> list[float]:
    """Per load: one fit over 0 to 10 kg, a fit of its own, and a fit over all that is
    not told the mass.
    """
    every = measured(("payload",), seed, count, None, payload_kg=(LOADS[0], LOADS[-1]))
    one, blind = identify(every), identify(every, without("payload"))
    row = []
    for load in LOADS:
        own = identify(measured(("payload",), seed, count, None, payload_kg=(load, load)))
        fresh = measured(("payload",), seed + 1000, 500, every, payload_kg=(load, load))
        row += [error(one, fresh), error(own, fresh), error(blind, fresh, blind=True)]
    return row


def temperature(seed: int, count: int) -> list[float]:
    """A fit with a drift, one without any, and one with the drift that is
    not told the temperature.
    """
    drifting = measured(("thermal",), seed, count, None, temperature_c=DRIFT)
    steady = measured(("thermal",), seed, count, None, temperature_c=(DRIFT[0], DRIFT[0]))
    fresh = measured(("thermal",), seed + 1000, 500, drifting, temperature_c=DRIFT)
    at_rest = measured(("thermal",), seed + 1000, 500, steady, temperature_c=(DRIFT[0], DRIFT[0]))
    blind = identify(drifting, without("temperature"))
    return [
        error(identify(drifting), fresh),
        error(identify(steady), at_rest),
        error(blind, fresh, blind=True),
    ]


def spread(values: np.ndarray) -> str:
    return f"{np.median(values):.4f} ({values.min():.4f} to {values.max():.4f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--configurations", type=int, default=100)
    options = parser.parse_args()
    loads = np.array([payload(seed, options.configurations) for seed in range(options.seeds)])
    drifts = np.array([temperature(seed, options.configurations) for seed in range(options.seeds)])
    print(
        "| judged at | one fit, mm | a fit of its own, mm | ratio | not told, mm |\n"
        "|---|---|---|---|---|"
    )
    for k, load in enumerate(LOADS):
        one, own, blind = loads[:, 3 * k : 3 * k + 3].T
        print(
            f"| {load:g} kg | {spread(one)} | {spread(own)} | {spread(one / own)} | "
            f"{spread(blind)} |"
        )
    print(
        "\n| with the drift, mm | without a drift, mm | ratio | not told, mm |\n|---|---|---|---|"
    )
    with_drift, none, blind = drifts.T
    print(
        f"| {spread(with_drift)} | {spread(none)} | {spread(with_drift / none)} | {spread(blind)} |"
    )


if __name__ == "__main__":
    main()
