"""A test rig, from microcontroller to record: protocol, link, journal, plan, simulation.

Start with `read_plan` and `Rig`: pressure control that vents on every way out. `read_journal` reads
a record back, `audit` checks it; `rig.simulation` is a rig without hardware. The firmware, wiring
and safety rules are in `rig/firmware/README.md`.
"""

import lazy_loader

__famjax__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
