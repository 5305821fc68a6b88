"""Published static models and famjax's own on one force map: fits, cross-validation, a league table.

`compare` makes the table, `fit_peer` fits one model, `cross_validate` leaves readings out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
