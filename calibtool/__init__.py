"""calibtool: make a serial robot accurate in software, from its description and a set of measurements.

The rooms, in the order in which data flows through them: `robot`, `measurement`, `identification`, `equivalent`,
`calibration`, `compensation`, `export`, `evaluation`; `storage` and `tables` are the doors; `cli` is one of its users.

Conventions, everywhere: metres and radians; twists are (v, ω), linear part first; `T_a_b` is the pose of frame b in
frame a; joint positions `q` have one coordinate per joint.
"""

__version__ = "0.1.0"
