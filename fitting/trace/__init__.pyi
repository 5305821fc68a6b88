from .elsewhere import run_fits as run_fits
from .tape_store import keep_tapes as keep_tapes
