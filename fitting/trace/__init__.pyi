from .tape_store import keep_tapes as keep_tapes
