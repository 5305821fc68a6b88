"""Raw pressure ramps to static force maps."""
