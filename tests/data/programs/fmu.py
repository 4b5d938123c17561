"""A functional mock-up unit."""

import gyrospark as gs

built = gs.build("fmu3", "double_pendulum", stages=2, out="pendulum.fmu")
print(built.path, built.check())
