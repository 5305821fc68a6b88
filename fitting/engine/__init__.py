"""The fit: families of models, constraints, objectives, certificate; one problem, two drivers."""
