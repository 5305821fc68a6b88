"""Both branches of ramps and strokes by Maxwell-slip elements: `BranchPairs` in, strengths out."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
