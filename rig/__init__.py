"""Microcontroller to record of a test; this version reserves the name, nothing is built yet."""

__famjax__ = "0.1.0"
