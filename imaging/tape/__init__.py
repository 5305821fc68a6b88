"""The tapes at the ends: where their inner edges lie, what covers them, how wide they are."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
