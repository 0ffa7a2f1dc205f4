"""A team on a plane in MJCF, MuJoCo's own format.

Wheels stand on the ground without friction: `firmware_bridge.simulation.wheels.traction` adds it. MuJoCo's
own lifts wheels that skid, so that bases turn by half to three quarters of what they should.
"""

import math
from collections.abc import Sequence
from typing import Final

from edge_runtime.config.fleet import Obstacle
from firmware_bridge.simulation.wheels.bases import WHEELS, WheeledBase

GRAVITY_M_S2: Final = 9.81
STEP_S: Final = 0.0025
GROUND: Final = 0
"""Its geom."""
COLOURS: Final = ("0.93 0.72 0.1 1", "0.16 0.47 0.75 1", "0.8 0.28 0.22 1", "0.27 0.6 0.35 1")
OBSTACLE_M: Final = 1.2
"""How tall obstacles are: taller than any base."""
SERVO_M_S: Final = 0.005
"""A wheel's motor holds against a push as great as its load where the rim is so much slower than told."""
_HEAD: Final = f"""<mujoco model="team">
<option timestep="{STEP_S}" integrator="implicitfast"><flag autoreset="disable" island="disable"/></option>
<visual><global offwidth="1920" offheight="1080"/><quality shadowsize="4096" offsamples="8"/>
<headlight ambient="0.4 0.4 0.4" diffuse="0.4 0.4 0.4"/></visual>
<default>
<geom type="box" contype="0" conaffinity="0" condim="1" mass="0"/>
<default class="wheel"><geom type="sphere" contype="1" rgba="0 0 0 0"/></default>
<default class="hull"><geom contype="2" conaffinity="2" condim="3" friction="0.3 0 0" rgba="0 0 0 0"/>
</default>
<default class="obstacle"><geom type="cylinder" contype="2" condim="3" friction="0.3 0 0"
rgba="0.45 0.4 0.5 1"/></default>
</default>
<asset>
<texture name="ground" type="2d" builtin="checker" rgb1="0.8 0.8 0.78" rgb2="0.76 0.76 0.74" width="256"
height="256"/><material name="ground" texture="ground" texuniform="true"/>
<texture type="skybox" builtin="flat" rgb1="0.93 0.95 0.97" width="8" height="8"/>
</asset>
<worldbody>
<light pos="0 0 20" dir="0.3 0.2 -1" directional="true" diffuse="0.5 0.5 0.5"/>
<geom type="plane" size="0 0 1" material="ground" conaffinity="1"/>
"""


def mjcf(
    base: WheeledBase,
    poses: Sequence[tuple[float, float, float]],
    payload_kg: float,
    obstacles: Sequence[Obstacle] = (),
) -> str:
    """Describe robots of one base, each where (x, y, heading) says, in m and rad, and obstacles after them.

    Hulls are called ``robot0`` and so on, wheels ``wheel0_0`` to ``wheel0_3``, obstacles ``obstacle0``; a
    robot's body is followed by its wheels'. A payload is a box on the hull of half its length, width and
    height. Obstacles are cylinders that nothing moves but whoever sets their places.
    """
    # MuJoCo's reader refuses numbers next to zero.
    payload_kg = round(payload_kg, 9)
    poses = [(round(x, 9), round(y, 9), round(heading, 9)) for x, y, heading in poses]
    robots = "".join(_robot(base, index, pose, payload_kg) for index, pose in enumerate(poses))
    load_n = GRAVITY_M_S2 * (base.mass_kg + payload_kg) / len(WHEELS)
    gain = load_n * base.wheel_radius_m**2 / SERVO_M_S
    motors = "".join(
        f'<velocity joint="wheel{index}_{wheel}" kv="{gain}"/>'
        for index in range(len(poses))
        for wheel in range(len(WHEELS))
    )
    discs = "".join(_obstacle(index, one) for index, one in enumerate(obstacles))
    return f"{_HEAD}{robots}{discs}</worldbody><actuator>{motors}</actuator></mujoco>"


def _robot(base: WheeledBase, index: int, pose: tuple[float, float, float], payload_kg: float) -> str:
    x, y, heading = pose
    length, width, height = (size / 2 for size in base.size_m)
    low = base.clearance_m - base.wheel_radius_m
    look = [  # middle ahead and up, half sizes, colour
        (0.0, 0.6, 0.92, base.track_m / width / 2 * 0.72, 0.6, "0.17 0.17 0.18 1"),
        (0.0, 1.48, 0.86, 0.94, 0.28, COLOURS[index % len(COLOURS)]),
        (0.0, 1.8, 0.72, 0.72, 0.06, "0.22 0.22 0.23 1"),
        (0.96, 0.8, 0.04, 0.8, 0.24, "0.1 0.1 0.1 1"),
    ]
    boxes = "".join(
        f'<geom pos="{ahead * length} 0 {low + up * height}" rgba="{colour}" '
        f'size="{along * length} {across * width} {tall * height}"/>'
        for ahead, up, along, across, tall, colour in look
    )
    load = (
        f'<body pos="0 0 {low + 2.5 * height}"><geom mass="{payload_kg}" '
        f'size="{length / 2} {width / 2} {height / 2}" rgba="0.6 0.5 0.38 1"/></body>'
    )
    wheels = "".join(
        _wheel(base, f"wheel{index}_{wheel}", ahead * base.wheelbase_m / 2, left * base.track_m / 2)
        for wheel, (ahead, left) in enumerate(WHEELS)
    )
    mass = f'pos="{_row(base.centre_m)}" mass="{base.body_kg}" diaginertia="{_row(base.inertia_kg_m2)}"'
    hull = f'pos="0 0 {low + height}" size="{length} {width} {height}"'
    return f"""<body pos="{x} {y} {base.wheel_radius_m}" euler="0 0 {math.degrees(heading)}"><freejoint/>
<inertial {mass}/><geom name="robot{index}" class="hull" {hull}/>{boxes}
{wheels}{load if payload_kg else ""}</body>
"""


def _obstacle(index: int, obstacle: Obstacle) -> str:
    (x, y), half = (round(value, 9) for value in obstacle.centre_m), OBSTACLE_M / 2
    disc = f'name="obstacle{index}" class="obstacle" size="{obstacle.radius_m} {half}"'
    return f'<body mocap="true" pos="{x} {y} {half}"><geom {disc}/></body>\n'


def _wheel(base: WheeledBase, name: str, x: float, y: float) -> str:
    radius, half = base.wheel_radius_m, base.wheel_width_m / 2
    spokes = "".join(
        f'<geom size="{0.1 * radius} {1.04 * half} {0.6 * radius}" euler="0 {angle} 0" '
        'rgba="0.55 0.55 0.56 1"/>'
        for angle in (0, 60, 120)
    )
    tyre = f'size="{radius} {half}" zaxis="0 1 0" mass="{base.wheel_kg}" rgba="0.1 0.1 0.1 1"'
    return f"""<body pos="{x} {y} 0"><joint name="{name}" axis="0 1 0"/>
<geom name="{name}" class="wheel" size="{radius}"/><geom type="cylinder" {tyre}/>{spokes}</body>
"""


def _row(values: Sequence[float]) -> str:
    return " ".join(map(str, values))
