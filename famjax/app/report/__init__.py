"""The report on a characterisation folder: a page and its figures, for screen and print."""
