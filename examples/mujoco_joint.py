"""Control the angle and stiffness of a MuJoCo joint with two muscles, under gravity and a push."""

import jax
import mujoco
import numpy as np

import famjax
from famjax.control import Antagonist, Outcome, Pulley

jax.config.update("jax_enable_x64", True)
ARM = """<mujoco><option timestep="0.001"/><worldbody><body><joint name="elbow" axis="0 -1 0"
 damping="0.3"/><geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.02" mass="0.4"/></body>
</worldbody></mujoco>"""
braid = famjax.Braid.from_rest(diameter=0.023, braid_angle=1.1, length=0.296)
shape = famjax.EstimatedGeometry(braid, famjax.Bladder(0.296, 0.023, 1.8e-3, embedded=True))
muscle = famjax.Muscle(shape, famjax.materials.NeoHookeanMaterial(3e5), 40e3)
paths = (Pulley(0.02, 0.27), Pulley(-0.02, 0.27))
pair = Antagonist(muscle, muscle, paths, (0.0, 6e5))

model = mujoco.MjModel.from_xml_string(ARM)
data = mujoco.MjData(model)
angle, stiffness, push = 0.4, 9.0, 0.5
data.qpos[0] = angle
mujoco.mj_forward(model, data)
found = pair.pressures_for(angle, stiffness, data.qfrc_bias[0])  # balances the weight of the arm
print(Outcome(int(found.code)).message, f"{found.flexor:.0f} Pa, {found.extensor:.0f} Pa")
torque = jax.jit(lambda at: pair.torque(at, found.flexor, found.extensor))


def settled(extra: float) -> float:
    for _ in range(3000):
        data.qfrc_applied[0] = float(torque(np.float64(data.qpos[0]))) + extra
        mujoco.mj_step(model, data)
    return float(data.qpos[0])


held, gravity = settled(0.0), data.qfrc_bias[0] * np.tan(angle)  # gravity reduces the stiffness
print(f"held at {held:.6f} rad; stiffness {push / (settled(push) - held) + gravity:.2f} N m/rad")
