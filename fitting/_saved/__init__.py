"""Results as files, pages, plots, and as muscles again."""
