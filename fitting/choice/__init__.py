"""The choice of the model: a ladder of families, judged by what each predicts of data left out."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
