"""C of a step in single precision, for a controller."""

import gyrospark as gs

built = gs.build("arduino", "examples/control_c/satellite.toml", stages=2, out="satellite")
print(built.files)
