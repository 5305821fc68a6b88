"""MuJoCo: a load that hangs on the muscle as XML, and the muscle's callback as a Python module."""

import importlib.resources
import math
import pprint
from xml.sax.saxutils import quoteattr

from .subject import Subject
from .templated import docstring

_GRAVITY = 9.81
_SHARE = 0.5, 2 / 3  # load in the blocked force, and its pressure in the highest


def mujoco_files(subject: Subject) -> dict[str, bytes]:
    """`NAME.xml` with user actuators, and `NAME_mujoco.py`, which needs MuJoCo and nothing else."""
    name = subject.identifier
    return {
        f"{name}.xml": hanging_load(subject, 'gaintype="user" biastype="user"').encode(),
        f"{name}_mujoco.py": _module(subject).encode(),
    }


def hanging_load(subject: Subject, kind: str, *, pressure: bool = True) -> str:
    """A load of half the blocked force on the muscle, with the equilibrium as a keyframe.

    The tendon is `spatial` and as long as the muscle; with `subject.tendon_offset` it is `fixed`, and
    the joint is 0 where the muscle has that length.

    Args:
        subject: the muscle.
        kind: attributes of the actuator, which is of the muscle's name.
        pressure: whether the control is the pressure [Pa], or the motor's force [N].
    """
    pull, name = subject.pull, subject.identifier
    at = _SHARE[1] * pull.pressures[-1]
    load = _SHARE[0] * pull.force(float(subject.muscle.rest_length), at)
    length = float(subject.muscle.length_at_load(load, at))
    mass = load / _GRAVITY
    critical = 2 * math.sqrt(mass * pull.stiffness(length, at))
    control = f"{at!r}" if pressure else f"{-load!r}"
    limits = (
        f' ctrllimited="true" ctrlrange="0 {pull.pressure_limit!r}"'
        if pressure
        else ' ctrllimited="false"'
    )
    offset, given = subject.tendon_offset, quoteattr(name)
    at_zero = length if offset is None else offset
    tendon = (
        f"""<spatial name={given} width="0.01">
      <site site="anchor"/>
      <site site="hook"/>
    </spatial>"""
        if offset is None
        else f"""<fixed name={given}>
      <joint joint="slide" coef="-1"/>
    </fixed>"""
    )
    about = "; ".join(line.strip() for line in subject.about_table)
    return f"""<mujoco model={quoteattr(subject.name)}>
  <custom>
    <text name="about" data={quoteattr(about)}/>
  </custom>
  <option gravity="0 0 -{_GRAVITY}"/>
  <worldbody>
    <site name="anchor"/>
    <body name="load" pos="0 0 {-at_zero!r}">
      <joint name="slide" type="slide" axis="0 0 1" damping="{critical!r}"/>
      <geom type="sphere" size="0.05" mass="{mass!r}" contype="0" conaffinity="0"/>
      <site name="hook"/>
    </body>
  </worldbody>
  <tendon>
    {tendon}
  </tendon>
  <actuator>
    <general name={given} tendon={given} {kind}{limits}/>
  </actuator>
  <keyframe>
    <key name="at rest" qpos="{at_zero - length!r}" ctrl="{control}"/>
  </keyframe>
</mujoco>
"""


def _module(subject: Subject) -> str:
    """A Python module of the table, its evaluation and the callback."""
    room = importlib.resources.files(__name__.rpartition(".")[0])
    parts = [
        (room / file).read_text(encoding="utf-8") for file in ("plain.py", "mujoco_callback.py")
    ]
    name = subject.identifier
    table = pprint.pformat(subject.table, compact=True, width=100, sort_dicts=False)
    offset = "" if subject.tendon_offset is None else f', {{"{name}": OFFSET}}'
    constant = (
        ""
        if subject.tendon_offset is None
        else f"""

OFFSET = {subject.tendon_offset!r}  # m, the muscle's length where the fixed tendon has none
"""
    )
    return f'''"""{docstring(subject.about_table)}

    model = mujoco.MjModel.from_xml_path("{name}.xml")
    install(model, {{"{name}": PULL}}{offset})
"""

{parts[0]}

{parts[1]}

TABLE = {table}

PULL = TabulatedPull(TABLE)
{constant}'''
