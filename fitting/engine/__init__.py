"""The one fit: a family of models, its program, variable projection on the host and in JAX."""
