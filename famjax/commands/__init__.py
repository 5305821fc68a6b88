"""The commands of `famjax`, one file for each: calls of the library, printed and saved.

The only folder of this package that imports the others, and only inside its commands.
"""
