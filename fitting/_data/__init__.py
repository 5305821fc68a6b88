"""Force maps: readings, specimen, units, files."""
