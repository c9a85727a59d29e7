"""A spacecraft of one's own that turns: a URDF, thrusters beside it, and a flight.

    python examples/12_own_spacecraft.py

Links and joints of the URDF have mass, inertia and wheels; the YAML file has thrusters and sensors.
"""

from itertools import product
from pathlib import Path

from proxops.diagrams.flight import fly
from proxops.diagrams.plots import plot_attitude
from proxops.diagrams.scenario import load_scenario, load_spacecraft

INERTIAL = '<inertial><mass value="{0}"/><inertia ixx="{1}" iyy="{1}" izz="{1}"/></inertial>'
WHEEL = f"""<link name="wheel_{{0}}">{INERTIAL.format(1.0, 0.005)}</link>
<joint name="{{0}}" type="continuous"><parent link="bus"/><child link="wheel_{{0}}"/>
<axis xyz="{{1}}"/></joint>"""
axes = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
wheels = "\n".join(WHEEL.format(*axis) for axis in axes.items())
bus = f'<link name="bus">{INERTIAL.format(77.0, 12.0)}</link>'
Path("bus.urdf").write_text(f'<robot name="mine">{bus}{wheels}</robot>')

# Three at each corner of a cube of 1 m, each pushing inwards along one axis.
rows = [
    [*corner, *(-2 * corner[k] if k == axis else 0.0 for k in range(3)), 3.0]
    for corner, axis in product(product((-0.5, 0.5), repeat=3), range(3))
]
thrusters = "\n".join(f"  - {row}" for row in rows)
Path("mine.yaml").write_text(
    f"bus: bus.urdf\nwheels: [x, y, z]\nthrust_limit_n: 6.5\nthrusters:\n{thrusters}\n"
)
model = load_spacecraft("mine.yaml")
print(f"{model.mass:g} kg, {model.thrusters.count} thrusters")

rigid = {"_tag": "!RigidBody", "model": "mine.yaml"}
log = fly(load_scenario(spacecraft=rigid, dispersions="after_survey_rigid"), "mpc")
for name in ("success", "delta_v_m_s", "pointing_error_deg_p99", "wheel_load"):
    print(name, log.summary[name])
plot_attitude(log).savefig("own_spacecraft.png")
