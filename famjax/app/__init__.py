"""The command line, and what joins the packages: tests, photographs and fits of one muscle.

The only package that imports all others.
"""
