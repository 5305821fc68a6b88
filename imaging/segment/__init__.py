"""Which pixels are cloth, braid and tape: the coarse outline that the fine steps start from."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
