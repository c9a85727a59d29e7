"""One system alone: what is gravity at a place, and what does the lidar see from there?

    python examples/1_one_system.py

A system is evaluated in a Context of its own: fix its input ports, then ask an output port.
"""

import matplotlib.pyplot as plt
import numpy as np

from proxops.diagrams.scenario import load_body
from proxops.systems import Lidar, PolyhedralGravity

PLACE = [150e3, 20e3, 10e3]  # m, in K, the frame that turns with the body

body = load_body("kleopatra")
gravity = PolyhedralGravity(body.gravity_field)
context = gravity.CreateDefaultContext()
gravity.GetInputPort("position").FixValue(context, PLACE)
print("gravity:", gravity.GetOutputPort("acceleration").Eval(context), "m/s^2")

lidar = Lidar(body.shape)
context = lidar.CreateDefaultContext()
lidar.GetInputPort("position").FixValue(context, PLACE)
ranges = lidar.GetOutputPort("ranges").Eval(context).reshape(12, 360)
print(np.isfinite(ranges).sum(), "returns of", ranges.size, "rays")

plt.imshow(
    np.where(np.isfinite(ranges), ranges / 1e3, np.nan), aspect="auto", interpolation="nearest"
)
plt.xlabel("ray")
plt.ylabel("plane")
plt.colorbar(label="range (km)")
plt.savefig("one_system.png")
