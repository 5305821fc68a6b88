"""Tests of bladder, thread and whole muscle in a testing machine."""
