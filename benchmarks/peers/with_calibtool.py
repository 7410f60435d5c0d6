"""What a user of calibtool writes: a column map, and three calls."""

from calibtool.calibration import identify
from calibtool.measurement.importing import import_table, parse_column_map
from calibtool.robot.catalogue import load_robot
from calibtool.robot.se3 import transform_points

TARGET = '[[targets]]\nmeasured = ["x{0}", "y{0}", "z{0}"]\nunit = "m"\non_tool_mm = {1}\n'
COLUMNS = (
    '[joints]\ncolumns = ["j1", "j2", "j3", "j4", "j5", "j6"]\nunit = "rad"\n[instrument]\n'
    'frame = "base"\n'
)


def calibrate(folder, targets):
    columns = COLUMNS + "".join(
        TARGET.format(k + 1, (1e3 * p).tolist()) for k, p in enumerate(targets)
    )
    robot = load_robot(str(folder / "robot.urdf"))
    text = (folder / "train.csv").read_text()
    measurements = import_table(text, "train.csv", robot, parse_column_map(columns, "columns"))[0]
    calibration = identify(measurements, "complete")
    return lambda q: transform_points(calibration.forward(q), targets)
