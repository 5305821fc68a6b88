"""Test rig: protocol, link, journal, plans and simulation.

Start with `read_plan` and `Rig`, which controls the pressure and always vents the muscle on exit.
`read_journal` reads a journal and `audit` checks it; `rig.simulation` simulates a rig without hardware. For
the firmware, wiring and safety rules, see `rig/firmware/README.md`.
"""

import lazy_loader

__famjax__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
