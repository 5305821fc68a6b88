"""The commands of force maps and fitted muscles, each with its options."""
