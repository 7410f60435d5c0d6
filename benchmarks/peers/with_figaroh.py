"""What a user of figaroh writes: a configuration, and its UR10 example's calibration class."""

import numpy as np
import yaml
from figaroh.calibration.base_calibration import BaseCalibration
from figaroh.calibration.calibration_tools import calc_updated_fkm
from figaroh.tools.robot import load_robot

METHOD = "structural"


class Calibration(BaseCalibration):
    def cost_function(self, var):
        estimated = calc_updated_fkm(self.model, self.data, var, self.q_measured, self.calib_config)
        residuals = self._compute_logmap_residuals(self.PEE_measured, estimated)
        return self.apply_measurement_weighting(residuals, pos_weight=1.0, orient_weight=0.5)


def configuration(folder, count):
    position_only = [True, True, True, False, False, False]
    marker = {"reference_joint": "j6", "measurable_dof": position_only, "sensor_type": "mocap"}
    calibration = {
        "enabled": True,
        "parameters": {
            "calibration_level": "full_params",
            "outlier_threshold": 0.02,
            "estimation": {"method": METHOD},
        },
        "kinematics": {"base_frame": "universe", "tool_frame": "flange"},
        "measurements": {
            "markers": [dict(marker, name=f"target{k + 1}") for k in range(count)],
            "poses": {"base_pose": [0.0] * 6, "tool_pose": [0.0] * 6},
        },
        "data": {"source_file": str(folder / "train.csv"), "number_of_samples": 50},
    }
    joints = {"active_joints": ["j1", "j2", "j3", "j4", "j5", "j6"]}
    return {
        "robot": {"name": "arm", "properties": {"joints": joints}},
        "tasks": {"calibration": calibration},
    }


def calibrate(folder, targets):
    file = folder / "figaroh.yaml"
    file.write_text(yaml.safe_dump(configuration(folder, len(targets))))
    robot = load_robot(str(folder / "robot.urdf"), load_by_urdf=True)
    calibration = Calibration(robot, str(file))
    calibration.calib_config["known_baseframe"] = False
    calibration.calib_config["known_tipframe"] = False
    calibration.initialize()
    result = calibration.solve(enable_logging=False)

    def predict(q):
        configuration = dict(calibration.calib_config, NbSample=len(q))
        points = calc_updated_fkm(calibration.model, calibration.data, result.x, q, configuration)
        return np.moveaxis(points.reshape(len(targets), 3, len(q)), 2, 0)

    return predict
