"""A knee with two muscles in MuJoCo, driven past the stroke they were identified on."""

import dataclasses
import math
from importlib import import_module
from typing import Any

import numpy as np

from famjax.export import TabulatedPull, install

_HALF_WIDTH = 0.1  # m, of the lever on the shank
_KNEE = """
<mujoco>
  <worldbody>
    <site name="front" pos="{lever} 0 {above}"/>
    <site name="back" pos="-{lever} 0 {above}"/>
    <body name="shank">
      <joint name="knee" type="hinge" axis="0 1 0" damping="1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.04" mass="3.5"/>
      <site name="front lever" pos="{lever} 0 0"/>
      <site name="back lever" pos="-{lever} 0 0"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="extensor"><site site="front"/><site site="front lever"/></spatial>
    <spatial name="flexor"><site site="back"/><site site="back lever"/></spatial>
  </tendon>
  <actuator>
    <general name="extensor" tendon="extensor" gaintype="user" biastype="user"/>
    <general name="flexor" tendon="flexor" gaintype="user" biastype="user"/>
    <position name="drive" joint="knee" kp="4000" kv="40"/>
  </actuator>
</mujoco>
"""


@dataclasses.dataclass(frozen=True)
class KneeRun:
    """What a knee did.

    Attributes:
        overrun: by how much it left the identified stroke at either end, the lesser, in strokes [-].
        fastest: largest speed [rad/s] of all 10 s.
        at_rest: largest speed in the last second, the drive being off [rad/s].
        finite: whether every state was.
    """

    overrun: float
    fastest: float
    at_rest: float
    finite: bool


def driven_knee(pull: TabulatedPull, *, overrun: float = 0.3, seconds: float = 10.0) -> KneeRun:
    """Drive a knee to and fro past the stroke at changing pressures, then let it go.

    The first six tenths of the time a servo swings it at 0.5 Hz so far that both muscles become
    shorter and longer than in their data, at pressures from none to 1.3 times the highest. Then the
    servo is off, the pressures are held, and it must come to rest. MuJoCo's default step.

    Args:
        pull: of both muscles.
        overrun: beyond either end of the stroke, in strokes.
        seconds: of simulated time.
    """
    mujoco: Any = import_module("mujoco")  # an extra of the project, without types

    short, long = pull.lengths[0], pull.lengths[-1]
    reach = (0.5 + overrun) * (long - short)
    middle = 0.5 * (short + long)
    xml = _KNEE.format(lever=_HALF_WIDTH, above=middle)
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    install(model, {"extensor": pull, "flexor": pull})
    # A little more than the angle at which the distance from lever to anchor has changed so much.
    amplitude = 1.1 * math.asin(min(reach / _HALF_WIDTH, 1.0))
    highest = pull.pressures[-1]
    steps = round(seconds / model.opt.timestep)
    lengths, speeds = np.empty((steps, 2)), np.empty(steps)
    try:
        for k in range(steps):
            time = k * model.opt.timestep
            wave = math.sin(2 * math.pi * 1.3 * time)
            if time < 0.6 * seconds:
                data.ctrl[:] = [
                    0.65 * highest * (1 + wave),
                    0.65 * highest * (1 - wave),
                    amplitude * math.sin(math.pi * time),
                ]
            else:
                model.actuator_gainprm[2, 0] = model.actuator_biasprm[2, 1:3] = 0.0
            mujoco.mj_step(model, data)
            lengths[k], speeds[k] = data.ten_length, abs(data.qvel[0])
    finally:
        mujoco.set_mjcb_act_bias(None)
        mujoco.set_mjcb_act_gain(None)
    past = min(short - lengths.min(axis=0).max(), lengths.max(axis=0).min() - long)
    finite = bool(np.isfinite(lengths).all() and np.isfinite(speeds).all())
    last = round(1.0 / model.opt.timestep)
    return KneeRun(
        float(past) / (long - short), float(speeds.max()), float(speeds[-last:].max()), finite
    )
