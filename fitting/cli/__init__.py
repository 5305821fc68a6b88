"""The commands for force maps and fitted muscles, each with its options."""
