"""A characterisation folder end to end: what lies in it, the steps of its evaluation, its report."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
