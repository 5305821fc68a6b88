"""From an experiment to its figures: which joins rig, photographs and identification.

`analyse` joins a journal with the log of the test machine; `simulate` does a whole isobaric test
without hardware. Only this room and the commands import all packages.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
