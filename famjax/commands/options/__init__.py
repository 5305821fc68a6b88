"""Options of the command line as numbers in SI, recipes and requirements."""
