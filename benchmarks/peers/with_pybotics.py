"""What a user of pybotics writes: its calibration example, with every parameter free.

One target; mm inside.
"""

import numpy as np
import pandas as pd
from pybotics.geometry import position_from_matrix
from pybotics.optimization import OptimizationHandler, optimize_accuracy
from pybotics.robot import Robot
from scipy.optimize import least_squares

WORLD = False


def calibrate(folder, targets):
    robot = Robot.from_parameters(np.loadtxt(folder / "mdh.csv", delimiter=","))
    robot.tool.position = 1e3 * targets[0]
    table = pd.read_csv(folder / "train.csv")
    joints = table[["j1", "j2", "j3", "j4", "j5", "j6"]].to_numpy()
    positions = 1e3 * table[["x1", "y1", "z1"]].to_numpy()
    position_only = [True, True, True, False, False, False]
    handler = OptimizationHandler(
        robot, kinematic_chain_mask=True, tool_mask=position_only, world_mask=WORLD
    )
    least_squares(
        optimize_accuracy, handler.generate_optimization_vector(), args=(handler, joints, positions)
    )
    return lambda q: np.array([[position_from_matrix(handler.robot.fk(row)) / 1e3] for row in q])
