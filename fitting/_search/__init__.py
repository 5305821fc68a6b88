"""The identification itself: starts, descents, the certified result."""
