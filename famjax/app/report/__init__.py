"""The report of a characterisation folder: a page and its figures, for a screen and for print."""
