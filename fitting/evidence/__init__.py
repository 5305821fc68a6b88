"""What speaks for a fit or against it: validation, profiles, bootstrap, several specimens."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
