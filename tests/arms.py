"""The built-in robots that differ in kind: what tests go through that try every robot."""

from calibtool.robot.catalogue import load_robot, robot_names

# Arms that differ from others in their numbers alone have tests of their own (test_arms).
LIKE_OTHERS = {
    *("abb-irb120", "abb-irb1200", "abb-irb2600", "abb-irb4600", "abb-irb6700", "denso-vs060"),
    *(
        "doosan-m1013",
        "fanuc-lrmate200id",
        "fanuc-m20ia",
        "fanuc-r2000ic-165f",
        "kinova-gen3",
        "nachi-mz07",
    ),
    *("kuka-iiwa14", "kuka-kr210-r2700", "staubli-tx2-60l", "techman-tm12", "yaskawa-gp25"),
    *("ur3e", "ur5e", "ur16e", "ur20", "ur30"),
}
LOOPS = [name for name in robot_names() if load_robot(name).chain.tree is not None]
ROBOTS = [name for name in robot_names() if name not in LIKE_OTHERS and name not in LOOPS]
