"""Programs recorded once and executed in NumPy: tapes, their rules, and their store on disk."""
