"""Commands that fit force maps, and what they share."""
