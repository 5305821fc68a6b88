"""How far a result can be trusted: refits, validation, likelihood, bootstrap."""
