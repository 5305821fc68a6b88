"""Photographs of a muscle to its shape D(z); this version reserves the name, nothing is built yet."""

__famjax__ = "0.1.0"
