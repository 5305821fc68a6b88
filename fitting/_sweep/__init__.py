"""All permutations of the law at fixed geometry."""
