"""Convex programmes with certificates: the core of every fit."""
