"""What a user of robotkinecal writes: its example for a robot in a URDF, with points or poses."""

import numpy as np
import roboticstoolbox as rtb
from robotkinecal import SerialRobotKineCal
from scipy.spatial.transform import Rotation
from spatialmath import SE3


def pose(points, targets):
    """The frame (4, 4) in which the targets stand at the measured points."""
    middle, centre = points.mean(axis=0), targets.mean(axis=0)
    R = Rotation.align_vectors(points - middle, targets - centre)[0].as_matrix()
    return SE3.Rt(R, middle - R @ centre, check=False)


def calibrate(folder, targets):
    robot = rtb.ERobot.URDF(str(folder / "robot.urdf"))
    table = np.loadtxt(folder / "train.csv", delimiter=",", skiprows=1)
    points = table[:, 6 : 6 + targets.size].reshape(-1, *targets.shape)
    seen = list(points[:, 0]) if len(targets) == 1 else [pose(p, targets) for p in points]
    calibration = SerialRobotKineCal(robot, "flange")
    calibration.set_observations(list(table[:, :6]), seen)
    if len(targets) == 1:
        calibration.zero_conf_EE_pose = calibration.zero_conf_EE_pose * SE3(targets[0])
    result = calibration.solve()
    calibration.joint_screw_axis, calibration.zero_conf_EE_pose = calibration.get_calibration(
        result
    )
    seen_from_flange = np.zeros((1, 3)) if len(targets) == 1 else targets

    def predict(q):
        poses = [calibration.forward_kinematics(7, row) for row in q]
        return np.array([(T * seen_from_flange.T).T for T in poses])

    return predict
