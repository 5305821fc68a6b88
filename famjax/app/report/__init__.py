"""The report for a characterisation folder: a page with figures, for screen and print."""
